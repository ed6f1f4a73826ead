/* Elimination of passive velocities, and bases of null spaces. */
#include <math.h>
#include <string.h>
#include "kernels.h"
#include "numerics.h"

/* Zero column k of M (rows + 1, width) below row k by a reflection, whose vector replaces this
 * column; the last row is workspace. Returns whether it was not zero already. */
static bool clear_below(double *M, int rows, int width, int k)
{
    int own = k, count = width - k;
    double square = 0.0, *top = M + k * width + k, *work = M + rows * width + k;
    while (own < rows && M[own * width + k] == 0.0)
        own++;
    if (k < own && own < rows) /* rows of other loops are unchanged */
        for (int j = 0; j < count; j++) {
            double kept = top[j];
            top[j] = M[own * width + k + j];
            M[own * width + k + j] = kept;
        }
    for (int i = k; i < rows; i++)
        square += M[i * width + k] * M[i * width + k];
    double norm = sqrt(square), diagonal = top[0] >= 0.0 ? -norm : norm;
    if (!(norm > 0.0))
        return false;
    top[0] -= diagonal;
    memset(work + 1, 0, (size_t)(count - 1) * sizeof *work);
    for (int i = k; i < rows; i++)
        add(work + 1, M[i * width + k], M + i * width + k + 1, count - 1);
    for (int i = k; i < rows; i++)
        add(M + i * width + k + 1, M[i * width + k] / (norm * -fabs(top[0])), work + 1, count - 1);
    top[0] = diagonal;
    return true;
}

/* Return the Frobenius norm of the inverse of the triangle in M's first rows; x (count) is
 * workspace. */
static double inverse_norm(const double *M, int width, int count, double *x)
{
    double total = 0.0;
    for (int k = 0; k < count; k++) {
        for (int i = k; i < count; i++)
            x[i] = i == k ? 1.0 : 0.0;
        for (int i = k; i < count; i++)
            if (x[i] != 0.0) { /* loops share few joints */
                x[i] /= M[i * width + i];
                total += x[i] * x[i];
                for (int j = i + 1; j < count; j++)
                    x[j] -= x[i] * M[i * width + j];
            }
    }
    return sqrt(total);
}

double close_loops(const double *J_C, int c, int N, const int64_t *order, int p, int n,
                   bool closing, double *M)
{
    int width = p + n + (closing ? c : 0);
    for (int i = 0; i < c; i++) {
        double *own = M + i * width;
        for (int j = 0; j < p + n; j++)
            own[j] = J_C[i * N + order[j]];
        for (int j = p + n; j < width; j++)
            own[j] = i == j - p - n ? 1.0 : 0.0;
    }
    for (int k = 0; k < p; k++)
        if (!clear_below(M, c, width, k))
            return INFINITY;
    for (int i = p - 1; i >= 0; i--) {
        double *own = M + i * width;
        for (int k = i + 1; k < p; k++)
            add(own + p, -own[k], M + k * width + p, width - p);
        for (int j = p; j < width; j++)
            own[j] /= own[i];
    }
    for (int i = 0; i < p; i++)
        for (int j = p; j < p + n; j++)
            M[i * width + j] = -M[i * width + j];
    return inverse_norm(M, width, p, M + c * width);
}

double reduce_task(const double *J_T, int m, int N, const int64_t *order, int p, int n,
                   const double *gain, int width, double *J)
{
    double through = 0.0, size = 0.0;
    for (int t = 0; t < m; t++)
        for (int j = 0; j < n; j++)
            J[t * n + j] = J_T[t * N + order[p + j]];
    for (int k = 0; k < p; k++) {
        const double *follow = gain + k * width;
        double column = 0.0, follows = 0.0;
        for (int j = 0; j < n; j++)
            follows += follow[j] * follow[j];
        for (int t = 0; t < m; t++) {
            double moved = J_T[t * N + order[k]];
            column += moved * moved;
            add(J + t * n, moved, follow, n);
        }
        /* A fast passive joint contributes to the size only if it moves the task. */
        through += column * follows;
    }
    for (int i = 0; i < m * N; i++)
        size += J_T[i] * J_T[i];
    return sqrt(size) + sqrt(through);
}

