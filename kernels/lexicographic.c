/* Lexicographic least squares under bounds: a primal active-set method, level by level.
 *
 * Unknowns are x = V y, V a product of reflections. Each level determines the coordinates y that
 * its rows affect in the null space of the previous levels, and the reflections that achieve this
 * are stored: the following coordinates are the null space for later levels (Escande, Mansard,
 * Wieber, IJRR 33(7), 2014, with bounds alone). The rank of a level is decided once: by the
 * certificate of its triangle, or where that is inconclusive by the singular values of its rows.
 */
#include <math.h>
#include <string.h>
#include "kernels.h"
#include "numerics.h"

/* Rows up to this size are zero at any scale: products with their inverse may overflow. */
static const double NOTHING = 1e-150;
/* Magnitudes of numbers that the argument checks accept, as in argument_checks/arrays.py. */
static const double LARGEST = 1e120, SMALLEST = 1e-120;

enum { PASSES = 3, DEGENERATE = 3, SWEEPS = 40 };

/* One problem of a lexicographic_problem. */
typedef struct {
    int levels, damped; /* all levels; the caller's, with damping and rank */
    bool beside;
    double tolerance;
    const int32_t *ends;
    const double *damping, *A, *b, *scales, *lower, *upper;
    int32_t *ranks;
} problem_t;

typedef struct {
    int n;              /* unknowns */
    int fixed;          /* coordinates that are determined */
    int turned;         /* reflections that determine them: not those of a norm within a level */
    double least;       /* singular values of a level up to this one are zero */
    double slow, fast;  /* range of weights by which unknowns are scaled */
    bool doubt;         /* whether the weights hide a rank deficiency */
    double blur;        /* angle by which neglected values may rotate the null space */
    double *gap;        /* smallest gap of a rank decision: see `gaps` */
    double gaps[2];     /* of the levels without bounds, and with active ones */
    double from;        /* size of the terms of the level's residual */
    int32_t *rank;      /* of the level without bounds, or none */
    int steps, most;    /* of the active set, and their bound */
    double *V, *beta;   /* reflection t acts on coordinates from t on: row t of (n, n), and (n,) */
    double *M, *r;      /* a level's rows (k, n) and their residual (k,) */
    double *copy, *lack, *squares; /* copies, and squares of the rows, (k,) */
    bool is_norm;       /* whether K is the identity, which is not stored */
    double *K, *c, *t;  /* the level is |K t - c|, with (q, q) and (q,), at the present t */
    int k;              /* number of independent active bounds */
    double *Z, *Z_beta; /* reflections, those of active bounds first, (n, n) and (n,) */
    double *L;          /* the triangle of active bounds, (n, n) */
    double *P;          /* K after these reflections, (q, n) */
    double *lambda;     /* multipliers, (n,) */
    double *step, *move, *size, *none; /* (n,) */
    int32_t *active;    /* unknowns whose bounds are active, in the order of their rows, (n,) */
    int8_t *fixed_at;       /* unknowns whose bounds are fixed for later levels, (n,) */
} work_t;

static void swap_rows(double *a, double *b, int n)
{
    for (int j = 0; j < n; j++) {
        double kept = a[j];
        a[j] = b[j];
        b[j] = kept;
    }
}

/* Apply reflections `first` to `last` to a vector, in this order. */
static void reflect(const double *V, const double *beta, int n, int first, int last, double *x)
{
    for (int t = first; t < last; t++)
        add(x + t, -beta[t] * dot(V + t * n + t, x + t, n - t), V + t * n + t, n - t);
}

/* Apply reflections in the opposite order. */
static void reflect_back(const double *V, const double *beta, int n, int first, int last, double *x)
{
    for (int t = last - 1; t >= first; t--)
        add(x + t, -beta[t] * dot(V + t * n + t, x + t, n - t), V + t * n + t, n - t);
}

/* Compute the reflection that zeroes a row right of column c; returns the diagonal. */
static double reflection(double *row, int n, int c, double *V, double *beta)
{
    double *v = V + c * n, norm = sqrt(dot(row + c, row + c, n - c));
    double diagonal = row[c] >= 0.0 ? -norm : norm;
    memcpy(v + c, row + c, (size_t)(n - c) * sizeof *v);
    v[c] -= diagonal;
    beta[c] = 1.0 / (norm * fabs(v[c]));
    memset(row + c, 0, (size_t)(n - c) * sizeof *row);
    row[c] = diagonal;
    return diagonal;
}

/* Reduce rows of M (k, n) to a lower triangle from column `first` on, by reflections from the
 * right.
 *
 * The longest remaining row is next, until none is longer than `least`; r (k,), if there is one, is
 * permuted with the rows; `squares` (k,) is workspace. Returns the rank; `left` is the norm of the
 * remainder.
 */
