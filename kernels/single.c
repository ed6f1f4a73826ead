/* Problem 1 and levels of least squares where all ranks are clearly full.
 *
 * Householder reflections decide that, once for a J and its weights; the factors then solve for one
 * target after another. All numbers of a problem stand in one array F, which no call for a target
 * changes: threads may share it.
 */
#include <math.h>
#include <string.h>

#include "kernels.h"

/* Sum of the squares of numbers that the argument checks let pass. */
static const double LARGEST = 1e240;
/* Sum of squares up to which, and from the inverse of which on, no product over- or underflows. */
static const double MODERATE = 1e100;
/* Part of the unknowns by which one may be beyond its limit before it is put on it. */
static const double ROUND_OFF = 1e-14;
/* Part of a limit's row that is round-off where the row depends on those of other limits. */
static const double DEPENDENT = 1e-12;
/* Part of the scale, also the sine of an angle, above which any way finds nine digits. */
static const double REGULAR = 1e-6;
/* Where this fraction of an unknown is left, it has lost digits on its way. */
static const double CANCELLED = 1e-3;
/* Part of a row's terms that round-off leaves of unknowns of one kind. */
static const double MISSED = 1e-12;
/* Of the active set for each unknown; where there are more, another method decides. */
static const int STEPS = 6;

/* Where the parts of F begin; F[0] is 1 where rates are scaled by their weights. */
typedef struct {
    int S;          /* S_m, (p, m) */
    int G;          /* W2 S_s, (k2, m) */
    int w;          /* inverse joint weights, or ones, (n,) */
    int W1;         /* (k1, n) */
    int W2;         /* (k2, m2) */
    int J;          /* (m, n) */
    int W;          /* rows, reduced by reflections from the right */
    int M;          /* what they leave free, reduced by reflections from the left */
    int W_diagonal; /* (n,), as are the next three */
    int W_beta;
    int M_diagonal;
    int M_beta;
    int most;       /* |L^-1|^2 of limits' rows up to which ranks are clear where these hold */
    int c;          /* room for the right side of M, (n + k1 + k2,) */
} places;

/* Rows of W, how many of them are reflected, and rows and columns of M. */
typedef struct {
    int rows, count, k, q;
} shape;

/* Rows that are met by reflections of W, and M's triangle, which weighs what they leave free. */
typedef struct {
    const double *W, *W_beta, *M, *M_diagonal;
    int n, count, q;
} reduced;

static double larger(double a, double b)
{
    return b > a ? b : a;
}

static double smaller(double a, double b)
{
    return b < a ? b : a;
}

static double squared(double a)
{
    return a * a;
}

/* Sum of the squares of some numbers. */
static double sum_of_squares(const double *x, int count)
{
    double total = 0.0;
    for (int i = 0; i < count; i++)
        total += x[i] * x[i];
    return total;
}

static places places_of(single_sizes z)
{
    places a;
    a.S = 1;
    a.G = a.S + z.p * z.m;
    a.w = a.G + z.k2 * z.m;
    a.W1 = a.w + z.n;
    a.W2 = a.W1 + z.k1 * z.n;
    a.J = a.W2 + z.k2 * z.m2;
    a.W = a.J + z.m * z.n;
    a.M = a.W + (z.p + z.k1 + z.k2) * z.n;
    a.W_diagonal = a.M + (z.n + z.k1 + z.k2) * z.n;
    a.W_beta = a.W_diagonal + z.n;
    a.M_diagonal = a.W_beta + z.n;
    a.M_beta = a.M_diagonal + z.n;
    a.most = a.M_beta + z.n;
    a.c = a.most + 1;
    return a;
}

static shape shape_of(bool scaled, single_sizes z)
{
    shape s = {z.p + z.k1 + z.k2, z.p, z.k1 + z.k2, z.n - z.p};
    if (scaled) {
        /* All rows of the task where that leaves fewer unknowns, else those of the major task. */
        s.rows = z.p + z.k2;
        s.count = s.rows < z.n ? s.rows : z.p;
        s.q = s.count > z.p ? z.k2 : z.n - z.p;
        s.k = s.q + z.k2;
    }
    return s;
}

/* Apply the reflection that stands in `own`, from number `first` on, to n numbers at x. */
static void reflect_one(const double *own, double beta, double *x, int first, int n)
{
    double dot = 0.0;
    for (int j = first; j < n; j++)
        dot += own[j] * x[j];
    dot *= beta;
    for (int j = first; j < n; j++)
        x[j] -= dot * own[j];
}

/* Reduce the first rows of W to a lower triangle by reflections from the right.
 *
 * A reflection stands in its row from the diagonal on; the diagonal itself in `diagonal`.
 */
