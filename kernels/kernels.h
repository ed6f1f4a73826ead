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

#endif