void canonical_bases(int count, int N, int k, double *remaining, double *bases, double *along)
{
    for (int b = 0; b < count; b++, remaining += N * k, bases += N * k)
        for (int t = 0; t < k; t++) {
            int pivot = 0;
            double most = 0.0, left = 0.0;
            for (int i = 0; i < N; i++) {
                double size = 0.0;
                for (int j = 0; j < k; j++)
                    size += remaining[i * k + j] * remaining[i * k + j];
                left += size;
                if (size > most * (1.0 + ACCURACY)) {
                    pivot = i;
                    most = size;
                }
            }
            if (left < 0.5) /* its square norm is the remaining dimension */
                break;
            for (int j = 0; j < k; j++)
                along[j] = remaining[pivot * k + j] / sqrt(most);
            for (int i = 0; i < N; i++) {
                double part = 0.0;
                for (int j = 0; j < k; j++)
                    part += remaining[i * k + j] * along[j];
                bases[i * k + t] = part;
                for (int j = 0; j < k; j++)
                    remaining[i * k + j] -= part * along[j];
            }
        }
}

/* Levels of a motion: loops, fixed drives, springs, if there are any. */
static lexicographic_problem motion_levels(int c, int h, int s, int N, int32_t *ends)
{
    int rows[] = {c, h, s}, levels = 0, end = 0;
    for (int k = 0; k < 3; k++)
        if (rows[k])
            ends[levels++] = end += rows[k];
    return (lexicographic_problem){.count = 1, .n = N, .levels = levels, .matrices = 1,
                                   .bounds = 1, .most_steps = 1, .tolerance = RANK, .ends = ends};
}

int nearest_room(int c, int h, int s, int N)
{
    int32_t ends[3];
    lexicographic_problem p = motion_levels(c, h, s, N, ends);
    return (c + h + s) * (N + 1) + 3 * N + (int)lexicographic_room(&p);
}

int nearest_motion(const drives_model *of, int c, const double *J_C, int g, const double *gaps,
                   int h, const int64_t *fixed, const double *desired, const double *displacements,
                   double *work, double *motion)
{
    int N = of->N, s = of->springs ? N : 0, rows = c + h + s;
    double *A = work, *b = A + rows * N, *limits = b + rows, report[4];
    int32_t ends[3];
    bool is_there = true;
    for (int i = 0; i < h; i++) {
        if (fixed[i] < 0 || fixed[i] >= of->n)
            return MOTION_INVALID;
        for (int j = 0; j < i; j++)
            if (fixed[i] == fixed[j])
                return MOTION_INVALID;
    }
    if (!c && !s) { /* drives are independent */
        memset(motion, 0, (size_t)N * sizeof *motion);
        for (int i = 0; i < h; i++) {
            motion[of->active[fixed[i]]] = desired[fixed[i]] - displacements[fixed[i]];
            is_there = is_there && desired[fixed[i]] == displacements[fixed[i]];
        }
        return is_there ? MOTION_NONE : MOTION_SOLVED;
    }
    memset(work, 0, (size_t)(rows * (N + 1)) * sizeof *work);
    memcpy(A, J_C, (size_t)(c * N) * sizeof *A);
    for (int i = 0; i < g; i++)
        b[i] = -gaps[i];
    for (int i = 0; i < h; i++) {
        A[(c + i) * N + of->active[fixed[i]]] = 1.0;
        b[c + i] = desired[fixed[i]] - displacements[fixed[i]];
    }
    if (s)
        memcpy(A + (c + h) * N, of->springs, (size_t)(N * N) * sizeof *A);
    for (int i = 0; i < c + h; i++)
        is_there = is_there && b[i] == 0.0;
    if (is_there)
        return MOTION_NONE;
    for (int j = 0; j < N; j++) {
        limits[j] = -INFINITY;
        limits[N + j] = INFINITY;
    }
    lexicographic_problem p = motion_levels(c, h, s, N, ends);
    lexicographic_solve(&p, A, b, 0, limits, 0, limits + 3 * N, motion,
                        (int8_t *)(limits + 2 * N), report, 0);
    return MOTION_SOLVED;
}