static void reduce_rows(double *W, int rows, int n, int count, double *diagonal, double *beta)
{
    for (int i = 0; i < count; i++) {
        double *own = W + i * n;
        double norm = sqrt(sum_of_squares(own + i, n - i));
        double first = copysign(norm, own[i]);
        own[i] += first;
        diagonal[i] = -first;
        beta[i] = norm > 0.0 ? 1.0 / (norm * fabs(own[i])) : 0.0;
        for (int r = i + 1; r < rows; r++)
            reflect_one(own, beta[i], W + r * n, i, n);
    }
}

/* Apply these reflections to a vector. */
static void reflect(const double *W, int n, int count, const double *beta, double *x)
{
    for (int i = 0; i < count; i++)
        reflect_one(W + i * n, beta[i], x, i, n);
}

/* The same, the last of them first. */
static void reflect_back(const double *W, int n, int count, const double *beta, double *x)
{
    for (int i = count - 1; i >= 0; i--)
        reflect_one(W + i * n, beta[i], x, i, n);
}

/* Reduce M (k, q) to an upper triangle by reflections from the left, stored likewise.
 *
 * Of each column only the diagonal and the rows from `below` on are not zero yet.
 */
static void reduce_columns(double *M, int k, int q, int below, double *diagonal, double *beta)
{
    for (int c = 0; c < q; c++) {
        int start = below > c + 1 ? below : c + 1;
        double *row = M + c * q;
        double square = row[c] * row[c];
        for (int r = start; r < k; r++)
            square += M[r * q + c] * M[r * q + c];
        double norm = sqrt(square), first = copysign(norm, row[c]);
        row[c] += first;
        diagonal[c] = -first;
        beta[c] = norm > 0.0 ? 1.0 / (norm * fabs(row[c])) : 0.0;
        for (int j = c + 1; j < q; j++) {
            double dot = row[c] * row[j];
            for (int r = start; r < k; r++)
                dot += M[r * q + c] * M[r * q + j];
            dot *= beta[c];
            row[j] -= dot * row[c];
            for (int r = start; r < k; r++)
                M[r * q + j] -= dot * M[r * q + c];
        }
    }
}

/* Minimize |M z - c| by the factors of M; z is then the first part of c. */
static void least_squares(const double *M, int k, int q, int below, const double *diagonal,
                          const double *beta, double *c)
{
    for (int j = 0; j < q; j++) {
        int start = below > j + 1 ? below : j + 1;
        double on = M[j * q + j], dot = on * c[j];
        for (int r = start; r < k; r++)
            dot += M[r * q + j] * c[r];
        dot *= beta[j];
        c[j] -= dot * on;
        for (int r = start; r < k; r++)
            c[r] -= dot * M[r * q + j];
    }
    for (int i = q - 1; i >= 0; i--) {
        double z = c[i];
        for (int j = i + 1; j < q; j++)
            z -= M[i * q + j] * c[j];
        c[i] = z / diagonal[i];
    }
}

/* Squared Frobenius norm of the inverse of a triangle, not finite if that is singular.
 *
 * Its number (i, j) below the diagonal stands at T[i * down + j * right].
 */
static double inverse_square(const double *T, int down, int right, int size,
                             const double *diagonal, double *column)
{
    double total = 0.0;
    for (int k = 0; k < size; k++) { /* a column of the inverse, of T^T for an upper triangle */
        for (int i = k; i < size; i++) {
            double s = i == k ? 1.0 : 0.0;
            for (int j = k; j < i; j++)
                s -= T[i * down + j * right] * column[j];
            column[i] = s / diagonal[i];
            total += column[i] * column[i];
        }
    }
    return total;
}

/* Square of |L^-1|, L C's rows of limits, up to which no rank is in doubt where these hold.
 *
 * Of unknowns that are zero, rows of least singular value s keep s sin(phi) at least, phi the angle
 * between them and these unknowns; and sin(phi) is no less than 1 / (|L^-1| |R^-1|), R the factor
 * of the objective. `doubt` is the largest square of what is in doubt over s, of all rows that must
 * be met, and `inverse` is |R^-1|^2 at most.
 */
static double most_inverse(double doubt, double inverse)
{
    return smaller(1.0 / doubt, 1.0 / squared(REGULAR)) / inverse;
}