static int triangle(double *M, int k, int n, int first, double least, double *V, double *beta,
                    double *r, double *squares, double *left)
{
    int rank = 0;
    for (int i = 0; i < k; i++)
        squares[i] = dot(M + i * n + first, M + i * n + first, n - first);
    for (*left = 0.0; rank < k && first + rank < n; rank++) {
        int c = first + rank, best = rank;
        double most = -1.0;
        for (int i = rank; i < k; i++)
            if (squares[i] > most * (1.0 + ACCURACY)) {
                most = squares[i];
                best = i;
            }
        double *row = M + rank * n;
        if (best != rank) {
            swap_rows(row, M + best * n, n);
            swap_rows(squares + rank, squares + best, 1);
            if (r)
                swap_rows(r + rank, r + best, 1);
        }
        if (!(sqrt(dot(row + c, row + c, n - c)) > fmax(least, NOTHING)))
            break;
        reflection(row, n, c, V, beta);
        for (int i = rank + 1; i < k; i++) {
            double *other = M + i * n, before = squares[i];
            add(other + c, -beta[c] * dot(V + c * n + c, other + c, n - c), V + c * n + c, n - c);
            squares[i] -= other[c] * other[c];
            if (!(squares[i] > CANCELLED * before)) /* otherwise cancellation */
                squares[i] = dot(other + c + 1, other + c + 1, n - c - 1);
        }
    }
    for (int i = rank; i < k && first + rank < n; i++) {
        const double *remainder = M + i * n + first + rank;
        *left += dot(remainder, remainder, n - first - rank);
    }
    *left = sqrt(*left);
    return rank;
}

/* Return the Frobenius norm of the inverse of the triangle in M's first rows; `column` is
 * workspace. */
static double inverse_norm(const double *M, int n, int first, int rank, double *column)
{
    double total = 0.0;
    for (int k = 0; k < rank; k++)
        for (int i = k; i < rank; i++) {
            double s = (i == k ? 1.0 : 0.0) - dot(M + i * n + first + k, column + k, i - k);
            column[i] = s / M[i * n + first + i];
            total += column[i] * column[i];
        }
    return sqrt(total);
}

/* Make rows of M (k, n) orthogonal from column `first` on, by rotations from the left, also of r.
 *
 * Their norms are then the singular values (Hestenes, J. SIAM 6(1), 1958), the largest first.
 */
static void singular_rows(double *M, int k, int n, int first, double *r)
{
    int d = n - first;
    bool turned = true;
    for (int sweep = 0; sweep < SWEEPS && turned; sweep++) {
        turned = false;
        for (int i = 0; i < k; i++)
            for (int j = i + 1; j < k; j++) {
                double *a = M + i * n + first, *b = M + j * n + first;
                double aa = dot(a, a, d), bb = dot(b, b, d), ab = dot(a, b, d);
                if (aa < bb) {
                    swap_rows(a, b, d);
                    swap_rows(r + i, r + j, 1);
                    double kept = aa;
                    aa = bb;
                    bb = kept;
                }
                if (!(fabs(ab) > 0.1 * ROUND_OFF * sqrt(aa) * sqrt(bb)))
                    continue;
                turned = true;
                double zeta = (bb - aa) / (2.0 * ab);
                double tangent = copysign(1.0, zeta) / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
                double cosine = 1.0 / sqrt(1.0 + tangent * tangent), sine = cosine * tangent;
                for (int e = 0; e < d; e++) {
                    double one = a[e];
                    a[e] = cosine * one - sine * b[e];
                    b[e] = sine * one + cosine * b[e];
                }
                double one = r[i];
                r[i] = cosine * one - sine * r[j];
                r[j] = sine * one + cosine * r[j];
            }
    }
}

/* Decide the rank of M's rows (k, n) from column `first` on, and reduce them to a triangle.
 *
 * The pivots of the triangle certify a rank q if they bound the q-th singular value from below and
 * the norm of the remainder bounds the next one from above. Otherwise the singular values decide,
 * and rows of zero ones are cleared. Neglected values may have rotated the null space by an angle
 * `turned`.
 */
static int decide(work_t *w, double *M, int k, int first, double *V, double *beta, double *r,
                  double *turned)
{
    int n = w->n;
    double left, least = w->least;
    memcpy(w->copy, M, (size_t)(k * n) * sizeof *M);
    memcpy(w->lack, r, (size_t)k * sizeof *r);
    int rank = triangle(M, k, n, first, least / w->fast, V, beta, r, w->squares, &left);
    double doubt = least > 0.0 ? least / w->slow * inverse_norm(M, n, first, rank, w->none) : 0.0;
    left *= w->fast;
    if (!(doubt < 1.0) || left > least) {
        w->doubt = w->doubt || w->slow < w->fast;
        memcpy(M, w->copy, (size_t)(k * n) * sizeof *M);
        memcpy(r, w->lack, (size_t)k * sizeof *r);
        singular_rows(M, k, n, first, r);
        doubt = left = 0.0;
        for (rank = 0; rank < k && rank < n - first; rank++) {
            const double *row = M + rank * n + first;
            double sigma = sqrt(dot(row, row, n - first));
            if (!(sigma > least)) {
                left = sigma;
                break;
            }
            doubt = least / sigma;
        }
        double nothing;
        memset(M + rank * n, 0, (size_t)((k - rank) * n) * sizeof *M);
        rank = triangle(M, rank, n, first, 0.0, V, beta, r, w->squares, &nothing);
    }
    if (doubt > 0.0)
        *w->gap = fmin(*w->gap, 1.0 / doubt);
    if (left > 0.0)
        *w->gap = fmin(*w->gap, least / left);
    *turned = left > 0.0 ? doubt * left / least : 0.0;
    return rank;
}

