/* The kernels: what runs at every tick.
 *
 * Plain C99 on numbers and arrays: no allocation, no globals, no input or output, no library but
 * libm. Matrices are dense, row by row; a pointer without a size in its comment is a vector of the
 * size that the comment names. What is not const is written. Room for work is an argument.
 *
 * Python reads this file as it is: kernels/__init__.py.
 */
#ifndef KERNELS_H
#define KERNELS_H

#include <stdbool.h>
#include <stdint.h>

/* Digest of the sources that the library was built from. */
const char *kernels_digest(void);

/* compensators.c */

/* Write [next states; demands] = M [states; errors], M (rows, order + inputs). */
void compensate(const double *M, int rows, int order, int inputs, const double *states,
                const double *errors, double *after);

/* Write states (steps + 1, n) of x' = A x + source, of sources (steps, n), after the first. */
void recur(int n, int64_t steps, const double *A, const double *sources, double *states);

/* friction.c */

/* Physics steps of models with dry friction, whose arrays stand one after another: of s states,
 * r places that rub, n inputs, p outputs. See ftc.fdi.fault_model.Rubbing for what they are. */
typedef struct {
    int s, r, n, p, steps_a_tick;
    const double *A, *B, *G, *E, *D, *K, *limit, *C;
} rubbing;

/* Change states X (states, s) of one model to those after a control tick with inputs U (states,
 * n + 1). In each step the friction forces f minimize f'K f / 2 + f'c within their limits, by
 * projected Gauss-Seidel, and x' = A x + B u + G f. Room for 2 s + 3 r numbers. */
void slide(const rubbing *of, int states, const double *U, double *room, double *X);

/* Correct samples of so many ticks that were stepped without friction, of H models and N onsets.
 *
 * `before` and X (H, N, rows, s) are the states before and after, `outputs` (H, N, rows, p) those
 * of the sample: of the model in the first row, and first-order deviations in the others. From row
 * `first` on they are what one limit, `spread` smaller, takes away; none where that is zero.
 * `lifted` (H, s, s) is how states depend on those before without friction. Of v the first n are
 * used. Room: r for held, sliding_room for the other. */
int sliding_room(const rubbing *of, int ticks);
void slide_samples(const rubbing *all, int H, int N, int rows, const bool *steps,
                   const double *before, const double *v, const double *lifted, int ticks,
                   int first, double spread, bool *held, double *room, double *X, double *outputs);

/* segments.c */

/* Write the Mahalanobis distance (H, E) of each point (H, d) from each segment, starts + t ways
 * (E, d), t in 0..1. The covariance is own + other, of (H, d, d) and (E, d, d), or of `one` for
 * all. By Cholesky factors: half the work of a general solution, and a forward substitution is
 * enough. */
int segments_room(int d);
void to_segments(int H, int E, int d, const double *points, const double *starts,
                 const double *ways, const double *own, const double *other, bool one,
                 double *room, double *distance);

/* detection.c: the observer at every sample, of q residuals, J errors, p outputs; k = J + p */

/* Write a root (k, k) with the squares of deviations (k) added to its covariance, by reflections,
 * which leave it lower triangular; room for 2 k (k + 1) numbers. */
void spread_root(const double *root, const double *deviations, int k, double *room, double *after);

/* What an observer tracks: residuals and regressors (q, 1 + J, p); mean (k) of the parameters, and
 * the root (k, k) of their covariance; latest residuals (q, p), their covariance by lag (q, p). */
typedef struct {
    double *memory, *mean, *root, *recent, *covariance;
} watched;

/* What a sample y (p) makes of it, with its innovation: Observer.step.
 *
 * `predicted` (1 + J, p) are the model's outputs, and what each error adds to them, `drift` (k)
 * standard deviations of steps of the parameters, `rate` the weight of this sample in the
 * covariance, `largest` the sum of squares of an innovation that is still learned from. Returns
 * whether it was: only the memory is to be used if not. Room for k (2 k + p + 2) + p numbers. */
