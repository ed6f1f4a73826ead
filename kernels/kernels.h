/* Compiled kernels of the per-tick computations.
 *
 * Plain C99 on numbers and arrays: no allocation, no globals, no input or output, no library but
 * libm. Matrices are dense and row-major; a pointer without a size in its comment is a vector of
 * the size that the comment names. Non-const arrays are outputs. The workspace `work` is an
 * argument, with the number of doubles stated. kernels/__init__.py parses this file.
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

/* Write states (steps + 1, n) of x' = A x + source for sources (steps, n); the first state is
 * given. */
void recur(int n, int64_t steps, const double *A, const double *sources, double *states);

/* friction.c */

/* Physics steps of models with dry friction: s states, r friction contacts, n inputs, p outputs.
 * Arrays of several models are stacked. The fields are those of ftc.fdi.fault_model.DryFriction. */
typedef struct {
    int s, r, n, p, steps_a_tick;
    const double *A, *B, *G, *E, *D, *K, *limit, *C;
} friction_model;

/* Advance states X (states, s) of one model by a control tick with inputs U (states, n + 1). In
 * each step the friction forces f minimize f'K f / 2 + f'c within their limits, by projected
 * Gauss-Seidel, and x' = A x + B u + G f. Workspace: 2 s + 3 r. */
void slide(const friction_model *of, int states, const double *U, double *work, double *X);

/* Add friction to samples of `ticks` ticks computed without it, for H models and N onsets.
 *
 * `before` and X (H, N, rows, s) are the states before and after the sample, `outputs` (H, N, rows,
 * p) its outputs: of the model in the first row, first-order deviations in the others. With a
 * `spread`, row `first` + k is the effect of reducing limit k by this fraction. `lifted` (H, s, s)
 * is the state transition without friction. The first n entries of v are used. Workspace: r for
 * `stuck`, sliding_room for `work`. */
int sliding_room(const friction_model *of, int ticks);
void slide_samples(const friction_model *all, int H, int N, int rows, const bool *steps,
                   const double *before, const double *v, const double *lifted, int ticks,
                   int first, double spread, bool *stuck, double *work, double *X, double *outputs);

/* segments.c */

/* Write the Mahalanobis distance (H, E) of each point (H, d) from each segment, starts + t spans
 * (E, d), t in 0..1. The covariance is own (H, d, d) + other (E, d, d); with `one`, that of the
 * first pair for all. Cholesky factors and forward substitution take half the work of a general
 * solver. */
int segments_room(int d);
void to_segments(int H, int E, int d, const double *points, const double *starts,
                 const double *spans, const double *own, const double *other, bool one,
                 double *work, double *distance);

/* detection.c: observer update per sample, for q residuals, J errors, p outputs; k = J + p */

/* Write the root (k, k) of the covariance with the squares of deviations (k) added, by reflections,
 * which leave it lower triangular; workspace: 2 k (k + 1). */
void spread_root(const double *root, const double *deviations, int k, double *work, double *after);

/* State of an observer: memory of residuals and regressors (q, 1 + J, p); mean (k) of the
 * parameters and root (k, k) of their covariance; recent residuals (q, p) and their covariance by
 * lag (q, p). */
typedef struct {
    double *memory, *mean, *root, *recent, *covariance;
} observer_state;

/* Update the state by a sample y (p) and write its innovation: Observer.step.
 *
 * `predicted` (1 + J, p) are the model's outputs and their derivatives by each error, `drift` (k)
 * standard deviations of steps of the parameters, `rate` the weight of this sample in the
 * covariance, `largest` the greatest sum of squares of an innovation that updates the parameters.
 * Returns whether they were updated; if not, only the memory is valid. Workspace: k (2 k + p + 2) +
 * p. */
bool correct(int q, int J, int p, const observer_state *before, const double *predicted,
             const double *y, const double *whitening, const double *drift, double rate,
             double largest, bool learns, double *work, const observer_state *after,
             double *residual);

