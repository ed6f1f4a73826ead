/* Rates and passive velocities of a regular mechanism in one call.
 *
 * Regular is what has no rank in doubt: loops determine the passive velocities, and all rows of all
 * levels can be met. What is in doubt is left to singular values.
 */
#include <math.h>

#include "kernels.h"

/* Part of a scale below which a singular value is zero at any tolerance, as it is elsewhere. */
static const double NOTHING = 1e-13;
/* Part of a row that is round-off where the row depends on others. */
static const double DEPENDENT = 1e-12;
/* Part of the terms of a velocity by which it may be beyond its limit before it is put on it. */
static const double ROUND_OFF = 1e-14;
/* Of the active set for each rate; where there are more, another method decides. */
static const int STEPS = 6;
/* Sum of squares up to which, and from the inverse of which on, no product over- or underflows. */
static const double MODERATE = 1e100;
/* Of bounds of errors, which are of first order. */
static const double MARGIN = 8.0;

typedef struct {
    double *at;
    int rows, width;
} matrix;

/* What the loops leave, and what counts as zero of it. */
typedef struct {
    bool is_regular;    /* whether J_Cp is */
    int end;            /* in M, of the independent rows on the rates */
    double scale;       /* size of the terms of J = J_Ta + J_Tp gain */
    double loops, task; /* what is zero of the loops, per |gain|, and of J */
    double follows;     /* |gain|^2 */
} reduction;

/* All moving velocities C y + c in their order, and their limits by velocity. */
typedef struct {
    matrix C;
    double *c;
    int start;        /* the rates with a weight: from this row on C is R^-1, */
    bool is_diagonal; /* and so is R */
    const int64_t *order;
    const double *lower, *upper;
} motion;

static double *row(matrix A, int i)
{
    return A.at + i * A.width;
}

static double larger(double a, double b)
{
    return b > a ? b : a;
}

/* The product of two vectors, in four sums that the processor adds to at once. */
static double dot(const double *a, const double *b, int count)
{
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    int j = 0;
    for (; j + 4 <= count; j += 4)
        for (int k = 0; k < 4; k++)
            sums[k] += a[j + k] * b[j + k];
    double total = (sums[0] + sums[1]) + (sums[2] + sums[3]);
    for (; j < count; j++)
        total += a[j] * b[j];
    return total;
}

/* Add a multiple of one row to another. */
static void add(double *restrict target, double factor, const double *restrict source, int count)
{
    if (factor != 0.0) /* loops share few joints */
        for (int j = 0; j < count; j++)
            target[j] += factor * source[j];
}

/* Zero M's column below row k by a reflection v of the columns from `first` on.
 *
 * The row after `rows` is room. Returns whether there was anything. */
static bool clear_below(matrix M, int k, int column, int rows, int first, double *v)
{
    int own = k, count = M.width - first;
    double square = 0.0, *top = row(M, k) + first, *room = row(M, rows) + first;
    while (own < rows && row(M, own)[column] == 0.0)
        own++;
    if (k < own && own < rows) /* rows of other loops stay as they are */
        for (int j = 0; j < count; j++) {
            double kept = top[j];
            top[j] = row(M, own)[first + j];
            row(M, own)[first + j] = kept;
        }
    for (int i = k; i < rows; i++) {
        v[i] = row(M, i)[column];
        square += v[i] * v[i];
    }
    double norm = sqrt(square);
    if (!(norm > 0.0))
        return false;
    v[k] += copysign(norm, v[k]);
    double beta = 1.0 / (norm * fabs(v[k]));
    for (int j = 0; j < count; j++)
        room[j] = 0.0;
    for (int i = k; i < rows; i++)
        add(room, v[i], row(M, i) + first, count);
    for (int i = k; i < rows; i++)
        add(row(M, i) + first, -beta * v[i], room, count);
    return true;
}

