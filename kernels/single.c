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

/* How a point moves to within limits, of which k hold. */
typedef struct {
    int n, d, k;
    double *C;      /* motions C y that keep what is met, (n, d) */
    double *column; /* norm of each column of the rows that C y leaves, (n,) */
    double *norm;   /* of each row of C, (n,) */
    double *most;   /* largest size of each unknown on its way, (n,) */
    double *sides;  /* 1 where a lower limit holds, -1 where an upper one does, else 0, (n,) */
    double *u;      /* multipliers of those that hold, (d + 1,) */
    double *r;      /* their change, (d,) */
    double *v;      /* (d,) */
    int *held;      /* unknowns whose limits hold, (d,) */
} motion;

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

/* Room for what `motion_in` makes of it. */
static int room_within(int n)
{
    return n * (n + 8) + 1;
}

static motion motion_in(double *work, int n, int d)
{
    motion o = {.n = n, .d = d, .k = 0, .C = work};
    o.column = o.C + n * d;
    o.norm = o.column + n;
    o.most = o.norm + n;
    o.sides = o.most + n;
    o.u = o.sides + n;
    o.r = o.u + d + 1;
    o.v = o.r + d;
    o.held = (int *)(o.v + d);
    return o;
}

/* Write to C the unknowns that keep the rows which are met; the objective is |y|^2.
 *
 * It is so of C y beside the optimum; W's reflections leave the last d free, of which M's triangle
 * weighs the first q, and the identity the others.
 */
static void find_motions(motion o, const double *W, int count, const double *W_beta,
                         const double *M, int q, const double *M_diagonal, const double *w)
{
    double *x = o.norm, *free = x + o.n - o.d; /* not needed yet */
    for (int j = 0; j < o.n; j++) {
        for (int i = 0; i < o.n; i++)
            x[i] = i == j ? w[j] : 0.0;
        reflect(W, o.n, count, W_beta, x);
        for (int i = 0; i < q; i++) {
            double s = free[i];
            for (int t = 0; t < i; t++)
                s -= M[t * q + i] * free[t];
            free[i] = s / M_diagonal[i];
        }
        memcpy(o.C + j * o.d, free, (size_t)o.d * sizeof *free);
    }
}

/* Write the norms of the columns of A (rows, n). */
static void find_columns(const double *A, int rows, int n, double *norm)
{
    for (int j = 0; j < n; j++) {
        double total = 0.0;
        for (int i = 0; i < rows; i++)
            total += A[i * n + j] * A[i * n + j];
        norm[j] = sqrt(total);
    }
}

/* The unknown farthest beyond a limit, per size of its row of C, and the side; -1 if none is.
 *
 * Limits of the start come before all others. What is beyond by round-off of the largest unknown,
 * or of the rows' largest term, is not.
 */
static int most_beyond(motion o, const double *w, const double *lower, const double *upper,
                       const double *x, const int8_t *state, double *side)
{
    int chosen = -1;
    bool is_first = false;
    double farthest = 0.0, size = 0.0, term = 0.0;
    for (int j = 0; j < o.n; j++) {
        size = larger(size, o.most[j] / w[j]);
        term = larger(term, o.most[j] * o.column[j]);
    }
    for (int j = 0; j < o.n; j++) {
        double beyond = larger(lower[j] - x[j], x[j] - upper[j]);
        double allowed = o.most[j] + smaller(w[j] * size, term / o.column[j]);
        if (beyond > ROUND_OFF * allowed) {
            double towards = lower[j] > x[j] ? 1.0 : -1.0;
            bool of_start = state[j] * towards < 0.0;
            if ((of_start && !is_first)
                || (of_start == is_first && !(beyond <= farthest * o.norm[j]))) {
                chosen = j;
                *side = towards;
                farthest = beyond / o.norm[j];
                is_first = of_start;
            }
        }
    }
    return chosen;
}

