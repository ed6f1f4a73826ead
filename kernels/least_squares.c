/* Least squares of any rank: pivoted reflections, then the solution of least norm. */
#include <math.h>
#include <string.h>
#include "kernels.h"
#include "numerics.h"

/* Part of the first pivot below which columns are dependent. */
static const double DEPENDENT = 1e-10;

/* The column from k on whose rest below row k is largest, and the square of that. */
static int pivot_of(const double *M, int m, int n, int k, double *squares, double *largest_square)
{
    int best = k;
    memset(squares + k, 0, (size_t)(n - k) * sizeof *squares);
    for (int i = k; i < m; i++)
        for (int j = k; j < n; j++)
            squares[j] += M[i * (n + 1) + j] * M[i * (n + 1) + j];
    for (int j = k + 1; j < n; j++)
        if (squares[j] > squares[best])
            best = j;
    *largest_square = squares[best];
    return best;
}

/* Zero column k of M (m, w) below row k by a reflection; `along` (w) is room. */
static void reflect_rows(double *M, int m, int w, int k, double norm, double *along)
{
    double *own = M + k * w, diagonal = own[k] >= 0.0 ? -norm : norm;
    own[k] -= diagonal;
    double factor = 1.0 / (norm * fabs(own[k]));
    memset(along, 0, (size_t)w * sizeof *along);
    for (int i = k; i < m; i++)
        add(along + k + 1, M[i * w + k], M + i * w + k + 1, w - k - 1);
    for (int i = k; i < m; i++)
        add(M + i * w + k + 1, -factor * M[i * w + k], along + k + 1, w - k - 1);
    own[k] = diagonal;
}

/* Take the part along the reflection of row k off entries k and from r on of z. */
static void reflect(const double *row, double first, double factor, int k, int r, int n, double *z)
{
    double part = factor * (z[k] * first + dot(z + r, row + r, n - r));
    z[k] -= part * first;
    add(z + r, -part, row + r, n - r);
}

int least_squares_room(int n)
{
    return 4 * n + 2;
}

void least_squares(int m, int n, double *M, double *room, double *x)
{
    int w = n + 1, r = 0, *order = (int *)(room + 3 * n + 2);
    double *firsts = room + w, *factors = firsts + n, first = 0.0, square;
    for (int j = 0; j < n; j++)
        order[j] = j;
    for (; r < m && r < n; r++) {
        int best = pivot_of(M, m, n, r, room, &square);
        first = r ? first : square;
        if (!(square > DEPENDENT * DEPENDENT * first))
            break;
        if (best != r) {
            for (int i = 0; i < m; i++) {
                double *row = M + i * w, kept = row[r];
                row[r] = row[best], row[best] = kept;
            }
            int kept = order[r];
            order[r] = order[best], order[best] = kept;
        }
        reflect_rows(M, m, w, r, sqrt(square), room);
    }
    for (int k = r - 1; k >= 0 && r < n; k--) { /* what is left beside the triangle goes */
        double *row = M + k * w, norm = sqrt(row[k] * row[k] + dot(row + r, row + r, n - r));
        double diagonal = row[k] >= 0.0 ? -norm : norm;
        firsts[k] = row[k] - diagonal;
        factors[k] = 1.0 / (norm * fabs(firsts[k]));
        for (int i = 0; i < k; i++)
            reflect(row, firsts[k], factors[k], k, r, n, M + i * w);
        row[k] = diagonal;
    }
    double *z = room;
    memset(z, 0, (size_t)n * sizeof *z);
    for (int k = r - 1; k >= 0; k--) {
        const double *row = M + k * w;
        z[k] = row[n];
        for (int j = k + 1; j < r; j++)
            z[k] -= row[j] * z[j];
        z[k] /= row[k];
    }
    for (int k = 0; k < r && r < n; k++)
        reflect(M + k * w, firsts[k], factors[k], k, r, n, z);
    for (int j = 0; j < n; j++)
        x[order[j]] = z[j];
}

int nearest_room(int c, int h, int s, int N)
{
    return (c + h + s) * (N + 1) + least_squares_room(N);
}

int nearest_motion(const drives_model *of, int c, const double *J_C, int g, const double *gaps,
                   int h, const int64_t *held, const double *wanted, const double *displacements,
                   double *room, double *motion)
{
    int N = of->N, s = of->springs ? N : 0, w = N + 1, rows = c + h + s;
    bool is_there = true;
    for (int i = 0; i < h; i++)
        if (held[i] < 0 || held[i] >= of->n)
            return MOTION_REFUSED;
    for (int i = 0; i < g; i++)
        is_there = is_there && gaps[i] == 0.0;
    for (int i = 0; i < h; i++)
        is_there = is_there && wanted[held[i]] == displacements[held[i]];
    if (is_there)
        return MOTION_NONE;
    memset(motion, 0, (size_t)N * sizeof *motion);
    if (!c && !s) {
        for (int i = 0; i < h; i++)
            motion[of->active[held[i]]] = wanted[held[i]] - displacements[held[i]];
        return MOTION_FOUND;
    }
    memset(room, 0, (size_t)(rows * w) * sizeof *room);
    for (int i = 0; i < c; i++) {
        double *row = room + i * w;
        add(row, of->loops_first, J_C + i * N, N);
        row[N] = i < g ? -of->loops_first * gaps[i] : 0.0;
    }
    for (int i = 0; i < h; i++) {
        double *row = room + (c + i) * w;
        row[of->active[held[i]]] = 1.0;
        row[N] = wanted[held[i]] - displacements[held[i]];
    }
    for (int i = 0; i < s; i++)
        memcpy(room + (c + h + i) * w, of->springs + i * N, (size_t)N * sizeof *room);
    least_squares(rows, N, room, room + rows * w, motion);
    return MOTION_FOUND;
}