/* |R^-1|^2 of the triangle R in M's first rows and these columns; x (count) is room. */
static double inverse(matrix M, const int *pivots, int count, double *x)
{
    double total = 0.0;
    for (int k = 0; k < count; k++) {
        for (int i = k; i < count; i++)
            x[i] = i == k ? 1.0 : 0.0;
        for (int i = k; i < count; i++)
            if (x[i] != 0.0) { /* loops share few joints */
                x[i] /= row(M, i)[pivots[i]];
                total += x[i] * x[i];
                for (int j = i + 1; j < count; j++)
                    x[j] -= x[i] * row(M, i)[pivots[j]];
            }
    }
    return total;
}

/* Solve M's first p unknowns by reflections from the left; the row after `rows` is room.
 *
 * Afterwards the first p rows are R^-1 Q1^T M from column p on, and the others Q2^T M. Returns
 * |R^-1|^2, which is not finite where the first p columns are dependent. */
static double eliminate(matrix M, int rows, int p, double *v, int *pivots)
{
    for (int k = 0; k < p; k++) {
        if (!clear_below(M, k, k, rows, k, v))
            return INFINITY;
        pivots[k] = k;
    }
    for (int i = p - 1; i >= 0; i--) {
        double *own = row(M, i), pivot = own[i];
        for (int k = i + 1; k < p; k++)
            add(own + p, -own[k], row(M, k) + p, M.width - p);
        for (int j = p; j < M.width; j++)
            own[j] /= pivot;
    }
    return inverse(M, pivots, p, v);
}

/* Pivots of a triangle to which reflections from the left reduce M's rows from `first` on.
 *
 * They stand in its columns from `first` on; the row after `rows` is room. What is left of the rows
 * after these is at most `zero`, and so is each singular value beyond as many. Returns how many. */
static int independent(matrix M, int first, int rows, double zero, double *v, int *pivots)
{
    int count = 0;
    double *squares = row(M, rows);
    for (int k = first; k < rows && k < M.width; k++) {
        double most = 0.0, left = 0.0;
        for (int j = first; j < M.width; j++)
            squares[j] = 0.0;
        for (int i = k; i < rows; i++)
            for (int j = first; j < M.width; j++)
                squares[j] += row(M, i)[j] * row(M, i)[j];
        for (int j = first; j < M.width; j++) {
            left += squares[j];
            if (squares[j] > most) {
                pivots[count] = j;
                most = squares[j];
            }
        }
        if (!(left > zero * zero))
            break;
        clear_below(M, k, pivots[count], rows, first, v);
        count++;
    }
    return count;
}

/* Apply a reflection to a vector. */
static void reflect(const double *restrict v, double beta, double *restrict x, int count)
{
    double factor = beta * dot(v, x, count);
    for (int j = 0; j < count; j++)
        x[j] -= factor * v[j];
}

/* Move x (n) least so that L's rows meet its column n; returns |L^-1|^2 of their triangle.
 *
 * Afterwards L and beta hold the reflections that reduce L's rows to it. */
static double least_change(matrix L, double *beta, double *x, double *room)
{
    int rows = L.rows, n = L.width - 1;
    double *diagonal = room, *column = room + rows, total = 0.0;
    for (int i = 0; i < rows; i++) {
        double *own = row(L, i) + i, norm = sqrt(dot(own, own, n - i));
        if (!(norm > 0.0))
            return INFINITY;
        double first = copysign(norm, own[0]);
        own[0] += first;
        diagonal[i] = -first;
        beta[i] = 1.0 / (norm * fabs(own[0]));
        for (int k = i + 1; k < rows; k++)
            reflect(own, beta[i], row(L, k) + i, n - i);
        reflect(own, beta[i], x + i, n - i);
    }
    for (int k = 0; k < rows; k++)
        for (int i = k; i < rows; i++) {
            double rest = (i == k ? 1.0 : 0.0) - dot(row(L, i) + k, column + k, i - k);
            column[i] = rest / diagonal[i];
            total += column[i] * column[i];
        }
    for (int i = 0; i < rows; i++)
        x[i] = (row(L, i)[n] - dot(row(L, i), x, i)) / diagonal[i];
    for (int i = rows - 1; i >= 0; i--)
        reflect(row(L, i) + i, beta[i], x + i, n - i);
    return total;
}