bool correct(int q, int J, int p, const watched *before, const double *predicted, const double *y,
             const double *whitening, const double *drift, double rate, double largest,
             bool learns, double *room, const watched *after, double *residual);

/* Write the weights (q) of the latest samples, newest first, that predict the next one best, by
 * the recursion of Levinson and Durbin, from autocovariances (q + 1). */
void predict(const double *covariance, int q, double *weights);

/* The window of ResidualTest.alarm, or 0, of M residuals and as many of the swing (M, 2), which is
 * NULL where there is no dither; room for 3 p numbers. */
int alarming(int M, int p, const double *recent, const double *swing, int shortest,
             double threshold, double demodulated_threshold, double *room);

/* evidence.c: H hypotheses and K onsets, of those that `steps` (H, K) */

/* Change states X (H, K, rows, s) to those after a sample of inputs v (r), with outputs (H, K,
 * rows, p) during it. What drives the last row grows with the age (K) of the onset, in samples.
 * `alone`, `driven` and `spans` as of UncertainModel._stacked. Room for 2 rows (p + s). */
void advance_models(int H, int K, int rows, int s, int p, int r, const bool *steps,
                    const double *alone, const double *driven, const int64_t *spans,
                    const double *v, const double *age, double *room, double *X, double *outputs);

/* Rows of memory (H, K, q, (5 + J) p); sums of products of R = J + p + 4 whitened regressors, the
 * lower triangle row by row; of them and the residuals (H, K, R); and of the residuals (H, K). */
typedef struct {
    double *memory, *information, *score, *energy;
} evidence;

/* Add the residuals of a sample y (p), and if it `weighs` their products; in place if both are one.
 *
 * Of an onset (K) that `begins` hypotheses have the evidence of the first one, which therefore
 * comes last. `mean` (J + p) is that of the prior; `weights` (2, q, (5 + J) p) of the rows of
 * memory, the second of the last hypothesis; `slopes` (H, K, p) of the part lost. Room for
 * p (2 J + p + 12) numbers. */
void weigh_sample(int H, int K, int J, int p, int q, const bool *steps, const bool *begins,
                  bool weighs, const evidence *before, const double *outputs,
                  const double *slopes, const double *y, const double *mean,
                  const double *weights, double *room, const evidence *after);

/* Solve S = 1 + spread' information spread for each of so many, by Cholesky.
 *
 * `spread` (R, R) is lower triangular; `solved` (count, R, 3) comes with the right-hand sides, and
 * `log_det` (count) becomes half of log det S. S is at least 1, and so is each of its pivots: a
 * smaller one is rounding, as is one that is lost beside the diagonal. Room for R (2 R + 1). */
void integrate_out(int count, int R, const double *information, const double *spread,
                   double *room, double *solved, double *log_det);

/* rigid.c: poses, detectors, loops */

/* Where a log of a plant is read and written: N ticks of n drives. */
typedef struct {
    const double *counts;                               /* what a gap of each equality counts */
    const double *xmat, *xpos, *base_xmat, *R_0, *p_0;  /* as of seen_from */
    int drives, at_joints;                              /* n, and how many are joints */
    const int64_t *joints, *places;   /* these, and where they are read in qpos */
    const int64_t *others, *outputs;  /* the others, and where in the lengths of actuators */
    const double *gear, *nominal;     /* of the others, and where each drive is nominally, (n) */
    const double *qpos, *lengths, *forces;
    int kept_qpos, kept_forces;  /* how many are logged */
    double *rotation, *translation_m, *task, *displacement, *closure_residual_m;
    double *all_qpos, *all_forces;
} observation;

/* Numbers times a factor, rounded if whole, within limits; times a gain. */
typedef struct {
    double factor, lower, upper, gain;
    bool whole;
} conversion;

/* Poses R (3, 3), t after displacements [rotation vector; translation], as many as `poses`. */
void move(int poses, const double *R, const double *t, const double *twists, double *R_new,
          double *t_new);
/* Write displacements [rotation vector; translation] of as many poses; returns the largest
 * angle. */