/* Transform |L t - r|, L the first q columns of M's k rows from `first` on, to |K t - c|, square.
 *
 * L is lower trapezoidal; K, (q, q), lower triangular if there are no more rows, else upper.
 */
static void square(double *M, int k, int n, int first, int q, double *r, double *K, double *c)
{
    for (int j = 0; j < q && k > q; j++) {
        double total = 0.0, *on = M + j * n + first + j;
        for (int i = j; i < k; i++)
            total += M[i * n + first + j] * M[i * n + first + j];
        double norm = sqrt(total), diagonal = *on >= 0.0 ? -norm : norm;
        *on -= diagonal;
        double beta = 1.0 / (norm * fabs(*on));
        for (int e = j + 1; e <= q; e++) {
            double s = 0.0;
            for (int i = j; i < k; i++)
                s += M[i * n + first + j] * (e < q ? M[i * n + first + e] : r[i]);
            s *= beta;
            for (int i = j; i < k; i++)
                *(e < q ? M + i * n + first + e : r + i) -= s * M[i * n + first + j];
        }
        *on = diagonal;
    }
    for (int i = 0; i < q; i++) {
        c[i] = r[i];
        for (int j = 0; j < q; j++)
            K[i * q + j] = (k > q ? j >= i : j <= i) ? M[i * n + first + j] : 0.0;
    }
}

/* Solve K t = c, K triangular. */
static void solve_triangle(const double *K, int q, bool is_upper, const double *c, double *t)
{
    for (int e = 0; e < q; e++) {
        int i = is_upper ? q - 1 - e : e;
        double s = c[i];
        for (int j = is_upper ? i + 1 : 0; j < (is_upper ? q : i); j++)
            s -= K[i * q + j] * t[j];
        t[i] = s / K[i * q + i];
    }
}

/* Write the derivative of an unknown by the coordinates, row j of V. */
static void row_of(const work_t *w, int j, double *row)
{
    memset(row, 0, (size_t)w->n * sizeof *row);
    row[j] = 1.0;
    reflect(w->V, w->beta, w->n, 0, w->turned, row);
}

/* Fix the coordinates on which these bounds depend, rows of V in M (k, n): they come next in y. */
static void hold(work_t *w, int k)
{
    double left;
    double least = fmax(RANK, w->blur);
    int rank = triangle(w->M, k, w->n, w->fixed, least, w->V, w->beta, 0, w->none, &left);
    w->fixed += rank;
    w->turned += rank;
}

/* Activate the bound of an unknown, unless it depends on the active ones. */
static void activate(work_t *w, int q, int j)
{
    int n = w->n, c = w->fixed + w->k;
    double *row = w->L + w->k * n;
    if (c == n)
        return;
    row_of(w, j, row);
    reflect(w->Z, w->Z_beta, n, w->fixed, c, row);
    if (!(sqrt(dot(row + c, row + c, n - c)) > fmax(RANK, w->blur)))
        return;
    reflection(row, n, c, w->Z, w->Z_beta);
    w->active[w->k++] = j;
    for (int i = 0; i < q && !w->is_norm; i++)
        reflect(w->Z, w->Z_beta, n, c, c + 1, w->P + i * n);
}

/* Activate all bounds that x is at; the first k are active already. */
static void activate_all(work_t *w, int q, const int8_t *state, int k)
{
    int n = w->n, f = w->fixed;
    w->k = k;
    for (int i = 0; i < q && !w->is_norm; i++) {
        double *row = w->P + i * n;
        memset(row, 0, (size_t)n * sizeof *row);
        memcpy(row + f, w->K + i * q, (size_t)q * sizeof *row);
        reflect(w->Z, w->Z_beta, n, f, f + k, row);
    }
    for (int j = 0; j < n; j++) {
        bool is_there = false;
        for (int i = 0; i < k; i++)
            is_there = is_there || w->active[i] == j;
        if (state[j] && !w->fixed_at[j] && !is_there)
            activate(w, q, j);
    }
}

/* Write the residual of the level at t, c - K t, to r; returns the size of its terms. */
static double residual_at(work_t *w, int q, double *r)
{
    double size = 0.0;
    for (int i = 0; i < q; i++) {
        double total = fabs(w->c[i]);
        r[i] = w->c[i];
        for (int j = w->is_norm ? i : 0; j < (w->is_norm ? i + 1 : q); j++) {
            double part = (w->is_norm ? 1.0 : w->K[i * q + j]) * w->t[j];
            r[i] -= part;
            total += fabs(part);
        }
        size += total * total;
    }
    return sqrt(size);
}