/* Whether the ranks are clearly full; F is given S, G, W1, W2 and J, and gets the rest. */
static int factor(double *F, single_sizes z, bool is_diagonal, double size_1, double size_2,
                  double scale, double clear, double exact)
{
    places a = places_of(z);
    const double *J = F + a.J, *W1 = F + a.W1;
    double *W = F + a.W, *M = F + a.M, *w = F + a.w, *W_diagonal = F + a.W_diagonal;
    double sizes[] = {sum_of_squares(J, z.m * z.n), size_1, size_2};
    if (!(sizes[0] + size_1 + size_2 < LARGEST))
        return REFUSED;
    for (int i = 0; i < 3; i++)
        if (sizes[i] > MODERATE || (0.0 < sizes[i] && sizes[i] < 1.0 / MODERATE))
            return IN_DOUBT;
    scale = scale < 0.0 ? sqrt(sizes[0]) : scale;
    if (!(0 < z.p && z.p <= z.n && z.n <= z.p + z.k1 + z.k2 && z.k1 + z.k2 > 0 && scale > 0.0))
        return IN_DOUBT;
    double least = INFINITY, most = 0.0;
    for (int j = 0; j < z.n && is_diagonal; j++) {
        least = smaller(least, fabs(W1[j * z.n + j]));
        most = larger(most, fabs(W1[j * z.n + j]));
    }
    bool scaled = is_diagonal && least * SPREAD > most;
    F[0] = scaled ? 1.0 : 0.0;
    for (int j = 0; j < z.n; j++)
        w[j] = scaled ? 1.0 / W1[j * z.n + j] : 1.0;
    shape s = shape_of(scaled, z);
    for (int i = 0; i < z.p + z.k2; i++) {
        double *row = W + (i < z.p ? i : s.rows - z.k2 + i - z.p) * z.n;
        memset(row, 0, (size_t)z.n * sizeof *row);
        for (int t = 0; t < z.m; t++) {
            double number = F[a.S + i * z.m + t]; /* then G, which comes next */
            for (int j = 0; j < z.n && number != 0.0; j++)
                row[j] += number * J[t * z.n + j];
        }
        for (int j = 0; j < z.n && scaled; j++)
            row[j] *= w[j];
    }
    for (int i = 0; i < z.k1 * z.n && !scaled; i++)
        W[z.p * z.n + i] = W1[i];
    reduce_rows(W, s.rows, z.n, s.count, W_diagonal, F + a.W_beta);
    /* In rates times weights the joint weights are the identity, before and after reflections. */
    for (int i = 0; i < s.k; i++) {
        int task = scaled ? i - s.q : i;
        for (int j = 0; j < s.q; j++) {
            double value;
            if (task < 0)
                value = i == j ? 1.0 : 0.0;
            else if (s.count > z.p && j >= task)
                value = j == task ? W_diagonal[z.p + j] : 0.0;
            else
                value = W[(z.p + task) * z.n + z.p + j];
            M[i * s.q + j] = value;
        }
    }
    reduce_columns(M, s.k, s.q, scaled ? s.q : 0, F + a.M_diagonal, F + a.M_beta);

    double least_A = clear * sqrt(sum_of_squares(F + a.S, z.p * z.m)) * scale;
    double least_M = clear * sqrt(size_1 * exact * exact + size_2 * scale * scale);
    double inverse_A = inverse_square(W, z.n, 1, z.p, W_diagonal, F + a.c), inverse_M = 1.0;
    double doubt_A, doubt_M;
    if (scaled) {
        /* The least singular value of J_m is at least that of J_m / w times the least weight. */
        doubt_A = inverse_A * squared(least_A / least);
        doubt_M = squared(least_M / least);
    } else {
        inverse_M = inverse_square(M, 1, s.q, s.q, F + a.M_diagonal, F + a.c);
        doubt_A = inverse_A * squared(least_A);
        doubt_M = inverse_M * squared(least_M);
    }
    F[a.most] = most_inverse(doubt_A * squared(larger(1.0, REGULAR / clear)), inverse_M);
    return doubt_A < 1.0 && doubt_M < 1.0 ? CLEAR : IN_DOUBT;
}