/* Reflect C's columns from k on so that the row of a limit ends there. */
static void add_row(motion o, int new)
{
    double square = 0.0, *v = o.v, *own = o.C + new * o.d;
    for (int i = o.k; i < o.d; i++) {
        v[i] = own[i];
        square += v[i] * v[i];
    }
    double diagonal = -copysign(sqrt(square), v[o.k]);
    v[o.k] -= diagonal;
    double beta = 1.0 / (sqrt(square) * fabs(v[o.k]));
    for (int j = 0; j < o.n; j++) {
        double *row = o.C + j * o.d, dot = 0.0;
        for (int i = o.k; i < o.d; i++)
            dot += row[i] * v[i];
        dot *= beta;
        for (int i = o.k; i < o.d; i++)
            row[i] -= dot * v[i];
    }
    for (int i = o.k; i < o.d; i++)
        own[i] = i == o.k ? diagonal : 0.0;
}

/* Rotate C's columns so that the rows of k limits without this one are a triangle again. */
static void drop_row(motion o, int dropped)
{
    for (int a = dropped; a < o.k; a++)
        o.u[a] = o.u[a + 1];
    for (int a = dropped; a < o.k - 1; a++) {
        o.held[a] = o.held[a + 1];
        double *own = o.C + o.held[a] * o.d + a;
        double size = hypot(own[0], own[1]), cos = own[0] / size, sin = own[1] / size;
        for (int j = 0; j < o.n; j++) {
            double *row = o.C + j * o.d + a, left = row[0], right = row[1];
            row[0] = cos * left + sin * right;
            row[1] = cos * right - sin * left;
        }
        own[1] = 0.0;
    }
}

/* |L^-1|^2 of the rows of limits over weights, whose triangle L stands in C. */
static double inverse_of_held(motion o, const double *w)
{
    double total = 0.0;
    for (int c = 0; c < o.k; c++) {
        for (int a = c; a < o.k; a++) {
            const double *own = o.C + o.held[a] * o.d;
            double s = a == c ? w[o.held[a]] : 0.0;
            for (int b = c; b < a; b++)
                s -= own[b] * o.v[b];
            o.v[a] = s / own[a];
            total += o.v[a] * o.v[a];
        }
    }
    return total;
}

/* Move x by C y, |y| least, to within its limits; the steps taken, or -1 where in doubt.
 *
 * A dual active-set method (Goldfarb, Idnani, Math. Programming 27, 1983): k limits hold, whose
 * rows of C are kept a lower triangle by orthogonal changes of y, and u are their multipliers. w is
 * the unit of each unknown, `most_inverse` as above; x is what is nearest without limits. `state`
 * are limits to begin with, -1 lower, 1 upper, 0 none; overwritten with those that hold.
 */
static int hold(motion o, const double *w, double most_inverse, const double *lower,
                const double *upper, double *x, int8_t *state)
{
    int steps = 0, new;
    double side = 0.0;
    for (int j = 0; j < o.n; j++) {
        o.norm[j] = sqrt(sum_of_squares(o.C + j * o.d, o.d));
        o.most[j] = fabs(x[j]);
        o.sides[j] = 0.0;
    }
    while ((new = most_beyond(o, w, lower, upper, x, state, &side)) >= 0) {
        const double *own = o.C + new * o.d;
        double limit = side > 0.0 ? lower[new] : upper[new];
        int dropped = 0;
        o.u[o.k] = 0.0;
        while (dropped >= 0) {
            steps++;
            double square = sum_of_squares(own + o.k, o.d - o.k);
            bool moves = square > squared(DEPENDENT * o.norm[new]);
            double length = moves ? side * (limit - x[new]) / square : INFINITY;
            dropped = -1;
            for (int a = o.k - 1; a >= 0; a--) {
                int j = o.held[a];
                double s = own[a];
                for (int b = a + 1; b < o.k; b++)
                    s -= o.C[o.held[b] * o.d + a] * o.v[b];
                o.v[a] = s / o.C[j * o.d + a];
                o.r[a] = side * o.sides[j] * o.v[a];
                /* What is fixed may be pushed either way. */
                if (lower[j] < upper[j] && o.r[a] > 0.0 && o.u[a] < length * o.r[a]) {
                    length = o.u[a] / o.r[a];
                    dropped = a;
                }
            }
            if (length == INFINITY || steps > STEPS * (o.n + 1))
                return -1;
            for (int j = 0; j < o.n && moves; j++) {
                double dot = 0.0;
                for (int i = o.k; i < o.d; i++)
                    dot += o.C[j * o.d + i] * own[i];
                x[j] += length * side * dot;
                o.most[j] = larger(o.most[j], fabs(x[j]));
            }
            for (int a = 0; a < o.k; a++)
                o.u[a] -= length * o.r[a];
            o.u[o.k] += length;
            if (dropped < 0) {
                if (square < squared(REGULAR * o.norm[new]))
                    return -1;
                add_row(o, new);
                o.held[o.k] = new;
                o.sides[new] = side;
                x[new] = limit;
                o.k++;
            } else {
                o.sides[o.held[dropped]] = 0.0;
                drop_row(o, dropped);
                o.k--;
            }
        }
    }
    if (!(inverse_of_held(o, w) < most_inverse))
        return -1;
    for (int j = 0; j < o.n; j++) {
        if (o.sides[j] == 0.0 && fabs(x[j]) < CANCELLED * o.most[j])
            return -1;
        state[j] = (int8_t)-o.sides[j];
        x[j] = smaller(larger(x[j], lower[j]), upper[j]);
    }
    return steps;
}