double displacements(int poses, const double *R, const double *t, double *twists);
/* Write [rotation vector; translation] from one pose to another; returns the angle. */
double way(const double *R, const double *p, const double *R_to, const double *p_to, double *twist);
/* Write the motion R, t of a frame at xmat, xpos since its nominal pose, in present base axes:
 * R_now R_nominal^T. R_0 goes from world axes to those of the frame, nominally. */
void seen_from(const double *xmat, const double *xpos, const double *base_xmat, const double *R_0,
               const double *p_0, double *R, double *t);
/* Largest of the first rows' gaps, each times the number that its owner counts. */
double largest_gap(const double *gaps, const int32_t *owners, const double *counts, int rows);
/* Largest of the gaps times their units; NaN if one is NaN. */
double largest(const double *gaps, const double *units, int count);
/* Take rows of J (., velocities) that keep pairs of anchors together as at their midpoints. Three
 * of `points` (count) belong to each pair, whose gap is D; a joint about an axis (velocities, 6)
 * that carries one or two of its bodies, (count, velocities), moves it by half of D x axis each. */
void at_midpoints(const double *gaps, const double *axes, int velocities, const int64_t *points,
                  int count, const double *carried, double *J);
/* Write tick k of a log; gaps, owners and rows are as of largest_gap. Returns the angle of the
 * pose. */
double observe(const observation *log, int k, const double *gaps, const int32_t *owners, int rows);
/* Write the two angles at which a detector sees a beam along z, from a payload turned by R. The
 * spot has noise times deviation added, and stays on the detector. */
void spot(const double *R, double focal, double half_width, double deviation, const double *noise,
          double *seen);
/* Convert n numbers x to y; NaN stays NaN. */
void convert(const conversion *by, int n, const double *x, double *y);

/* boxes.c */

/* argument_checks.ties.exceeds of two numbers. */
bool exceeds(double value, double bound, double zero);

/* Whether these are a lower and an upper limit, infinite where there is none; NaN is not. */
bool are_limits(double lower, double upper);

/* Copy limits (n) to `limits` (2, n); whether each lower one is at most the upper one. */
bool copy_limits(int n, const double *lower, const double *upper, double *limits);

/* The box (n) of prioritized.viable_rates; given are positions, rates, lower and upper limits of
 * positions, of rates, and of accelerations, (8, n). Returns whether they are such as that function
 * takes; else what is written means nothing. */
bool viable_box(int n, const double *given, double T, double *lower, double *upper, bool *viable);

/* loops.c */

/* Eliminate p passive velocities by reflections of the rows of J_C (c, N), of which `order` (p + n)
 * has the velocities, passive ones first. M (c + 1, p + n), or with `closing` c columns wider, then
 * has, from column p on, passive velocities per rate (p, n), which are -J_Cp^+ J_Ca, then J_Cp^+
 * (p, c); and below, for orthonormal rows Z with Z J_Cp = 0, Z J_Ca (c - p, n), then Z (c - p, c);
 * its last row is room. Returns |J_Cp^-1|, in the Frobenius norm, on the range of J_Cp: the least
 * singular value is at least its inverse. It is infinite where columns are dependent; then, and
 * where it is too large, the numbers mean nothing. c is at least p. */
double close_loops(const double *J_C, int c, int N, const int64_t *order, int p, int n,
                   bool closing, double *M);

/* Write J = J_Ta + J_Tp gain, eq. (14), (m, n), of J_T (m, N), gain (p, n) in rows of so many
 * numbers, and return the size of the two terms. */
double reduce_task(const double *J_T, int m, int N, const int64_t *order, int p, int n,
                   const double *gain, int width, double *J);

/* A mechanism of N velocities, of which n are active; rows (N, N) whose squares are the energy of
 * its springs, or nothing. */
typedef struct {
    int N, n;
    const int64_t *active;
    const double *springs;
} drives_model;