/* Write the step in y to the optimum of |K t - c| with active bounds; returns the size of its
 * terms. */
static double towards(work_t *w, int q)
{
    int n = w->n, f = w->fixed, c = w->fixed + w->k;
    double turned, size = residual_at(w, q, w->r);
    memset(w->step, 0, (size_t)n * sizeof *w->step);
    if (w->is_norm) {
        memcpy(w->step + f, w->r, (size_t)q * sizeof *w->r);
        reflect(w->Z, w->Z_beta, n, f, c, w->step);
        memset(w->step + f, 0, (size_t)w->k * sizeof *w->step);
        reflect_back(w->Z, w->Z_beta, n, f, c, w->step);
        return size;
    }
    memcpy(w->M, w->P, (size_t)(q * n) * sizeof *w->M);
    int rank = decide(w, w->M, q, c, w->Z, w->Z_beta, w->r, &turned);
    square(w->M, q, n, c, rank, w->r, w->copy, w->lack);
    solve_triangle(w->copy, rank, q > rank, w->lack, w->step + c);
    reflect_back(w->Z, w->Z_beta, n, f, c + rank, w->step);
    return size;
}

/* Find the bound to deactivate, -1 if there is none, and then bounds with certainly non-zero
 * multipliers.
 *
 * With `first_only` the first candidate is taken, not the best. Steps of size `step_size` led here.
 */
static int multipliers(work_t *w, int q, const int8_t *state, bool first_only, double step_size)
{
    int n = w->n, f = w->fixed, k = w->k, chosen = -1;
    double worst = 0.0, *g = w->move, *lambda = w->lambda, *r = w->r;
    double terms = residual_at(w, q, r), residual = sqrt(dot(r, r, q));
    step_size = fmax(step_size, terms);
    if (!(residual > ROUND_OFF * step_size))
        return -1;
    memset(g, 0, (size_t)n * sizeof *g);
    for (int i = 0; i < q; i++)
        if (w->is_norm)
            g[f + i] = -r[i];
        else
            add(g + f, -r[i], w->K + i * q, q);
    reflect(w->Z, w->Z_beta, n, f, f + k, g);
    for (int i = k - 1; i >= 0; i--) {
        double s = g[f + i];
        for (int j = i + 1; j < k; j++)
            s -= w->L[j * n + f + i] * lambda[j];
        lambda[i] = s / w->L[i * n + f + i];
    }
    /* In the order of the unknowns, independent of pivoting. */
    for (int j = 0; j < n; j++)
        w->none[j] = 0.0;
    for (int i = 0; i < k; i++)
        w->none[w->active[i]] = lambda[i] * state[w->active[i]];
    for (int j = 0; j < n; j++)
        if (w->none[j] > fmax(0.1 * ROUND_OFF * terms, worst * (1.0 + ACCURACY))) {
            chosen = j;
            worst = w->none[j];
            if (first_only)
                break;
        }
    if (chosen < 0)
        for (int j = 0; j < n; j++)
            if (w->none[j] < -fmax(ROUND_OFF * fmax(step_size, w->from), ACCURACY * residual))
                w->fixed_at[j] = 1;
    return chosen;
}

/* Minimize |K t - c| within bounds, from the present x; returns whether the optimum was reached. */
static bool within(work_t *w, int q, const double *lower, const double *upper, double *x,
                   int8_t *state)
{
    int n = w->n, f = w->fixed, idle = 0;
    double before = *w->gap, step_size = 0.0; /* steps along nearly dependent rows are long */
    memset(w->t, 0, (size_t)q * sizeof *w->t);
    activate_all(w, q, state, 0);
    for (; w->steps < w->most; w->steps++) {
        *w->gap = before; /* the optimum depends on the decision of the last step alone */
        double terms = towards(w, q), length = 1.0, most = 0.0, moved = 0.0;
        int blocked = -1;
        for (int i = 0; i < q; i++) {
            double change = w->is_norm ? w->step[f + i] : dot(w->K + i * q, w->step + f, q);
            moved += change * change;
        }
        memcpy(w->move, w->step, (size_t)n * sizeof *w->move);
        reflect_back(w->V, w->beta, n, 0, w->turned, w->move);
        for (int j = 0; j < n; j++) {
            if (state[j] || w->fixed_at[j])
                w->move[j] = 0.0;
            most = fmax(most, fabs(w->move[j]));
        }
        if (!(sqrt(moved) > ROUND_OFF * terms))
            length = 0.0; /* it would be blocked in directions of round-off */
        for (int j = 0; j < n && length > 0.0; j++) {
            double work = INFINITY;
            if (w->move[j] > ROUND_OFF * most)
                work = (upper[j] - x[j]) / w->move[j];
            else if (w->move[j] < -ROUND_OFF * most)
                work = (lower[j] - x[j]) / w->move[j];
            if (work < length) {
                length = work;
                blocked = j;
            }
        }
        if (length > 0.0) {
            add(w->t, length, w->step + f, q);
            step_size = fmax(step_size, length * sqrt(dot(w->step, w->step, n)));
            for (int j = 0; j < n; j++) {
                double moved = x[j] + length * w->move[j];
                if (fabs(moved) < 0.1 * ROUND_OFF * fabs(x[j]))
                    moved = 0.0;
                x[j] = fmin(fmax(moved, lower[j]), upper[j]);
            }
        }
        idle = length > ROUND_OFF ? 0 : idle + 1;
        if (blocked >= 0) {
            state[blocked] = w->move[blocked] > 0.0 ? LEXICOGRAPHIC_UPPER : LEXICOGRAPHIC_LOWER;
            x[blocked] = w->move[blocked] > 0.0 ? upper[blocked] : lower[blocked];
            activate(w, q, blocked);
            continue;
        }
        int chosen = multipliers(w, q, state, idle > DEGENERATE, step_size);
        if (chosen < 0) {
            w->steps++;
            return true;
        }
        int kept = 0;
        while (w->active[kept] != chosen)
            kept++;
        state[chosen] = LEXICOGRAPHIC_FREE;
        activate_all(w, q, state, kept);
    }
    return false;
}