/* Reduce the loops to M: gains, then as many rows on the rates as are independent. */
static reduction through(const regular_plan *g, const double *J_T, const double *J_C, double size_T,
                         double size_C, double bound, matrix M, double *v, int *pivots)
{
    int p = g->p, c = g->c;
    for (int i = 0; i < c; i++)
        for (int j = 0; j < M.width; j++)
            row(M, i)[j] = J_C[i * g->N + g->order[j]];
    double closing = eliminate(M, c, p, v, pivots), follows = 0.0, moved = 0.0;
    for (int k = 0; k < p; k++) {
        double follow = 0.0, column = 0.0;
        for (int j = p; j < M.width; j++) {
            row(M, k)[j] = -row(M, k)[j];
            follow += row(M, k)[j] * row(M, k)[j];
        }
        for (int t = 0; t < g->m; t++) {
            double entry = J_T[t * g->N + g->order[k]];
            column += entry * entry;
        }
        follows += follow;
        moved += column * follow;
    }
    double scale = size_T + sqrt(moved);
    double loops = larger(g->doubt_C * size_C, MARGIN * g->error_C * bound);
    double reached = g->error_T + size_T * sqrt(closing) * g->error_C;
    double task = larger(g->doubt_J * scale, MARGIN * (reached * (1.0 + sqrt(follows))) * bound);
    bool is_regular = p == 0 || closing * loops * loops < 1.0;
    int end = is_regular && c > p ? p + independent(M, p, c, NOTHING * size_C, v, pivots) : p;
    return (reduction){is_regular, end, scale, loops, task, follows};
}

/* Write J = J_Ta + J_Tp gain, (m, n), its rates in their order. */
static void reduced_task(const regular_plan *g, const double *J_T, matrix M, matrix J)
{
    for (int t = 0; t < g->m; t++) {
        const double *given = J_T + t * g->N;
        for (int j = 0; j < g->n; j++)
            row(J, t)[j] = given[g->order[g->p + j]];
        for (int h = 0; h < g->p; h++)
            add(row(J, t), given[g->order[h]], row(M, h) + g->p, g->n);
    }
}

/* Write A B, A with this number of rows, to the rows of C from `first` on, B's columns wide. */
static void product(const double *A, int rows, matrix B, int first, matrix C)
{
    for (int i = 0; i < rows; i++) {
        double *own = row(C, first + i);
        for (int j = 0; j < B.width; j++)
            own[j] = 0.0;
        for (int t = 0; t < B.rows; t++)
            add(own, A[i * B.rows + t], row(B, t), B.width);
    }
}

/* Whether the rank of B's first rows with D J after them is as large as can be, surely. */
static bool is_met_whole(const regular_plan *g, matrix B, int first, matrix J, double zero,
                         matrix A, double *v, int *pivots)
{
    int rows = first + g->d;
    for (int i = 0; i < first; i++)
        for (int j = 0; j < g->n; j++)
            row(A, i)[j] = row(B, i)[j];
    product(g->D, g->d, J, first, A);
    int rank = independent(A, 0, rows, 0.0, v, pivots);
    bool is_whole = rank == (rows < g->n ? rows : g->n);
    return is_whole && inverse(A, pivots, rank, v) * zero * zero < 1.0;
}

/* R and, in its last column, r: of |R x - r| with the rates x that have weights, (w, w + 1).
 *
 * It is |weights (x - wanted)|, and |G [rates; -1]| beside it, in which the z others follow from
 * B. G is overwritten. */
