/* Problem 1 of the paper for diagonal weights, from Jacobians to rates; see kernels.h. */
#include <math.h>
#include <string.h>
#include "kernels.h"
#include "numerics.h"

/* Square of the largest number that the argument checks accept. */
static const double LARGEST = 1e240;

static double squares(const double *a, int64_t count)
{
    return dot(a, a, count);
}

/* Levels: the major rows, then the secondary ones if they have weights. */
static lexicographic_problem levels_of(const problem1 *p, int32_t *ends, const double *weight)
{
    bool two = p->m2 > 0 && p->secondary;
    ends[0] = p->m1;
    ends[1] = p->m1 + p->m2;
    return (lexicographic_problem){.count = 1, .n = p->n, .levels = two ? 2 : 1, .matrices = 1,
                                   .bounds = 1, .most_steps = 60 * (p->n + 1),
                                   .beside = two && weight,
                                   .tolerance = p->tolerance, .ends = ends, .weight = weight};
}

int64_t problem1_room(const problem1 *p)
{
    int32_t ends[2];
    double one = 1.0;
    lexicographic_problem q = levels_of(p, ends, p->joint ? &one : 0);
    int64_t n = p->n, rows = p->m1 + p->m2;
    return rows * (n + 1) + 6 * n + 2 + lexicographic_room(&q);
}

bool problem1_fits(const problem1 *p, const double *J, const double *w1, const double *w2)
{
    int64_t numbers = (int64_t)p->jacobians * p->m * p->n;
    return is_moderate(squares(J, numbers)) && (!p->joint || is_moderate(squares(w1, p->n))) &&
           (!p->secondary || is_moderate(squares(w2, p->m2)));
}

/* Write the rows of the levels for a Jacobian to A, and their targets to b. */
static void write_levels(const problem1 *p, const double *J, const double *w2, const double *v,
                         const double *v_s, double *A, double *b)
{
    int64_t m = p->m, n = p->n, m1 = p->m1, rows = m1 + (p->secondary ? p->m2 : 0);
    for (int64_t i = 0; i < rows; i++) {
        double *row = A + i * n, factor = i < m1 ? 1.0 : w2[i - m1];
        memset(row, 0, (size_t)n * sizeof *row);
        for (int64_t t = 0; t < m; t++) {
            double part = factor * p->S[i * m + t];
            for (int64_t j = 0; j < n && part != 0.0; j++)
                row[j] += part * J[t * n + j];
        }
        b[i] = i < m1 ? v[i] : v_s ? factor * v_s[i - m1] : 0.0;
    }
}

int problem1_solve(const problem1 *p, const double *J, const double *sizes, const double *w1,
                   const double *w2, const double *v, const double *rates_d, const double *v_s,
                   const double *limits, double *work, double *x)
{
    int64_t n = p->n, m = p->m, m1 = p->m1, m2 = p->secondary ? p->m2 : 0;
    double own[OWN_ROOM], *A = work ? work : own, *b = A + (m1 + p->m2) * n;
    double *weight = b + m1 + p->m2, *goal = weight + n;
    double *lower = goal + n, *upper = lower + n, *scales = upper + n, secondary = 0.0, report[4];
    int8_t *state = (int8_t *)(scales + 2);
    int32_t ends[2], ranks[2];
    int code = PROBLEM1_SOLVED;
    lexicographic_problem q = levels_of(p, ends, p->joint ? weight : 0);
    double targets = squares(v, p->count * m1) + (rates_d ? squares(rates_d, p->count * n) : 0.0);
    targets += v_s && m2 ? squares(v_s, p->count * m2) : 0.0;
    double factors = squares(J, p->jacobians * m * n) + (p->joint ? squares(w1, n) : 0.0);
    if (!(targets < LARGEST && factors + (m2 ? squares(w2, m2) : 0.0) < LARGEST))
        return PROBLEM1_REFUSED;
    for (int64_t i = 0; i < m2; i++)
        secondary += w2[i] * w2[i] * squares(p->S + (m1 + i) * m, m);
    for (int64_t j = 0; j < n; j++) {
        weight[j] = p->joint ? fabs(w1[j]) : 1.0;
        lower[j] = limits ? limits[j] : -INFINITY;
        upper[j] = limits ? limits[n + j] : INFINITY;
    }
    for (int64_t k = 0; k < p->count; k++) {
        const double *each = J + k % p->jacobians * m * n;
        double size = sizes ? sizes[k % p->jacobians] : sqrt(squares(each, m * n));
        scales[0] = sqrt(squares(p->S, m1 * m)) * size;
        scales[1] = sqrt(secondary) * size;
        write_levels(p, each, w2, v + k * m1, v_s ? v_s + k * m2 : 0, A, b);
        for (int64_t j = 0; j < n; j++)
            goal[j] = rates_d ? rates_d[k * n + j] : 0.0;
        ranks[0] = 0;
        lexicographic_solve(&q, A, b, scales, lower, goal, scales + 2 + n, x + k * n, state,
                            report, ranks);
        if (report[1] < 0.0) /* products with weights are too large */
            return PROBLEM1_REFUSED;
        bool clear = ranks[0] == m1 && report[2] * p->tolerance > p->clear;
        if (!report[1] || (p->clear > 0.0 && !clear))
            code = PROBLEM1_IN_DOUBT;
    }
    return code;
}