/* Initialize all coordinates as free but those of unknowns whose bounds are equal. */
static void begin(work_t *w, const double *lower, const double *upper, double *x, bool bounded)
{
    int n = w->n, fixed_at = 0;
    w->fixed = w->turned = 0;
    w->is_norm = false;
    w->gap = w->gaps + bounded;
    w->blur = 0.0;
    for (int j = 0; j < n; j++) {
        w->fixed_at[j] = lower[j] == upper[j];
        if (w->fixed_at[j])
            row_of(w, j, w->M + fixed_at++ * n);
    }
    hold(w, fixed_at);
    if (!bounded)
        reflect(w->V, w->beta, n, 0, w->fixed, x); /* x is y until the end */
}

/* Write a level's rows (k, n) to M, in coordinates, and their residual to r. */
static void take(work_t *w, const double *A, const double *b, int k, double unit, const double *x,
                 bool bounded)
{
    int n = w->n;
    w->from = 0.0;
    for (int i = 0; i < k; i++) {
        double *row = w->M + i * n;
        for (int j = 0; j < n; j++)
            row[j] = A[i * n + j] * unit;
        w->r[i] = b[i] * unit;
        w->from += w->r[i] * w->r[i];
        if (bounded)
            w->r[i] -= dot(row, x, n);
        reflect(w->V, w->beta, n, 0, w->fixed, row);
        if (!bounded)
            w->r[i] -= dot(row, x, w->fixed);
    }
    w->from = sqrt(w->from) + sqrt(dot(x, x, n)); /* in these units rows have norms up to 1 */
}

/* Fix the coordinates that this level has determined, and the bounds that restrict it. */
static void keep(work_t *w, int q, const double *lower, const double *upper, const int8_t *state)
{
    int n = w->n, fixed_at = 0;
    w->fixed += q;
    for (int j = 0; j < n; j++)
        if (state[j] && w->fixed_at[j] && lower[j] < upper[j])
            row_of(w, j, w->M + fixed_at++ * n);
    hold(w, fixed_at);
}

/* Write rows factor * y to M after k others, of d coordinates; returns the number of all rows. */
static int with_norm(work_t *w, int k, int d, double factor, const double *x, bool bounded)
{
    int n = w->n, f = w->fixed;
    double *y = w->step;
    memcpy(y, x, (size_t)n * sizeof *y);
    if (bounded)
        reflect(w->V, w->beta, n, 0, w->turned, y);
    for (int i = 0; i < d; i++, k++) {
        memset(w->M + k * n, 0, (size_t)n * sizeof *w->M);
        w->M[k * n + f + i] = factor;
        w->r[k] = bounded ? -factor * y[f + i] : 0.0;
    }
    w->from += factor * sqrt(dot(x, x, n));
    return k;
}

/* Transform M's rows (k, n) to |K t - c|, with coordinates such that these rows affect the first
 * ones.
 *
 * With |x| as further rows no rank is decided. Within bounds all coordinates are determined;
 * without, those that the rows do not affect are zero. Returns the size of K; `is_upper` is which
 * triangle it is.
 */
static int level_of(work_t *w, int k, double damping, bool beside, const double *x, bool bounded,
                    bool *is_upper)
{
    int n = w->n, f = w->fixed, q = n - f;
    bool is_damped = damping > 0.0 && !(beside && bounded);
    if (beside && bounded) {
        k = with_norm(w, k, q, damping, x, bounded);
    } else {
        double turned;
        w->least = beside ? 0.0 : w->least;
        q = decide(w, w->M, k, f, w->V, w->beta, w->r, &turned);
        w->blur = fmax(w->blur, turned);
        w->turned += q;
        if (w->rank && !beside)
            *w->rank = q;
    }
    square(w->M, k, n, f, q, w->r, w->K, w->c);
    if (is_damped) {
        memset(w->M, 0, (size_t)(q * n) * sizeof *w->M);
        for (int i = 0; i < q; i++)
            memcpy(w->M + i * n + f, w->K + i * q, (size_t)q * sizeof *w->M);
        memcpy(w->r, w->c, (size_t)q * sizeof *w->r);
        k = with_norm(w, q, q, damping, x, bounded);
        square(w->M, k, n, f, q, w->r, w->K, w->c);
    }
    *is_upper = k > q;
    return q;
}