static void triangle(const double *weight, const double *wanted, matrix B, int z, matrix G,
                     matrix R)
{
    int w = R.rows;
    for (int j = 0; j < w; j++) {
        for (int i = 0; i < w; i++)
            row(R, j)[i] = 0.0;
        row(R, j)[j] = weight[j];
        row(R, j)[w] = wanted[j] * weight[j];
    }
    for (int e = 0; e < G.rows; e++)
        for (int i = 0; i < z; i++)
            for (int j = z; j < G.width; j++)
                row(G, e)[j] -= row(G, e)[i] * row(B, i)[j];
    for (int k = 0; k < (G.rows ? w : 0); k++) {
        double *own = row(R, k), square = 0.0;
        for (int e = 0; e < G.rows; e++)
            square += row(G, e)[z + k] * row(G, e)[z + k];
        double norm = sqrt(own[k] * own[k] + square), first = own[k] + norm;
        for (int j = k + 1; j <= w; j++) {
            double part = first * own[j];
            for (int e = 0; e < G.rows; e++)
                part += row(G, e)[z + k] * row(G, e)[z + j];
            part /= norm * first;
            own[j] -= part * first;
            for (int e = 0; e < G.rows; e++)
                row(G, e)[z + j] -= part * row(G, e)[z + k];
        }
        own[k] = -norm;
    }
}

/* Overwrite a row x (w), which has numbers in these columns, with x R^-1. */
static void divide(double *x, matrix R, bool is_diagonal, int first, int last)
{
    for (int i = first; i < last; i++) {
        x[i] /= row(R, i)[i];
        for (int j = i + 1; j < (is_diagonal ? 0 : last); j++)
            x[j] -= x[i] * row(R, i)[j];
    }
}

/* Meet B's rows by rates over which y = R x is nearest to R's last column.
 *
 * The first z rates have no weight: they follow from the others, as passive velocities do. Returns
 * |(B R^-1)^+|^2 at most. */
static double optimum(matrix B, int z, matrix R, bool is_diagonal, matrix L, double *beta,
                      double *y, double *room)
{
    int w = R.rows;
    for (int j = 0; j < w; j++)
        y[j] = row(R, j)[w];
    for (int i = 0; i < L.rows; i++) {
        for (int j = 0; j <= w; j++)
            row(L, i)[j] = row(B, z + i)[z + j];
        divide(row(L, i), R, is_diagonal, 0, w);
    }
    return least_change(L, beta, y, room);
}

/* The product of row i of C and a vector (w). */
static double along(motion a, int i, const double *x)
{
    int first = i < a.start ? 0 : i - a.start;
    int last = a.is_diagonal && i >= a.start ? first + 1 : a.C.width;
    return dot(row(a.C, i) + first, x + first, last - first);
}

/* Write all moving velocities, of which z rates without a weight follow from B. */
static void all_velocities(matrix M, matrix B, int p, int z, matrix R, motion a)
{
    int n = B.width - 1, w = R.rows;
    for (int i = 0; i < p + n; i++) {
        a.c[i] = 0.0;
        for (int j = 0; j < w; j++)
            row(a.C, i)[j] = i == a.start + j ? 1.0 : 0.0;
    }
    for (int i = 0; i < z; i++) {
        a.c[p + i] = row(B, i)[n];
        for (int j = 0; j < w; j++)
            row(a.C, p + i)[j] = -row(B, i)[z + j];
    }
    for (int k = 0; k < p; k++) {
        for (int j = 0; j < w; j++)
            row(a.C, k)[j] = row(M, k)[p + z + j];
        for (int i = 0; i < z; i++) {
            a.c[k] += row(M, k)[p + i] * a.c[p + i];
            add(row(a.C, k), row(M, k)[p + i], row(a.C, p + i), w);
        }
    }
    for (int i = 0; i < a.start; i++)
        divide(row(a.C, i), R, a.is_diagonal, 0, w);
    for (int j = 0; j < w; j++)
        divide(row(a.C, a.start + j), R, a.is_diagonal, j, a.is_diagonal ? j + 1 : w);
}

/* The velocity farthest beyond a limit, per norm of its row, and the side; -1 if none is. */
static int most_beyond(motion a, const double *norms, const double *y, double *side)
{
    int chosen = -1;
    double most = 0.0, size = sqrt(dot(y, y, a.C.width));
    for (int i = 0; i < a.C.rows; i++) {
        double low = a.lower[a.order[i]], high = a.upper[a.order[i]];
        if (low > -INFINITY || high < INFINITY) {
            double x = a.c[i] + along(a, i, y), norm = norms[i], beyond = larger(low - x, x - high);
            bool is_beyond = beyond > ROUND_OFF * (norm * size + fabs(a.c[i]));
            if (is_beyond && (!(norm > 0.0) || beyond > most * norm)) {
                chosen = i;
                *side = low > x ? 1.0 : -1.0;
                most = beyond / norm;
            }
        }
    }
    return chosen;
}

