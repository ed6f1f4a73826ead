/* What the solver's files share: products of rows, and every number that decides.
 *
 * docs/theory.md says where each comes from.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* A function that is also compiled for wider registers, and taken where the processor has them: the
 * same sums in the same order, hence the same bits. Loaders of other systems cannot choose, and
 * sanitizers must not run before the choice. */
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

/* Part of what rows were made from below which their singular values are zero: RANK_TOLERANCE. */
static const double RANK = 1e-10;
/* Part of what a number is computed from that may be round-off; a tenth of it is, alone. */
static const double ROUND_OFF = 1e-14;
/* Part by which equal numbers may differ: ACCURACY in argument_checks/ties.py. */
static const double ACCURACY = 1e-9;
/* Where this part of a number is left of its terms, their round-off asks for another pass. */
static const double CANCELLED = 1e-3;
/* Ratio of weights up to which unknowns are measured in parts of them without loss of digits. */
static const double MEASURED = 1e4;
/* Factor by which every rank of a tick must be clear of what is in doubt. */
static const double CLEAR = 1e3;
/* The same beside active limits, where what is left of a level may be smaller. */
static const double DECIDED = 10.0;
/* Of bounds of errors, which are of first order. */
static const double MARGIN = 2.0;

/* Sum of squares up to which, and from the inverse of which on, no product over- or underflows. */
static const double MODERATE = 1e100;

static inline bool is_moderate(double square)
{
    return 1.0 / MODERATE < square && square < MODERATE;
}

static inline double dot(const double *a, const double *b, int64_t count)
{
    double sums[4] = {0.0, 0.0, 0.0, 0.0}; /* that compilers add side by side */
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