/* Whether each number of x is between its limits (2, n). */
static bool is_within(const double *limits, const double *x, int n)
{
    for (int j = 0; j < n; j++)
        if (!(limits[j] <= x[j] && x[j] <= limits[n + j]))
            return false;
    return true;
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

int single_arguments(single_sizes z)
{
    return places_of(z).W1;
}

int single_room(single_sizes z)
{
    return places_of(z).c + z.n + z.k1 + z.k2;
}

int single_work(single_sizes z)
{
    return room_within(z.n) + z.n + z.k1 + z.k2;
}

int single_factor(single_sizes z, const double *J, const double *S_m, const double *S_s,
                  const double *W1, const double *W2, double scale, double clear, double exact,
                  double *F)
{
    return factor_at(F, z, J, weigh(F, z, S_m, S_s, W1, W2), scale, clear, exact);
}

int single_factor_diagonals(single_sizes z, const double *J, const double *S_m, const double *S_s,
                            const double *w1, const double *w2, double scale, double clear,
                            double exact, double *F)
{
    places a = places_of(z);
    memcpy(F + a.S, S_m, (size_t)(z.p * z.m) * sizeof *F);
    for (int i = 0; i < z.k1; i++)
        for (int j = 0; j < z.n; j++)
            F[a.W1 + i * z.n + j] = i == j ? w1[i] : 0.0;
    for (int i = 0; i < z.k2; i++) {
        for (int t = 0; t < z.m2; t++)
            F[a.W2 + i * z.m2 + t] = i == t ? w2[i] : 0.0;
        for (int t = 0; t < z.m; t++)
            F[a.G + i * z.m + t] = w2[i] * S_s[i * z.m + t];
    }
    return factor_at(F, z, J, z.k1 > 0, scale, clear, exact);
}

int single_apply(single_sizes z, const double *F, const double *v, const double *rates_d,
                 const double *v_sd, double *work, double *x)
{
    if (!is_moderate(z, v, rates_d, v_sd))
        return REFUSED;
    apply(F, z, v, rates_d, v_sd, work, x);
    return CLEAR;
}

int single_within(single_sizes z, const double *F, const double *limits, double *work, double *x,
                  int8_t *state)
{
    if (is_within(limits, x, z.n)) {
        memset(state, 0, (size_t)z.n);
        return 0;
    }
    places a = places_of(z);
    shape s = shape_of(F[0] == 1.0, z);
    motion o = motion_in(work, z.n, z.n - z.p);
    find_motions(o, F + a.W, s.count, F + a.W_beta, F + a.M, s.q, F + a.M_diagonal, F + a.w);
    find_columns(F + a.J, z.m, z.n, o.column);
    return hold(o, F + a.w, F[a.most], limits, limits + z.n, x, state);
}

int single_apply_within(single_sizes z, const double *F, const double *v, const double *rates_d,
                        const double *v_sd, const double *limits, double *work, double *x)
{
    int8_t *state = (int8_t *)(work + room_within(z.n));
    if (single_apply(z, F, v, rates_d, v_sd, work, x) == REFUSED)
        return REFUSED;
    memset(state, 0, (size_t)z.n);
    return single_within(z, F, limits, work, x, state) < 0 ? IN_DOUBT : CLEAR;
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

void single_solve_each(single_sizes z, int count, const int64_t *each, const double *J,
                       const double *S_m, const double *S_s, const double *W1, const double *W2,
                       const double *scale, double clear, double exact, const double *v,
                       const double *rates_d, const double *v_sd, double *F, double *x, bool *ok)
{
    bool is_diagonal = false;
    for (int k = 0; k < count; k++) {
        if (k == 0 || each[1] || each[2])
            is_diagonal = weigh(F, z, S_m, S_s, W1 + each[1] * k, W2 + each[2] * k);
        ok[k] = factor_at(F, z, J + each[0] * k, is_diagonal, scale[each[3] * k], clear, exact)
                == CLEAR;
        if (ok[k])
            apply(F, z, v + k * z.p, rates_d + k * z.n, v_sd + k * z.m2, F + places_of(z).c,
                  x + k * z.n);
    }
}

void single_levels(single_sizes z, const double *F, const double *v, const double *rates_d,
                   const double *v_sd, double exact, double *A, double *b, double *scales)
{
    places a = places_of(z);
    int rows = z.p + z.k1 + z.k2 + z.n;
    memset(A, 0, (size_t)(rows * z.n) * sizeof *A);
    memset(b, 0, (size_t)rows * sizeof *b);
    for (int i = 0; i < z.p + z.k2; i++) {
        double *row = A + (i < z.p ? i : z.k1 + i) * z.n;
        for (int t = 0; t < z.m; t++) {
            double s = F[a.S + i * z.m + t]; /* then G, which comes next */
            for (int j = 0; j < z.n && s != 0.0; j++)
                row[j] += s * F[a.J + t * z.n + j];
        }
    }
    memcpy(b, v, (size_t)z.p * sizeof *b);
    for (int i = 0; i < z.k1; i++)
        for (int j = 0; j < z.n; j++) {
            double w = F[a.W1 + i * z.n + j];
            A[(z.p + i) * z.n + j] = w;
            b[z.p + i] += w * rates_d[j];
        }
    for (int i = 0; i < z.k2; i++)
        for (int t = 0; t < z.m2; t++)
            b[z.p + z.k1 + i] += F[a.W2 + i * z.m2 + t] * v_sd[t];
    for (int j = 0; j < z.n; j++)
        A[(z.p + z.k1 + z.k2 + j) * z.n + j] = 1.0;
    double scale = sqrt(sum_of_squares(F + a.J, z.m * z.n));
    double square = sum_of_squares(F + a.G, z.k2 * z.m) * scale * scale;
    scales[0] = sqrt(sum_of_squares(F + a.S, z.p * z.m)) * scale;
    scales[1] = sqrt(sum_of_squares(F + a.W1, z.k1 * z.n) * exact * exact + square);
    scales[2] = 1.0;
}

bool single_copy_limits(int n, const double *lower, const double *upper, double largest,
                        double *limits)
{
    for (int i = 0; i < n; i++) {
        double low = lower[i], high = upper[i];
        /* NaN is in no order. */
        if (!(low <= high) || low == INFINITY || high == -INFINITY)
            return false;
        if ((fabs(low) >= largest && low != -INFINITY)
            || (fabs(high) >= largest && high != INFINITY))
            return false;
        limits[i] = low;
        limits[n + i] = high;
    }
    return true;
}

void single_unpack(int n, int levels, const int64_t *ends, const double *given, double *A,
                   double *b)
{
    int64_t first = 0;
    for (int k = 0; k < levels - 1; k++) {
        int64_t rows = ends[k] - first;
        memcpy(A + first * n, given, (size_t)(rows * n) * sizeof *A);
        memcpy(b + first, given + rows * n, (size_t)rows * sizeof *b);
        given += rows * (n + 1);
        first = ends[k];
    }
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++)
            A[(first + i) * n + j] = i == j ? 1.0 : 0.0;
        b[first + i] = 0.0;
    }
}