/* Solve the level in M and fix its result; returns whether its optimum was reached. */
static bool level(work_t *w, int k, double damping, bool beside, const double *lower,
                  const double *upper, double *x, int8_t *state, bool bounded)
{
    bool is_upper;
    int q = level_of(w, k, damping, beside, x, bounded, &is_upper);
    if (w->doubt)
        return false;
    if (!bounded) {
        solve_triangle(w->K, q, is_upper, w->c, x + w->fixed);
        w->fixed += q;
        return true;
    }
    if (q && !within(w, q, lower, upper, x, state))
        return false;
    keep(w, q, lower, upper, state);
    return true;
}

/* Minimize |x| in the null space of all levels; returns whether the optimum was reached. */
static bool least_norm(work_t *w, const double *lower, const double *upper, double *x,
                       int8_t *state)
{
    int n = w->n, q = n - w->fixed;
    w->from = sqrt(dot(x, x, n));
    w->is_norm = true;
    memcpy(w->step, x, (size_t)n * sizeof *x);
    reflect(w->V, w->beta, n, 0, w->turned, w->step);
    for (int i = 0; i < q; i++)
        w->c[i] = -w->step[w->fixed + i];
    return within(w, q, lower, upper, x, state);
}

/* Return the norm of the rows of a level. */
static double norm_of(const problem_t *p, int level, int n)
{
    int first = level ? p->ends[level - 1] : 0;
    const double *A = p->A + first * n;
    return sqrt(dot(A, A, (p->ends[level] - first) * n));
}

/* Solve every level in turn from x; returns whether all were solved. Without bounds x is
 * overwritten. */
static bool levels(work_t *w, const problem_t *p, double *x, int8_t *state, bool bounded)
{
    int n = w->n, first = 0;
    bool ended = true;
    begin(w, p->lower, p->upper, x, bounded);
    for (int i = 0; i < p->levels && w->fixed < n && ended; first = p->ends[i++]) {
        int k = p->ends[i] - first, exponent;
        bool beside = p->beside && i == p->levels - 1;
        double norm = norm_of(p, i, n), scale = p->scales ? p->scales[i] : norm;
        if (!(norm > NOTHING || beside))
            continue;
        /* By a power of two, which is exact. */
        frexp(fmax(norm, NOTHING), &exponent);
        double unit = ldexp(1.0, -exponent);
        double damping = beside ? 1.0 : p->damping && i < p->damped ? p->damping[i] : 0.0;
        w->least = fmax(p->tolerance * scale, NOTHING) * unit;
        take(w, p->A + first * n, p->b + first, k, unit, x, bounded);
        w->rank = p->ranks && !bounded && i < p->damped ? p->ranks + i : 0;
        damping = fmin(damping * unit, 1.0 / NOTHING); /* more would not change the result */
        ended = level(w, k, damping, beside, p->lower, p->upper, x, state, bounded);
    }
    if (bounded)
        return ended && (w->fixed == n || least_norm(w, p->lower, p->upper, x, state));
    memset(x + w->fixed, 0, (size_t)(n - w->fixed) * sizeof *x);
    reflect_back(w->V, w->beta, n, 0, w->turned, x);
    return ended;
}

/* Move unknowns that violate their bounds onto these; returns whether none did. */
static bool clip(int n, const double *lower, const double *upper, double *x, int8_t *state)
{
    bool inside = true;
    for (int j = 0; j < n; j++) {
        if (lower[j] == upper[j] || x[j] < lower[j]) {
            inside = inside && x[j] == lower[j];
            x[j] = lower[j];
            state[j] = LEXICOGRAPHIC_LOWER;
        } else if (x[j] > upper[j]) {
            inside = false;
            x[j] = upper[j];
            state[j] = LEXICOGRAPHIC_UPPER;
        } else if (state[j]) {
            double bound = state[j] == LEXICOGRAPHIC_LOWER ? lower[j] : upper[j];
            if (isfinite(bound))
                x[j] = bound;
            else
                state[j] = LEXICOGRAPHIC_FREE; /* the bound was finite in the initial problem */
        }
    }
    return inside;
}