/* Write the weights (q) of the latest samples, newest first, of the best linear prediction of the
 * next one, by the Levinson-Durbin recursion, from autocovariances (q + 1). */
void predict(const double *covariance, int q, double *weights);

/* Return the window of ResidualTest.alarm, or 0 without an alarm, for M residuals and the carrier
 * `swing` (M, 2), which is NULL without a dither; workspace: 3 p. */
int alarming(int M, int p, const double *recent, const double *swing, int shortest,
             double threshold, double demodulated_threshold, double *work);

/* evidence.c: H hypotheses and K onsets; those with `steps` (H, K) are updated */

/* Advance states X (H, K, rows, s) by a sample with inputs v (r) and write its outputs (H, K, rows,
 * p). The input of the last row grows with the age (K) of the onset, in samples. `alone`, `driven`
 * and `spans` are stacked by UncertainModel. Workspace: 2 rows (p + s). */
void advance_models(int H, int K, int rows, int s, int p, int r, const bool *steps,
                    const double *alone, const double *driven, const int64_t *spans,
                    const double *v, const double *age, double *work, double *X, double *outputs);

/* Memory (H, K, q, (5 + J) p) of residuals and regressors; sums of products of R = J + p + 4
 * whitened regressors, lower triangle by rows; of regressors and residuals (H, K, R); and of the
 * residuals (H, K). */
typedef struct {
    double *memory, *information, *score, *energy;
} evidence;

/* Update the memory by a sample y (p), and the sums if it `weighs`; `before` and `after` may be the
 * same.
 *
 * Hypotheses of an onset (K) that `begins` start with the evidence of the first onset, which
 * therefore comes last. `mean` (J + p) is that of the prior; `weights` (2, q, (5 + J) p) of the
 * rows of memory, the second for the last hypothesis; `slopes` (H, K, p) of the fraction lost.
 * Workspace: p (2 J + p + 12).
 */
void weigh_sample(int H, int K, int J, int p, int q, const bool *steps, const bool *begins,
                  bool weighs, const evidence *before, const double *outputs,
                  const double *slopes, const double *y, const double *mean,
                  const double *weights, double *work, const evidence *after);

/* Solve S = 1 + spread' information spread for `count` matrices, by Cholesky.
 *
 * `spread` (R, R) is lower triangular; `solved` (count, R, 3) has the right-hand sides on input,
 * and `log_det` (count) becomes half of log det S. S is at least 1, and so is each of its pivots:
 * smaller ones are rounding errors, also of a large diagonal. Workspace: R (2 R + 1).
 */
void integrate_out(int count, int R, const double *information, const double *spread,
                   double *work, double *solved, double *log_det);

/* rigid.c: poses, detectors, loops */

/* Arrays that the log of a plant is read from and written to: N ticks of n drives. */
typedef struct {
    const double *counts;                               /* factor of a gap of each equality */
    const double *xmat, *xpos, *base_xmat, *R_0, *p_0;  /* as of seen_from */
    int drives, at_joints;           /* n, and how many drives act on joints */
    const int64_t *joints, *places;  /* numbers of these drives, and addresses in qpos */
    const int64_t *others, *outputs; /* numbers of the other drives, and indices in `lengths` */
    const double *gear, *nominal;    /* gears of the other drives, nominal drive positions (n) */
    const double *qpos, *lengths, *forces;
    int logged_qpos, logged_forces; /* numbers of logged values */
    double *rotation, *translation_m, *task, *displacement, *closure_residual_m;
    double *all_qpos, *all_forces;
} observation;

/* Conversion y = gain clip(factor x, lower, upper), with factor x rounded if `whole`. */
typedef struct {
    double factor, lower, upper, gain;
    bool whole;
} conversion;

/* Move `poses` poses R (3, 3), t by displacements [rotation vector; translation]. */
void move(int poses, const double *R, const double *t, const double *twists, double *R_new,
          double *t_new);
/* Write displacements [rotation vector; translation] of `poses` poses; returns the largest angle.
 */