/* Write the norms of the levels; whether no product of these numbers over- or underflows. */
static bool find_scales(int n, int levels, const int64_t *ends, const double *A, const double *b,
                        double *scales)
{
    int64_t first = 0;
    double targets = 0.0;
    for (int k = 0; k < levels; k++) {
        double square = 0.0;
        for (int64_t i = first; i < ends[k]; i++) {
            for (int j = 0; j < n; j++)
                square += A[i * n + j] * A[i * n + j];
            targets += b[i] * b[i];
        }
        if (!(1.0 / MODERATE < square && square < MODERATE))
            return false;
        scales[k] = sqrt(square);
        first = ends[k];
    }
    return targets < MODERATE;
}

/* Whether the first rows of A x are b but for round-off of their terms. */
static bool are_met(int n, const double *A, const double *b, int rows, const double *x)
{
    for (int i = 0; i < rows; i++) {
        double rest = b[i], terms = fabs(b[i]);
        for (int j = 0; j < n; j++) {
            double part = A[i * n + j] * x[j];
            rest -= part;
            terms += fabs(part);
        }
        if (!(fabs(rest) <= MISSED * terms))
            return false;
    }
    return true;
}

int single_levels_work(int n, int rows)
{
    return (3 * n + 2) * rows + 6 * n + room_within(n);
}