/* Write the motion (N) that closes the loops, J_C (c, N) motion = -gaps, of which those beyond g
 * are zero; then takes the active velocities `held` (h) from displacements (n) to those wanted; then
 * moves as the springs have it, and least. What contradicts itself is met with least error. */
enum { MOTION_SOLVED, MOTION_NONE, MOTION_INVALID }; /* nothing is to move; no such distinct ones */
int nearest_room(int c, int h, int s, int N);
int nearest_motion(const drives_model *of, int c, const double *J_C, int g, const double *gaps,
                   int h, const int64_t *held, const double *wanted, const double *displacements,
                   double *room, double *motion);

/* Write the bases of prioritized.canonical_basis to zeros, (count, N, k). Overwrites orthonormal
 * columns, of which zero ones come last then, (count, N, k); room for a vector (k). */
void canonical_bases(int count, int N, int k, double *rest, double *made, double *along);

/* tick.c */

/* Levels of rows S J rates + R rates that are to be T targets, whatever the pose, then least
 * |weight (rates - wanted)|, which may be beside the last level; all of it in natural units. */
typedef struct {
    int m, c, N, t;       /* rows of J_T, of J_C, columns of both, targets of all levels */
    int p, n;             /* passive velocities that move, rates */
    int idles;            /* passive velocities at rest: neither loops nor task know them */
    int k, levels;        /* rows of all levels, levels */
    int d, e;             /* directions of the task in a level beside the norm, and its rows */
    const int64_t *order; /* indices of the p velocities and the n rates, (p + n) */
    const int64_t *idle;  /* indices, (idles) */
    const double *S;      /* (k, m) */
    const double *R;      /* (k, n), or nothing */
    const double *D;      /* (d, m) */
    const double *T;      /* of the rows and of wanted rates, (k + n, t) */
    const double *weight;   /* (n,), or nothing: |rates| is least, and T has k rows */
    const double *damping;  /* of each level, (levels,), or nothing */
    const double *sizes;    /* 2-norm of S of each level, then of S and D, (levels + 1,) */
    const double *on_rates; /* of R of each level, times the part that is in doubt, (levels,) */
    const int32_t *ends;    /* of each level in S, (levels,) */
    double error_C, error_T; /* size of the errors of J_C and J_T per bound of them */
    double doubt; /* part of J_C and of J up to which a singular value is in doubt */
    const double *task_units, *loop_units, *velocity_units; /* natural ones, (m), (c), (N) */
} tick_plan;

/* All solved; ranks are in doubt, or limits and loops contradict each other; a number is wrong. */
enum { TICK_SOLVED, TICK_IN_DOUBT, TICK_REFUSED };

/* Write all velocities x (N), zero where stuck or idle, from J_T (m, N), J_C (c, N), targets (t),
 * limits of all velocities (N), which do not matter where stuck, and a bound of the errors of the
 * entries of J_T and J_C in natural units. All levels but the first are asked for the motion of the
 * task with rates `along` (n) besides; NULL is none. */
enum { TICK_OWN_ROOM = 4096 }; /* NULL will do for so many numbers */
int tick_room(const tick_plan *plan);
int tick_solve(const tick_plan *plan, const double *J_T, const double *J_C, const double *targets,
               const double *along, const double *lower, const double *upper, double bound,
               double *x, double *room);

/* lexicographic.c */

/* Unknowns at their bounds. */
enum { LEXICOGRAPHIC_LOWER = -1, LEXICOGRAPHIC_FREE = 0, LEXICOGRAPHIC_UPPER = 1 };

/* Minimize |A_k x - b_k|, level by level, then |weight (x - wanted)|, within lower <= x <= upper. */
typedef struct {
    int count;             /* problems of one shape */
    int n, levels;         /* unknowns, levels */
    int matrices, bounds;  /* A, and pairs of bounds: one for all problems, or as many as these */
    int most_steps;        /* of the active set, for each problem */
    bool warm;             /* whether x and state are an earlier solution, to start from */
    bool beside;           /* whether that norm is added to the last level, not after it */
    double tolerance;      /* part of a level's scale up to which singular values are zero */
    const int32_t *ends;   /* where each level ends in the rows of all, (levels,) */
    const double *damping; /* of each level in what it determines, (levels,); or nothing */
    const double *weight;  /* (n,), not below zero, then |x| is least at last; or nothing: |x| */
} lexicographic_problem;

