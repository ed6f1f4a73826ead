/* Functions shared by the solver's files, and all numerical thresholds.
 *
 * docs/theory.md derives each threshold.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* Compiles a function for wider registers as well, used if the processor has them: the sums have
 * the same order, hence identical bits. Other loaders do not support this, and sanitizers must not
 * run before the selection. */
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__) \
    && !defined(__SANITIZE_ADDRESS__)
#define WIDE __attribute__((target_clones("default", "avx2")))
#else
#define WIDE
#endif
#ifdef __GNUC__
#define INLINED static inline __attribute__((always_inline))
#else
#define INLINED static inline
#endif

/* Fraction of the scale of rows below which singular values are zero: RANK_TOLERANCE. */
static const double RANK = 1e-10;
/* Fraction of the terms of a number that may be round-off; a tenth of it always is. */
static const double ROUND_OFF = 1e-14;
/* Relative difference up to which numbers are equal: ACCURACY in argument_checks/ties.py. */
static const double ACCURACY = 1e-9;
/* Cancellation threshold: a number reduced to this fraction of its terms is recomputed. */
static const double CANCELLED = 1e-3;
/* Ratio of weights up to which unknowns can be scaled by them without loss of digits. */
static const double MEASURED = 1e4;
/* Least gap of every rank decision of a tick. */
static const double CLEAR = 1e3;
/* Least gap with active limits, where the remaining part of a level may be smaller. */
static const double DECIDED = 10.0;
/* Factor on error bounds, which are of first order. */
static const double MARGIN = 2.0;

/* Greatest sum of squares (and inverse of the least) without over- or underflow of products. */
static const double MODERATE = 1e100;

static inline bool is_moderate(double square)
{
    return 1.0 / MODERATE < square && square < MODERATE;
}

static inline double dot(const double *a, const double *b, int64_t count)
{
    double sums[4] = {0.0, 0.0, 0.0, 0.0}; /* four sums, which compilers vectorize */
    int64_t j = 0;
    for (; j + 4 <= count; j += 4)
        for (int64_t e = 0; e < 4; e++)
            sums[e] += a[j + e] * b[j + e];
    for (; j < count; j++)
        sums[0] += a[j] * b[j];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* Add a multiple of one row to another. */
static inline void add(double *restrict a, double factor, const double *restrict b, int64_t count)
{
    if (factor != 0.0)
        for (int64_t j = 0; j < count; j++)
            a[j] += factor * b[j];
}