/* Solve one problem whose norm is |x|; returns whether every level was solved. */
static bool solve(work_t *w, const problem_t *p, bool warm, double *x, int8_t *state)
{
    int n = w->n;
    for (int j = 0; j < n; j++) {
        if (warm)
            continue;
        x[j] = p->lower[j] == p->upper[j] ? p->lower[j] : 0.0;
        state[j] = LEXICOGRAPHIC_FREE;
    }
    if (!warm && !levels(w, p, x, state, false))
        return false;
    if (clip(n, p->lower, p->upper, x, state) && !warm)
        return true;
    for (int pass = 0; pass < PASSES; pass++) {
        bool cancelled = false;
        memcpy(w->size, x, (size_t)n * sizeof *x);
        if (!levels(w, p, x, state, true))
            return false;
        for (int j = 0; j < n; j++)
            cancelled = cancelled || (!state[j] && fabs(x[j]) < CANCELLED * fabs(w->size[j]));
        if (!cancelled)
            break;
    }
    return true;
}

/* Transformed problem of one with weights, and its initial state. */
typedef struct {
    double *A, *b, *lower, *upper, *scales, *x; /* (rows + n, n), (rows + n,), (n,), (levels + 1,) */
    int32_t *ends;
    int8_t *state;
} scaled_t;

/* Solve for u = weight (x - desired), whose norm is least; returns false if the weights hide a rank
 * deficiency, else `ended` is whether every level was solved. */
static bool measured(work_t *w, problem_t p, const double *weight, const double *desired,
                     const scaled_t *scaled, bool warm, double *x, int8_t *state, bool *ended)
{
    int n = w->n, rows = p.levels ? p.ends[p.levels - 1] : 0;
    for (int i = 0; i < rows; i++) {
        scaled->b[i] = p.b[i] - dot(p.A + i * n, desired, n);
        for (int j = 0; j < n; j++)
            scaled->A[i * n + j] = p.A[i * n + j] / weight[j];
    }
    for (int j = 0; j < n; j++) {
        scaled->lower[j] = (p.lower[j] - desired[j]) * weight[j];
        scaled->upper[j] = (p.upper[j] - desired[j]) * weight[j];
        x[j] = (x[j] - desired[j]) * weight[j];
    }
    const double *lower = p.lower, *upper = p.upper;
    p.A = scaled->A;
    p.b = scaled->b;
    p.lower = scaled->lower;
    p.upper = scaled->upper;
    *ended = solve(w, &p, warm, x, state);
    for (int j = 0; j < n; j++) {
        x[j] = fmin(fmax(desired[j] + x[j] / weight[j], lower[j]), upper[j]);
        if (state[j])
            x[j] = state[j] == LEXICOGRAPHIC_LOWER ? lower[j] : upper[j];
    }
    return !w->doubt;
}

/* Solve with the rows of |weight (x - desired)| written out, within the last level or after it;
 * then |x| is minimized. */
static bool written_out(work_t *w, problem_t p, const double *weight, const double *desired,
                        const scaled_t *scaled, bool warm, double *x, int8_t *state)
{
    int n = w->n, rows = p.levels ? p.ends[p.levels - 1] : 0, last = p.levels - p.beside;
    double square = 0.0;
    memcpy(scaled->A, p.A, (size_t)(rows * n) * sizeof *x);
    memcpy(scaled->b, p.b, (size_t)rows * sizeof *x);
    memset(scaled->A + rows * n, 0, (size_t)(n * n) * sizeof *x);
    for (int j = 0; j < n; j++) {
        scaled->A[(rows + j) * n + j] = weight[j];
        scaled->b[rows + j] = weight[j] * desired[j];
        square += weight[j] * weight[j];
    }
    memcpy(scaled->ends, p.ends, (size_t)p.levels * sizeof *scaled->ends);
    for (int i = 0; i < p.levels; i++)
        scaled->scales[i] = p.scales ? p.scales[i] : norm_of(&p, i, n);
    scaled->ends[last] = rows + n;
    square *= fmin(1.0, RANK / p.tolerance) * fmin(1.0, RANK / p.tolerance);
    scaled->scales[last] = hypot(p.beside ? scaled->scales[last] : 0.0, sqrt(square));
    p.levels = last + 1;
    p.damped = last;
    p.beside = false;
    p.A = scaled->A;
    p.b = scaled->b;
    p.ends = scaled->ends;
    p.scales = scaled->scales;
    return solve(w, &p, warm, x, state);
}

/* Solve one problem of a batch; returns whether every level was solved. */
static bool solve_weighted(work_t *w, const problem_t *p, const double *weight,
                           const double *desired, const scaled_t *scaled, bool warm, double *x,
                           int8_t *state)
{
    int n = w->n;
    double slow = INFINITY, fast = 0.0;
    bool ended;
    w->slow = w->fast = 1.0;
    w->doubt = false;
    if (!weight)
        return solve(w, p, warm, x, state);
    for (int j = 0; j < n; j++) {
        slow = fmin(slow, weight[j]);
        fast = fmax(fast, weight[j]);
    }
    for (int i = 0; i < p->damped && p->damping; i++)
        slow = p->damping[i] > 0.0 ? 0.0 : slow; /* the norm added by damping has no weights */
    if (p->beside) { /* relative to larger rows a weight may count as zero */
        int last = p->levels - 1;
        double rows = p->scales ? p->scales[last] : norm_of(p, last, n);
        slow = slow > p->tolerance * hypot(rows, sqrt(n) * fast) ? slow : 0.0;
    }
    if (slow > 0.0 && fast < MEASURED * slow) {
        memcpy(scaled->x, x, (size_t)n * sizeof *x);
        memcpy(scaled->state, state, (size_t)n);
        w->slow = slow;
        w->fast = fast;
        if (measured(w, *p, weight, desired, scaled, warm, x, state, &ended))
            return ended;
        memcpy(x, scaled->x, (size_t)n * sizeof *x);
        memcpy(state, scaled->state, (size_t)n);
        w->slow = w->fast = 1.0;
        w->doubt = false;
        w->gaps[0] = w->gaps[1] = INFINITY;
    }
    return written_out(w, *p, weight, desired, scaled, warm, x, state);
}