/* Numbers that `room` must have; NULL will do for OWN_ROOM. */
enum { OWN_ROOM = 1024 };
int64_t lexicographic_room(const lexicographic_problem *p);

/* Solve a batch, one problem after another: A (matrices, rows, n), b (count, rows), scales
 * (matrices, levels), the size of what each level was made of, or nothing: its norm; limits
 * (bounds, 2, n), lower and upper; with weights wanted (count, n); x and state (count, n). Writes
 * a report (count, 4) of each problem: steps of the active set; 1 if every level came to an end
 * within them, -1 if numbers are not finite, too large, or too small for a norm; the smallest gap of
 * the rank decisions without bounds, and of those beside active ones. Writes the ranks (count,
 * levels) after a cold start, without bounds, of all levels but one beside the norm, unless NULL is
 * given. */
void lexicographic_solve(const lexicographic_problem *p, const double *A, const double *b,
                         const double *scales, const double *limits, const double *wanted,
                         double *room, double *x, int8_t *state, double *report, int32_t *ranks);

/* problem1.c */

/* Problem 1 of the paper: minimize |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2 at v_m, within
 * limits, then |rates|; W1, W2 diagonal. */
typedef struct {
    int count, jacobians;  /* targets; Jacobians, one for all of them or one for each */
    int m, n, m1, m2;      /* task rows, rates, major and secondary directions */
    bool joint, secondary; /* whether there is W1, and W2 */
    double tolerance;
    double clear;          /* part of the size up to which a major singular value is in doubt */
    const double *S;       /* major, then secondary directions, (m1 + m2, m) */
} problem1;

/* All solved; a major direction may be out of reach, where `clear` is not zero, or the active set
 * did not come to an end; a number is not finite or too large. */
enum { PROBLEM1_SOLVED, PROBLEM1_IN_DOUBT, PROBLEM1_REFUSED };

/* Write the rates x (count, n): J (jacobians, m, n) and the sizes against which ranks are decided
 * (jacobians), or nothing for their norms, diagonals w1 (n) and w2 (m2), targets v (count, m1),
 * rates_d (count, n) and v_s (count, m2), which may be nothing, limits (2, n) or nothing. */
int64_t problem1_room(const problem1 *p);
/* Whether no product of J and weights over- or underflows, unless they are zero. */
bool problem1_fits(const problem1 *p, const double *J, const double *w1, const double *w2);
int problem1_solve(const problem1 *p, const double *J, const double *sizes, const double *w1,
                   const double *w2, const double *v, const double *rates_d, const double *v_s,
                   const double *limits, double *room, double *x);

/* struts.c: the hexapod */

/* Nodes of the struts at the nominal pose, (6, 3) each, and their lengths there, (6). */
typedef struct {
    const double *bottom_m, *top_m, *nominal_length_m;
} strut_nodes;

/* What follow finds. */
enum { FOLLOWED, SINGULAR, NO_LENGTH };

/* Write lengths (6) and A (6, 6) in l_dot = A x_dot at as many poses; of a strut without length NaN.
 * Returns whether all have one. */
bool strut_lengths(const strut_nodes *nodes, int poses, const double *R, const double *t,
                   double *lengths, double *A);
/* Overwrite b (6) by the solution of A x = b, if A (6, 6) is not singular; returns that. */
bool strut_twist(const double *A, double *b);
/* One Newton step on the strut lengths, from displacements `moved` (6) to those asked, where
 * displacements are lengths less the nominal ones; the last four arguments are overwritten. */
int follow(const strut_nodes *nodes, const double *R, const double *t, const double *A,
           const double *moved, const double *asked, double *R_new, double *t_new, double *A_new,
           double *moved_new);

#endif