int single_levels_within(int n, int levels, const int64_t *ends, const double *given, double clear,
                         double largest, const double *lower, const double *upper, double *work,
                         double *found, int8_t *state)
{
    int last = 0, p = 0, all = (int)ends[levels - 1];
    double *x = found, *limits = found + n, *scales = found + 3 * n, *A = work, *b = A + all * n;
    clear = larger(clear, REGULAR);
    single_unpack(n, levels, ends, given, A, b);
    if (!single_copy_limits(n, lower, upper, largest, limits)
        || !find_scales(n, levels, ends, A, b, scales))
        return -2;
    while (ends[last] < n)
        p = (int)ends[last++];
    int rows = (int)ends[last], q = n - p, k = rows - p;
    double *W = b + all, *M = W + rows * n, *diagonal = M + k * q, *W_beta = diagonal + n;
    double *M_diagonal = W_beta + n, *M_beta = M_diagonal + n, *c = M_beta + n, *w = c + rows + n;
    memcpy(W, A, (size_t)(rows * n) * sizeof *W);
    reduce_rows(W, rows, n, p, diagonal, W_beta);
    for (int i = 0; i < k; i++)
        for (int j = 0; j < q; j++)
            M[i * q + j] = W[(p + i) * n + p + j];
    reduce_columns(M, k, q, 0, M_diagonal, M_beta);
    double doubt = 0.0;
    for (int level = 0; level < last; level++) {
        double inverse = inverse_square(W, n, 1, (int)ends[level], diagonal, c);
        double doubtful = inverse * squared(clear * scales[level]);
        if (!(doubtful < 1.0)) /* nor is NaN */
            return -1;
        doubt = larger(doubt, doubtful);
    }
    double inverse = inverse_square(M, 1, q, q, M_diagonal, c);
    if (!(inverse * squared(clear * scales[last]) < 1.0))
        return -1;
    for (int i = 0; i < rows; i++) {
        double s = b[i];
        for (int j = 0; j < i && j < p; j++)
            s -= W[i * n + j] * c[j];
        c[i] = i < p ? s / diagonal[i] : s;
    }
    least_squares(M, k, q, 0, M_diagonal, M_beta, c + p);
    reflect_back(W, n, p, W_beta, c);
    for (int j = 0; j < n; j++) {
        x[j] = c[j];
        w[j] = 1.0;
    }
    int steps = 0;
    if (is_within(limits, x, n)) {
        memset(state, 0, (size_t)n);
    } else {
        motion o = motion_in(w + n, n, q);
        find_motions(o, W, p, W_beta, M, q, M_diagonal, w);
        find_columns(A, rows, n, o.column);
        steps = hold(o, w, most_inverse(doubt, inverse), limits, limits + n, x, state);
    }
    return are_met(n, A, b, p, x) ? steps : -1;
}