/* Solve H r = h by Cholesky's factor F, k rows of each. */
static void multipliers(matrix H, const double *h, int k, matrix F, double *r)
{
    for (int a = 0; a < k; a++)
        for (int b = 0; b <= a; b++) {
            double t = row(H, a)[b];
            for (int e = 0; e < b; e++)
                t -= row(F, a)[e] * row(F, b)[e];
            row(F, a)[b] = a == b ? sqrt(t) : t / row(F, b)[b];
        }
    for (int a = 0; a < k; a++) {
        double t = h[a];
        for (int e = 0; e < a; e++)
            t -= row(F, a)[e] * r[e];
        r[a] = t / row(F, a)[a];
    }
    for (int a = k - 1; a >= 0; a--) {
        double t = r[a];
        for (int e = a + 1; e < k; e++)
            t -= row(F, e)[a] * r[e];
        r[a] = t / row(F, a)[a];
    }
}

/* Take from x (w) what moves the rows of L. */
static void project(matrix L, const double *beta, double *x)
{
    int w = L.width - 1;
    for (int i = 0; i < L.rows; i++)
        reflect(row(L, i) + i, beta[i], x + i, w - i);
    for (int i = 0; i < L.rows; i++)
        x[i] = 0.0;
    for (int i = L.rows - 1; i >= 0; i--)
        reflect(row(L, i) + i, beta[i], x + i, w - i);
}

/* Take one of the limits that hold out of the lists, whose last one is a candidate. */
static void drop(matrix P, matrix H, double *u, int dropped, int last)
{
    for (int a = dropped; a < last; a++) {
        u[a] = u[a + 1];
        for (int j = 0; j < P.width; j++)
            row(P, a)[j] = row(P, a + 1)[j];
    }
    for (int a = dropped; a < last - 1; a++)
        for (int b = 0; b < last; b++)
            row(H, a)[b] = row(H, a + 1)[b];
    for (int b = 0; b < last - 1; b++)
        for (int a = dropped; a < last - 1; a++)
            row(H, b)[a] = row(H, b)[a + 1];
}

/* Move y least, the rows of L met as before, so that C y + c is within its limits.
 *
 * A dual active-set method (Goldfarb, Idnani, Math. Programming 27, 1983): k limits hold, P has
 * their rows on what L leaves free, H = P P^T, u their multipliers. Returns whether y was found
 * beyond doubt. */
static bool hold(matrix L, const double *beta, motion a, double clear, double *y, double *room)
{
    int w = a.C.width, most = w - L.rows, k = 0, steps = 0;
    matrix P = {room, most + 1, w};
    matrix H = {row(P, most + 1), most, most}, F = {row(H, most), most, most};
    double *step = row(F, most), *r = step + w, *h = r + most, *u = h + most, *norms = u + most + 1;
    for (int i = 0; i < a.C.rows; i++)
        norms[i] = sqrt(along(a, i, row(a.C, i)));
    while (true) {
        double side = 0.0;
        int new = most_beyond(a, norms, y, &side);
        if (new < 0)
            return true;
        double limit = (side > 0.0 ? a.lower : a.upper)[a.order[new]];
        double size = norms[new] * norms[new];
        for (int j = 0; j < w; j++)
            row(P, k)[j] = side * row(a.C, new)[j];
        project(L, beta, row(P, k));
        u[k] = 0.0;
        bool is_held = false;
        while (!is_held) {
            double length = INFINITY;
            int dropped = -1;
            steps++;
            for (int b = 0; b < k; b++)
                h[b] = side * along(a, new, row(P, b));
            multipliers(H, h, k, F, r);
            for (int j = 0; j < w; j++)
                step[j] = row(P, k)[j];
            for (int b = 0; b < k; b++)
                for (int j = 0; j < w; j++)
                    step[j] -= r[b] * row(P, b)[j];
            double square = dot(step, step, w);
            bool moves = square > DEPENDENT * DEPENDENT * size;
            if (moves)
                length = side * (limit - a.c[new] - along(a, new, y)) / square;
            bool is_doubtful = moves && (square < clear * clear * size || k == most);
            for (int b = 0; b < k; b++)
                if (r[b] > 0.0 && u[b] < length * r[b]) {
                    length = u[b] / r[b];
                    dropped = b;
                }
            if (is_doubtful || length == INFINITY || steps > STEPS * (w + 1))
                return false;
            for (int j = 0; j < (moves ? w : 0); j++)
                y[j] += length * step[j];
            for (int b = 0; b < k; b++)
                u[b] -= length * r[b];
            u[k] += length;
            is_held = dropped < 0;
            if (is_held) {
                for (int b = 0; b < k; b++)
                    row(H, k)[b] = row(H, b)[k] = h[b];
                row(H, k)[k] = side * along(a, new, row(P, k));
                k++;
            } else {
                drop(P, H, u, dropped, k);
                k--;
            }
        }
    }
}