double displacements(int poses, const double *R, const double *t, double *twists);
/* Write [rotation vector; translation] from one pose to another; returns the angle. */
double way(const double *R, const double *p, const double *R_to, const double *p_to, double *twist);
/* Write the motion R, t of a frame at xmat, xpos since its nominal pose, in present base axes:
 * R_now R_nominal^T. R_0 goes from world axes to those of the frame, nominally. */
void seen_from(const double *xmat, const double *xpos, const double *base_xmat, const double *R_0,
               const double *p_0, double *R, double *t);
/* Return the largest gap of the first `rows` rows, each times the factor of its owner. */
double largest_gap(const double *gaps, const int32_t *owners, const double *counts, int rows);
/* Return the largest of the gaps times their units; NaN if one is NaN. */
double largest(const double *gaps, const double *units, int count);
/* Move the rows `points` (count) of J (., velocities), three for each pair of anchors with the gap
 * D, to the midpoints: a joint about an axis (velocities, 6) adds half of D x axis for each body of
 * the pair that it moves; their number is `carried` (count, velocities). */
void at_midpoints(const double *gaps, const double *axes, int velocities, const int64_t *points,
                  int count, const double *carried, double *J);
/* Write tick k of a log; gaps, owners and rows are those of largest_gap. Returns the angle of the
 * pose. */
double observe(const observation *log, int k, const double *gaps, const int32_t *owners, int rows);
/* Write the two angles at which a detector sees a beam along z, from a payload rotated by R. The
 * spot is displaced by noise times deviation, within the detector. */
void spot(const double *R, double focal, double half_width, double deviation, const double *noise,
          double *seen);
/* Convert n numbers x to y; NaN stays NaN. */
void convert(const conversion *by, int n, const double *x, double *y);

/* boxes.c */

/* argument_checks.ties.exceeds for two numbers. */
bool exceeds(double value, double bound, double zero);

/* Return whether two numbers are a lower and an upper limit, infinite if there is none. */
bool are_limits(double lower, double upper);

/* Copy limits (n) to `limits` (2, n); returns whether each lower one is at most the upper one. */
bool copy_limits(int n, const double *lower, const double *upper, double *limits);

/* Write the box (n) of prioritized.viable_rates; `inputs` are positions, rates, lower and upper
 * limits of positions, of rates, and of accelerations, (8, n). Returns whether the arguments are
 * valid; if not, the outputs are not. */
bool viable_box(int n, const double *inputs, double T, double *lower, double *upper, bool *viable);

/* loops.c */

/* Eliminate p passive velocities by reflections of the rows of J_C (c, N); `order` (p + n) has the
 * velocities, passive ones first. M (c + 1, p + n), or with `closing` c columns wider, then has,
 * from column p on, passive velocities per rate (p, n), which are -J_Cp^+ J_Ca, then J_Cp^+ (p, c);
 * and below, for orthonormal rows Z with Z J_Cp = 0, Z J_Ca (c - p, n), then Z (c - p, c); its last
 * row is workspace. Returns |J_Cp^-1|, the Frobenius norm, on the range of J_Cp: the least singular
 * value is at least its inverse. It is infinite if columns are dependent; then, or if it is too
 * large, the outputs are invalid. c is at least p. */
double close_loops(const double *J_C, int c, int N, const int64_t *order, int p, int n,
                   bool closing, double *M);

/* Write J = J_Ta + J_Tp gain, eq. (14), (m, n), for J_T (m, N) and gain (p, n) with rows of `width`
 * numbers, and return the size of the two terms. */
double reduce_task(const double *J_T, int m, int N, const int64_t *order, int p, int n,
                   const double *gain, int width, double *J);

/* Mechanism of N velocities, n of them active; rows (N, N) whose squares are the energy of its
 * springs, or NULL. */
typedef struct {
    int N, n;
    const int64_t *active;
    const double *springs;
} drives_model;

/* Write the motion (N) that first closes the loops, J_C (c, N) motion = -gaps, where gaps beyond
 * the first g are zero; then moves the active velocities `fixed` (h) from displacements (n) to the
 * desired ones; then minimizes the energy of the springs and the norm. Contradictory equations are
 * solved with least error. */