/* Write the optimal rates of a target to x; c is room for n + k1 + k2 numbers. */
static void apply(const double *F, single_sizes z, const double *v, const double *rates_d,
                  const double *v_sd, double *c, double *x)
{
    places a = places_of(z);
    const double *W = F + a.W, *w = F + a.w, *W1 = F + a.W1, *W2 = F + a.W2;
    bool scaled = F[0] == 1.0;
    shape s = shape_of(scaled, z);
    int above = s.k - z.k2, first = scaled ? above : 0;
    for (int j = 0; j < z.n; j++)
        x[j] = rates_d[j] / w[j];
    if (scaled)
        reflect(W, z.n, s.count, F + a.W_beta, x);
    for (int i = 0; i < above; i++) {
        double total = scaled ? x[z.p + i] : 0.0;
        for (int j = 0; j < z.n && !scaled; j++)
            total += W1[i * z.n + j] * rates_d[j];
        c[i] = total;
    }
    for (int i = 0; i < z.k2; i++) {
        double total = 0.0;
        for (int t = 0; t < z.m2; t++)
            total += W2[i * z.m2 + t] * v_sd[t];
        c[above + i] = total;
    }
    for (int i = 0; i < z.p; i++) {
        double rest = v[i];
        for (int j = 0; j < i; j++)
            rest -= W[i * z.n + j] * x[j];
        x[i] = rest / F[a.W_diagonal + i];
    }
    for (int i = first; i < s.k; i++) {
        double rest = c[i];
        for (int j = 0; j < z.p; j++)
            rest -= W[(z.p + i - first) * z.n + j] * x[j];
        c[i] = rest;
    }
    least_squares(F + a.M, s.k, s.q, scaled ? s.q : 0, F + a.M_diagonal, F + a.M_beta, c);
    for (int i = 0; i < s.q; i++)
        x[z.p + i] = c[i];
    reflect_back(W, z.n, s.count, F + a.W_beta, x);
    for (int j = 0; j < z.n; j++)
        x[j] *= w[j];
}

/* Copy directions and weights to F; whether W1 is diagonal. */
static bool weigh(double *F, single_sizes z, const double *S_m, const double *S_s,
                  const double *W1, const double *W2)
{
    places a = places_of(z);
    bool is_diagonal = z.k1 == z.n;
    memcpy(F + a.S, S_m, (size_t)(z.p * z.m) * sizeof *F);
    memcpy(F + a.W2, W2, (size_t)(z.k2 * z.m2) * sizeof *F);
    for (int i = 0; i < z.k1; i++)
        for (int j = 0; j < z.n; j++) {
            F[a.W1 + i * z.n + j] = W1[i * z.n + j];
            is_diagonal = is_diagonal && (i == j || W1[i * z.n + j] == 0.0);
        }
    for (int i = 0; i < z.k2; i++)
        for (int t = 0; t < z.m; t++) {
            double total = 0.0;
            for (int u = 0; u < z.m2; u++)
                total += W2[i * z.m2 + u] * S_s[u * z.m + t];
            F[a.G + i * z.m + t] = total;
        }
    return is_diagonal;
}

/* Take J to F, which has directions and weights already; see `factor`. */
static int factor_at(double *F, single_sizes z, const double *J, bool is_diagonal, double scale,
                     double clear, double exact)
{
    places a = places_of(z);
    memcpy(F + a.J, J, (size_t)(z.m * z.n) * sizeof *F);
    double size_1 = sum_of_squares(F + a.W1, z.k1 * z.n);
    double size_2 = sum_of_squares(F + a.G, z.k2 * z.m);
    return factor(F, z, is_diagonal, size_1, size_2, scale, clear, exact);
}

/* Whether the numbers of a target are finite and not too large. */
static bool is_moderate(single_sizes z, const double *v, const double *rates_d, const double *v_sd)
{
    return sum_of_squares(v, z.p) < LARGEST && sum_of_squares(rates_d, z.n) < LARGEST
           && sum_of_squares(v_sd, z.m2) < LARGEST;
}

int single_room(single_sizes z)
{
    return places_of(z).c + z.n + z.k1 + z.k2;
}

int single_work(single_sizes z)
{
    return z.n * (z.n + 10) + z.k1 + z.k2 + 1;
}

int single_factor(single_sizes z, const double *J, const double *S_m, const double *S_s,
                  const double *W1, const double *W2, double scale, double clear, double exact,
                  double *F)
{
    return factor_at(F, z, J, weigh(F, z, S_m, S_s, W1, W2), scale, clear, exact);
}

int single_apply(single_sizes z, const double *F, const double *v, const double *rates_d,
                 const double *v_sd, double *work, double *x)
{
    if (!is_moderate(z, v, rates_d, v_sd))
        return REFUSED;
    apply(F, z, v, rates_d, v_sd, work, x);
    return CLEAR;
}

int single_solve(single_sizes z, const double *J, const double *S_m, const double *S_s,
                 const double *W1, const double *W2, double scale, double clear, double exact,
                 const double *v, const double *rates_d, const double *v_sd, double *F, double *x)
{
    if (!is_moderate(z, v, rates_d, v_sd))
        return REFUSED;
    int found = single_factor(z, J, S_m, S_s, W1, W2, scale, clear, exact, F);
    if (found == CLEAR)
        apply(F, z, v, rates_d, v_sd, F + places_of(z).c, x);
    return found;
}