/* Whether no product of numbers with this sum of squares over- or underflows. */
static bool is_moderate(double square)
{
    return square == 0.0 || (1.0 / MODERATE < square && square < MODERATE);
}

/* Write gains, the loops' rows on the rates, J, and the size of its terms, all per actuator. */
static void reduce(const regular_plan *g, matrix M, matrix J, int end, double scale,
                   double *reduced)
{
    int n = g->n, c = g->c;
    for (int j = 0; j < n; j++) {
        double *column = reduced + g->place[j];
        for (int i = 0; i < c; i++)
            column[i * n] = i < end ? row(M, i)[g->p + j] : 0.0;
        for (int t = 0; t < g->m; t++)
            column[(c + t) * n] = row(J, t)[j];
        column[(c + g->m) * n] = scale;
    }
}

/* Whether the idle velocities move neither loops nor task, and may be zero. */
static bool are_idle(const regular_plan *g, const double *J_T, const double *J_C,
                     const double *lower, const double *upper)
{
    for (int k = 0; k < g->idles; k++) {
        int64_t j = g->idle[k];
        if (!(lower[j] <= 0.0 && 0.0 <= upper[j]))
            return false;
        for (int i = 0; i < g->m; i++)
            if (J_T[i * g->N + j] != 0.0)
                return false;
        for (int i = 0; i < g->c; i++)
            if (J_C[i * g->N + j] != 0.0)
                return false;
    }
    return true;
}

/* Most rows of loops and levels on the rates. */
static int most_rows(const regular_plan *g)
{
    return g->k + (g->c > g->p ? g->c - g->p : 0);
}

int regular_room(const regular_plan *g)
{
    int n = g->n, w = n - g->z, all = g->p + n, rows = most_rows(g), whole = rows + g->d;
    int reduced = (g->c + g->m + 1) * n, loops = (g->c + 1) * all + 2 * (g->c + whole);
    int task = g->m * n + g->k + w + g->e + (rows + 1) * (n + 1) + (whole + 1) * n;
    int beside = g->d * n + g->e * (n + 1), best = w * (w + 1) + rows * (w + 2) + 2 * w;
    return reduced + loops + task + beside + best + all * (w + 2) + (w + 1) * (3 * w + 4);
}