enum { MOTION_SOLVED, MOTION_NONE, MOTION_INVALID }; /* no motion required; invalid numbers */
int nearest_room(int c, int h, int s, int N);
int nearest_motion(const drives_model *of, int c, const double *J_C, int g, const double *gaps,
                   int h, const int64_t *fixed, const double *desired, const double *displacements,
                   double *work, double *motion);

/* Write the bases of prioritized.canonical_basis to zeros, (count, N, k). Overwrites orthonormal
 * columns, zero ones last, (count, N, k); workspace: a vector (k). */
void canonical_bases(int count, int N, int k, double *remaining, double *bases, double *along);

/* tick.c */

/* Levels of rows S J rates + R rates with targets T for any pose, then a minimum of |weight (rates
 * - desired)|, optionally within the last level; all in natural units. */
typedef struct {
    int m, c, N, t;       /* rows of J_T, of J_C, columns of both, targets of all levels */
    int p, n;             /* passive velocities that move, rates */
    int idles;            /* passive velocities at rest, without effect on loops and task */
    int k, levels;        /* rows of all levels, levels */
    int d, e;             /* directions of the task in the level with the norm, and its rows */
    const int64_t *order; /* indices of the p velocities and the n rates, (p + n) */
    const int64_t *idle;  /* indices, (idles) */
    const double *S;      /* (k, m) */
    const double *R;      /* (k, n), or nothing */
    const double *D;      /* (d, m) */
    const double *T;      /* targets of the rows and of the desired rates, (k + n, t) */
    const double *weight;   /* (n,), or nothing: |rates| is least, and T has k rows */
    const double *damping;  /* of each level, (levels,), or nothing */
    const double *sizes;    /* 2-norm of S of each level, then of S and D, (levels + 1,) */
    const double *on_rates; /* of R of each level, times the uncertain fraction, (levels,) */
    const int32_t *ends;    /* of each level in S, (levels,) */
    double error_C, error_T; /* size of the errors of J_C and J_T per bound of them */
    double doubt; /* a singular value up to this fraction of J_C or J may be zero */
    const double *task_units, *loop_units, *velocity_units; /* natural units, (m), (c), (N) */
} tick_plan;

/* Solved; not solved, because a rank is uncertain or limits contradict loops; invalid numbers. */
enum { TICK_SOLVED, TICK_IN_DOUBT, TICK_REFUSED };

/* Write all velocities x (N), zero if stuck or idle, from J_T (m, N), J_C (c, N), targets (t),
 * limits of all velocities (N), which have no effect on stuck ones, and a bound of the errors of
 * the entries of J_T and J_C in natural units. The task motion of the rates `along` (n) is added to
 * the targets of all levels but the first; NULL adds none. */
enum { TICK_OWN_ROOM = 4096 }; /* room may be NULL up to this number */
int tick_room(const tick_plan *plan);
int tick_solve(const tick_plan *plan, const double *J_T, const double *J_C, const double *targets,
               const double *along, const double *lower, const double *upper, double bound,
               double *x, double *work);

/* lexicographic.c */

/* States of unknowns: at a bound or free. */
enum { LEXICOGRAPHIC_LOWER = -1, LEXICOGRAPHIC_FREE = 0, LEXICOGRAPHIC_UPPER = 1 };

/* Minimize |A_k x - b_k|, level by level, then |weight (x - desired)|, for lower <= x <= upper. */
typedef struct {
    int count;             /* problems of one shape */
    int n, levels;         /* unknowns, levels */
    int matrices, bounds;  /* A, and pairs of bounds: one for all problems, or as many as these */
    int most_steps;        /* bound on the steps of the active set, for each problem */
    bool warm;             /* whether x and state are an initial solution */
    bool beside;           /* whether the norm is added to the last level, not after it */
    double tolerance;      /* fraction of a level's scale up to which singular values are zero */
    const int32_t *ends;   /* end of each level in the rows of all, (levels,) */
    const double *damping; /* of each level in the directions it determines, (levels,); or NULL */
    const double *weight;  /* (n,), not negative, then |x| breaks ties; or NULL: |x| */
} lexicographic_problem;