/* Return whether numbers are finite, not too large, and not too small for a requested norm. */
static bool are_moderate(const problem_t *p, int n)
{
    for (int i = 0, first = 0; i < p->levels; first = p->ends[i++]) {
        int rows = p->ends[i] - first;
        double most = 0.0;
        for (int j = first * n; j < p->ends[i] * n && !p->scales; j++)
            most = fmax(most, fabs(p->A[j]));
        double size = dot(p->A + first * n, p->A + first * n, rows * n);
        size += dot(p->b + first, p->b + first, rows);
        bool has_norm = most == 0.0 || most >= SMALLEST;
        if (!(size < LARGEST * LARGEST) || !has_norm)
            return false;
    }
    return true;
}

/* Return the largest number of rows in M: those of a level with a norm. */
static int64_t most_rows(const lexicographic_problem *p)
{
    int first = 0, most = p->n;
    for (int k = 0; k < p->levels; first = p->ends[k++])
        most = p->ends[k] - first > most ? p->ends[k] - first : most;
    return most + p->n;
}

static int64_t rows_of(const lexicographic_problem *p)
{
    return p->levels ? p->ends[p->levels - 1] : 0;
}

int64_t lexicographic_room(const lexicographic_problem *p)
{
    int64_t n = p->n, R = most_rows(p), all = rows_of(p) + n;
    int64_t weighted = p->weight ? all * (n + 1) + 3 * n + 2 * p->levels + 2 + n : 0;
    return 5 * n * n + 2 * R * n + 3 * R + 11 * n + weighted;
}

void lexicographic_solve(const lexicographic_problem *p, const double *A, const double *b,
                         const double *scales, const double *limits, const double *desired,
                         double *work, double *x, int8_t *state, double *report, int32_t *ranks)
{
    int64_t n = p->n, rows = rows_of(p), R = most_rows(p);
    work_t w = {.n = p->n, .most = p->most_steps};
    scaled_t scaled;
    problem_t one = {p->levels, p->levels, p->beside, p->tolerance, p->ends, p->damping, A, b,
                     scales, limits, limits, ranks};
    double own[OWN_ROOM], *at = work ? work : own;
    double **parts[] = {&w.V, &w.K, &w.Z, &w.L, &w.P, &w.M, &w.copy, &w.r, &w.lack,
                        &w.squares, &w.beta, &w.Z_beta, &w.c, &w.t, &w.lambda, &w.step, &w.move,
                        &w.size, &w.none};
    for (int i = 0; i < 19; i++) {
        *parts[i] = at;
        at += i < 5 ? n * n : i < 7 ? R * n : i < 10 ? R : n;
    }
    w.active = (int32_t *)at;
    w.fixed_at = (int8_t *)(at + n);
    scaled.A = at + 2 * n;
    scaled.b = scaled.A + (rows + n) * n;
    scaled.lower = scaled.b + rows + n;
    scaled.upper = scaled.lower + n;
    scaled.x = scaled.upper + n;
    scaled.scales = scaled.x + n;
    scaled.ends = (int32_t *)(scaled.scales + p->levels + 1);
    scaled.state = (int8_t *)(scaled.scales + 2 * p->levels + 2);
    for (int64_t k = 0; k < p->count; k++) {
        int64_t of_matrix = k % p->matrices, of_bounds = 2 * (k % p->bounds) * n;
        one.A = A + of_matrix * rows * n;
        one.b = b + k * rows;
        one.scales = scales ? scales + of_matrix * p->levels : 0;
        one.lower = limits + of_bounds;
        one.upper = one.lower + n;
        one.ranks = ranks ? ranks + k * p->levels : 0;
        w.steps = 0;
        w.gaps[0] = w.gaps[1] = INFINITY;
        double *result = report + 4 * k;
        result[0] = 0.0;
        result[1] = -1.0;
        result[2] = result[3] = 1.0;
        if (!are_moderate(&one, p->n))
            continue;
        result[1] = solve_weighted(&w, &one, p->weight, p->weight ? desired + k * n : 0, &scaled,
                                 p->warm, x + k * n, state + k * n);
        result[0] = w.steps;
        result[2] = w.gaps[0];
        result[3] = w.gaps[1];
    }
}