int regular_meet(const regular_plan *g, const double *J_T, const double *J_C,
                 const double *targets, const double *lower, const double *upper, double bound,
                 double *x, double *room)
{
    int p = g->p, z = g->z, n = g->n, k = g->k, w = n - z, most = most_rows(g), all = p + n;
    bool is_diagonal = g->e == 0;
    double squares_T = dot(J_T, J_T, g->m * g->N), squares_C = dot(J_C, J_C, g->c * g->N);
    double asked = dot(targets, targets, g->t);
    if (!(squares_T < INFINITY && squares_C < INFINITY && asked < INFINITY && bound >= 0.0))
        return REGULAR_REFUSED;
    if (!(bound < INFINITY && is_moderate(squares_T) && is_moderate(squares_C)))
        return REGULAR_IN_DOUBT;
    if (!is_moderate(asked) || p > g->c || !are_idle(g, J_T, J_C, lower, upper))
        return REGULAR_IN_DOUBT;
    matrix M = {room + (g->c + g->m + 1) * n, g->c + 1, all};
    double *v = row(M, g->c + 1); /* room of all functions, half of it for indices */
    int *pivots = (int *)(v + g->c + most + g->d);
    matrix J = {v + 2 * (g->c + most + g->d), g->m, n};
    reduction loops = through(g, J_T, J_C, sqrt(squares_T), sqrt(squares_C), bound, M, v, pivots);
    int q = loops.end - p, rows = q + k;
    if (!(loops.is_regular && z <= rows && rows <= n))
        return REGULAR_IN_DOUBT;
    double *right = row(J, g->m);
    for (int i = 0; i < k + w + g->e; i++) {
        right[i] = 0.0;
        for (int j = 0; j < g->t; j++)
            right[i] += g->T[i * g->t + j] * targets[j];
    }
    matrix B = {right + k + w + g->e, most + 1, n + 1};
    reduced_task(g, J_T, M, J);
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < (i < q ? n : 0); j++)
            row(B, i)[j] = row(M, p + i)[p + j];
        row(B, i)[n] = i >= q ? right[i - q] : 0.0;
    }
    product(g->S, k, J, q, B);
    /* The least singular value of all rows is at least 1 / |B^+|, and each level's no less. */
    double zero = q > 0 ? loops.loops * (1.0 + sqrt(loops.follows)) : 0.0;
    zero = larger(zero, 2.0 * g->directions * loops.task);
    matrix A = {row(B, most + 1), most + g->d + 1, n};
    if (g->d && !is_met_whole(g, B, rows, J, zero, A, v, pivots))
        return REGULAR_IN_DOUBT;
    matrix DJ = {row(A, A.rows), g->d, n}, G = {row(DJ, g->d), g->e, n + 1};
    product(g->D, g->d, J, 0, DJ);
    product(g->E, g->e, DJ, 0, G);
    for (int e = 0; e < g->e; e++)
        row(G, e)[n] = right[k + w + e];
    double unweighted = eliminate(B, rows, z, v, pivots), gain = 1.0;
    for (int i = 0; i < z; i++)
        for (int j = z; j < n; j++)
            gain += row(B, i)[j] * row(B, i)[j];
    matrix R = {row(G, g->e), w, w + 1}, L = {row(R, w), rows - z, w + 1};
    double *beta = row(L, most), *y = beta + most, *unlimited = y + w;
    triangle(g->weight, right + k, B, z, G, R);
    double inverse = optimum(B, z, R, is_diagonal, L, beta, y, v);
    inverse = inverse * gain / (g->least_weight * g->least_weight) + unweighted;
    double settling = g->settling * g->settling + g->beside * g->beside * loops.scale * loops.scale;
    if (!(inverse * zero * zero < 1.0 && gain * settling < 1.0))
        return REGULAR_IN_DOUBT;

    for (int i = 0; i < all; i++)
        if (!(lower[g->order[i]] <= upper[g->order[i]]))
            return REGULAR_REFUSED;
    matrix C = {unlimited + w, all, w};
    motion a = {C, row(C, all), p + z, is_diagonal, g->order, lower, upper};
    all_velocities(M, B, p, z, R, a);
    for (int j = 0; j < w; j++)
        unlimited[j] = y[j];
    bool are_held = hold(L, beta, a, g->clear, y, a.c + all);
    for (int j = 0; j < g->N; j++)
        x[j] = 0.0;
    for (int i = 0; i < all; i++) {
        int64_t j = g->order[i];
        double value = a.c[i] + along(a, i, are_held ? y : unlimited);
        x[j] = value;
        if (are_held) {
            double above = larger(value, lower[j]);
            x[j] = upper[j] < above ? upper[j] : above;
        }
    }
    if (!are_held)
        reduce(g, M, J, loops.end, loops.scale, room);
    return are_held ? REGULAR_MET : REGULAR_LIMITED;
}
