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

/* friction.c */

/* segments.c */

/* detection.c */

/* evidence.c */

/* rigid.c: poses, detectors, loops */

/* struts.c: the hexapod */

/* boxes.c */

/* closing.c */

/* single.c */

/* Of a problem: major directions, task rows, rates, rows of W1, of W2, secondary directions. */
typedef struct {
    int p, m, n, k1, k2, m2;
} single_sizes;

/* Factors and solution in one call: single.c. S_m (p, m), S_s (m2, m), J (m, n), W1 (k1, n), W2
 * (k2, m2); F has room for single_room(sizes) numbers. Returns CLEAR, IN_DOUBT or REFUSED. */
int single_room(single_sizes sizes);
int single_solve(single_sizes sizes, const double *J, const double *S_m, const double *S_s,
                 const double *W1, const double *W2, double scale, double clear, double exact,
                 const double *v, const double *rates_d, const double *v_sd, double *F, double *x);

/* batch.c */

/* regular.c */

/* lexicographic.c */

/* Unknowns at their bounds, and what to start from. */
enum { LEXICOGRAPHIC_LOWER = -1, LEXICOGRAPHIC_FREE = 0, LEXICOGRAPHIC_UPPER = 1 };
enum { LEXICOGRAPHIC_COLD, LEXICOGRAPHIC_FROM_OPTIMUM, LEXICOGRAPHIC_WARM };

/* Minimize |A_k x - b_k|, level by level, then |weight (x - wanted)|, within lower <= x <= upper. */
typedef struct {
    int count;             /* problems of one shape */
    int n, levels;         /* unknowns, levels */
    int matrices, bounds;  /* A, and pairs of bounds: one for all problems, or as many as these */
    int start;             /* nothing, the optima without bounds, or an earlier solution */
    int most_steps;        /* of the active set, for each problem */
    bool beside;           /* whether that norm is added to the last level, not after it */
    double tolerance;      /* part of a level's scale up to which singular values are zero */
    const int32_t *ends;   /* where each level ends in the rows of all, (levels,) */
    const double *damping; /* of each level in what it determines, (levels,); or nothing */
    const double *weight;  /* (n,), not below zero, then |x| is least at last; or nothing: |x| */
} lexicographic_problem;

/* Numbers that `room` must have. */
int64_t lexicographic_room(const lexicographic_problem *p);

/* Solve a batch, one problem after another: A (matrices, rows, n), b (count, rows), scales
 * (matrices, levels), the size of what each level was made of; bounds (bounds, n); with weights
 * wanted (count, n); x and state (count, n), which are the start, too. Writes of each problem the
 * steps of the active set, whether every level came to an end within them, and the smallest gap of
 * the rank decisions. */
void lexicographic_solve(const lexicographic_problem *p, const double *A, const double *b,
                         const double *scales, const double *lower, const double *upper,
                         const double *wanted, double *room, double *x, int8_t *state,
                         int64_t *steps, bool *ended, double *gap);

#endif