/* Size that `work` must have; NULL is allowed up to OWN_ROOM. */
enum { OWN_ROOM = 1024 };
int64_t lexicographic_room(const lexicographic_problem *p);

/* Solve a batch of problems: A (matrices, rows, n), b (count, rows), scales (matrices, levels), the
 * size of the matrices that each level was computed from, or NULL for its norm; limits (bounds, 2,
 * n), lower and upper; with weights desired (count, n); x and state (count, n). Writes a report
 * (count, 4) of each problem: steps of the active set; 1 if every level was solved within them, -1
 * if numbers are not finite, too large, or too small for a norm; the smallest gap of the rank
 * decisions without bounds, and of those with active bounds. Writes the ranks (count, levels) after
 * a cold start, without bounds, of all levels but one with the norm, unless NULL is given. */
void lexicographic_solve(const lexicographic_problem *p, const double *A, const double *b,
                         const double *scales, const double *limits, const double *desired,
                         double *work, double *x, int8_t *state, double *report, int32_t *ranks);

/* problem1.c */

/* Problem 1 of the paper: minimize |W1 (rates - rates_d)|^2 + |W2 (v_s - v_sd)|^2 at v_m, within
 * limits, then |rates|; W1, W2 diagonal. */
typedef struct {
    int count, jacobians;  /* targets; Jacobians, one for all of them or one for each */
    int m, n, m1, m2;      /* task rows, rates, major and secondary directions */
    bool joint, secondary; /* whether W1 and W2 are given */
    double tolerance;
    double clear;          /* fraction of the size up to which a major singular value may be zero */
    const double *S;       /* major, then secondary directions, (m1 + m2, m) */
} problem1;

/* Solved; not solved, because a major direction may be unreachable (if `clear` is not zero) or the
 * active set did not converge; a number is not finite or too large. */
enum { PROBLEM1_SOLVED, PROBLEM1_IN_DOUBT, PROBLEM1_REFUSED };

/* Write the rates x (count, n) for J (jacobians, m, n), the sizes against which ranks are decided
 * (jacobians), or NULL for their norms, diagonals w1 (n) and w2 (m2), targets v (count, m1),
 * rates_d (count, n) and v_s (count, m2), which may be NULL, limits (2, n) or NULL. */
int64_t problem1_room(const problem1 *p);
/* Return whether no product of J and weights over- or underflows; zeros are allowed. */
bool problem1_fits(const problem1 *p, const double *J, const double *w1, const double *w2);
int problem1_solve(const problem1 *p, const double *J, const double *sizes, const double *w1,
                   const double *w2, const double *v, const double *rates_d, const double *v_s,
                   const double *limits, double *work, double *x);

/* struts.c: kinematics of the hexapod */

/* Nodes of the struts at the nominal pose, (6, 3) each, and their lengths there, (6). */
typedef struct {
    const double *bottom_m, *top_m, *nominal_length_m;
} strut_nodes;

/* Result of follow. */
enum { FOLLOWED, SINGULAR, NO_LENGTH };

/* Write lengths (6) and A (6, 6) in l_dot = A x_dot at `poses` poses, NaN for a strut of length
 * zero. Returns whether no strut has length zero. */
bool strut_lengths(const strut_nodes *nodes, int poses, const double *R, const double *t,
                   double *lengths, double *A);
/* Overwrite b (6) by the solution of A x = b, if A (6, 6) is not singular; returns whether it is
 * not. */
bool strut_twist(const double *A, double *b);
/* Make one Newton step on the strut lengths, from displacements `moved` (6) to the requested ones,
 * where displacements are lengths minus the nominal ones; the last four arguments are outputs. */
int follow(const strut_nodes *nodes, const double *R, const double *t, const double *A,
           const double *moved, const double *target, double *R_new, double *t_new, double *A_new,
           double *moved_new);

#endif
