/* Problem 1 for a batch of Jacobians with common diagonal weights, 16 problems at a time.
 *
 * The same method as in single.c, with the number of the problem as the innermost index, so that
 * the processor works on several at once.
 */
#include <math.h>
#include <string.h>

#include "kernels.h"

/* Sum of squares up to which, and from the inverse of which on, no product over- or underflows. */
static const double MODERATE = 1e100;

/* A number of each problem; in C99 no pointer to such arrays becomes one to const. */
typedef double lanes[LANES];

static void fill(lanes x, double value)
{
    for (int s = 0; s < LANES; s++)
        x[s] = value;
}

/* x += a * b. */
static void add_product(lanes x, const lanes a, const lanes b)
{
    for (int s = 0; s < LANES; s++)
        x[s] += a[s] * b[s];
}

/* x -= a * b. */
static void take_product(lanes x, const lanes a, const lanes b)
{
    for (int s = 0; s < LANES; s++)
        x[s] -= a[s] * b[s];
}

static void divide(lanes x, const lanes y)
{
    for (int s = 0; s < LANES; s++)
        x[s] /= y[s];
}

/* A reflection of a vector whose squares sum up to `square`: its first number, and its factor. */
static void make_reflection(const lanes square, lanes first, lanes diagonal, lanes beta)
{
    for (int s = 0; s < LANES; s++) {
        double norm = sqrt(square[s]);
        diagonal[s] = -copysign(norm, first[s]);
        first[s] -= diagonal[s];
        beta[s] = 1.0 / (norm * fabs(first[s]));
    }
}

/* Apply the reflection that stands in `own` to the numbers from `first` on of vectors x (n,). */
static void reflect(lanes *own, const lanes beta, lanes *x, int first, int n)
{
    lanes dot;
    fill(dot, 0.0);
    for (int j = first; j < n; j++)
        add_product(dot, own[j], x[j]);
    for (int s = 0; s < LANES; s++)
        dot[s] *= beta[s];
    for (int j = first; j < n; j++)
        take_product(x[j], dot, own[j]);
}

/* Reduce the first rows of W (rows, n) to lower triangles by reflections. */
static void reduce_rows(lanes *W, int rows, int n, int count, lanes *diagonal, lanes *beta)
{
    for (int i = 0; i < count; i++) {
        lanes *own = W + i * n, square;
        fill(square, 0.0);
        for (int j = i; j < n; j++)
            add_product(square, own[j], own[j]);
        make_reflection(square, own[i], diagonal[i], beta[i]);
        for (int r = i + 1; r < rows; r++)
            reflect(own, beta[i], W + r * n, i, n);
    }
}

/* Minimize |M_1 z - c| with M = [M_1, c], (q + k2, q + 1), its first q rows triangular.
 *
 * Rows from q on are full, of the others only the diagonal and the last column count.
 */
static void least_squares(lanes *M, int q, int k2, lanes *z)
{
    int columns = q + 1;
    lanes dot, beta;
    for (int c = 0; c < q; c++) {
        lanes *own = M + c * columns, *below = M + q * columns;
        fill(dot, 0.0);
        add_product(dot, own[c], own[c]);
        for (int r = 0; r < k2; r++)
            add_product(dot, below[r * columns + c], below[r * columns + c]);
        make_reflection(dot, own[c], z[c], beta);
        for (int j = c + 1; j < columns; j++) {
            fill(dot, 0.0);
            add_product(dot, own[c], own[j]);
            for (int r = 0; r < k2; r++)
                add_product(dot, below[r * columns + c], below[r * columns + j]);
            for (int s = 0; s < LANES; s++)
                dot[s] *= beta[s];
            take_product(own[j], dot, own[c]);
            for (int r = 0; r < k2; r++)
                take_product(below[r * columns + j], dot, below[r * columns + c]);
        }
    }
    for (int i = q - 1; i >= 0; i--) {
        memcpy(dot, M[i * columns + q], sizeof(lanes));
        for (int j = i + 1; j < q; j++)
            take_product(dot, M[i * columns + j], z[j]);
        divide(dot, z[i]);
        memcpy(z[i], dot, sizeof(lanes));
    }
}

/* Write |L^-1|^2 of the leading triangles of W; not finite where one is singular. */
static void inverse_square(lanes *W, int n, int p, lanes *diagonal, lanes *column,
                           lanes total)
{
    fill(total, 0.0);
    for (int k = 0; k < p; k++)
        for (int i = k; i < p; i++) {
            fill(column[i], i == k ? 1.0 : 0.0);
            for (int j = k; j < i; j++)
                take_product(column[i], W[i * n + j], column[j]);
            divide(column[i], diagonal[i]);
            add_product(total, column[i], column[i]);
        }
}

/* Write the rows S J / w to W, S (rows, m) and J as it stands in T. */
static void make_rows(lanes *T, const double *S, int rows, int m, int n, const double *w,
                      lanes *W)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < n; j++) {
            fill(W[i * n + j], 0.0);
            for (int t = 0; t < m; t++) {
                double factor = S[i * m + t] / w[j];
                for (int s = 0; s < LANES && factor != 0.0; s++)
                    W[i * n + j][s] += factor * T[t * n + j][s];
            }
        }
}

int batch_work(single_sizes z)
{
    int tasks = z.p + z.k2, columns = z.n + 1;
    return LANES * (z.m * z.n + tasks * z.n + (z.n + z.k2 + 1) * columns + 3 * z.n);
}

void batch_solve_each(single_sizes z, int count, const double *J, const double *S_m,
                      const double *G, const double *w, const double *W2, const double *scale,
                      int each, double clear, double exact, const double *v,
                      const double *rates_d, const double *v_sd, double *work, double *x, bool *ok)
{
    int p = z.p, m = z.m, n = z.n, k2 = z.k2, m2 = z.m2;
    /* All rows of the task where that leaves fewer unknowns, else those of the major task. */
    int reflected = p + k2 < n ? p + k2 : p, q = reflected > p ? k2 : n - p, columns = q + 1;
    lanes *T = (lanes *)work, *W = T + m * n, *M = W + (p + k2) * n, *y = M + (q + k2) * columns;
    lanes *X = y + q, *diagonal = X + n, *beta = diagonal + n, size, inverse;
    double least = INFINITY, size_1 = 0.0, size_S = 0.0, size_2 = 0.0;
    for (int j = 0; j < n; j++) {
        least = fabs(w[j]) < least ? fabs(w[j]) : least;
        size_1 += w[j] * w[j];
    }
    for (int i = 0; i < p * m; i++)
        size_S += S_m[i] * S_m[i];
    for (int i = 0; i < k2 * m; i++)
        size_2 += G[i] * G[i];
    for (int base = 0; base < count; base += LANES) {
        int problem[LANES];
        for (int s = 0; s < LANES; s++) {
            int k = problem[s] = base + s < count ? base + s : count - 1; /* repeats the last */
            const double *own = J + (int64_t)k * m * n;
            size[s] = 0.0;
            for (int i = 0; i < m * n; i++) {
                T[i][s] = own[i];
                size[s] += own[i] * own[i];
            }
            for (int j = 0; j < n; j++)
                X[j][s] = rates_d[k * n + j] * w[j];
        }
        make_rows(T, S_m, p, m, n, w, W);
        make_rows(T, G, k2, m, n, w, W + p * n);
        reduce_rows(W, p + k2, n, reflected, diagonal, beta);
        for (int i = 0; i < reflected; i++)
            reflect(W + i * n, beta[i], X, i, n);
        for (int i = 0; i < q; i++) {
            for (int j = 0; j < q; j++)
                fill(M[i * columns + j], i == j ? 1.0 : 0.0);
            memcpy(M[i * columns + q], X[p + i], sizeof(lanes));
        }
        for (int i = 0; i < p; i++) {
            for (int s = 0; s < LANES; s++)
                X[i][s] = v[problem[s] * p + i];
            for (int j = 0; j < i; j++)
                take_product(X[i], W[i * n + j], X[j]);
            divide(X[i], diagonal[i]);
        }
        for (int i = 0; i < k2; i++) {
            lanes *row = M + (q + i) * columns, *of_task = W + (p + i) * n;
            fill(row[q], 0.0);
            for (int t = 0; t < m2; t++)
                if (W2[i * m2 + t] != 0.0)
                    for (int s = 0; s < LANES; s++)
                        row[q][s] += W2[i * m2 + t] * v_sd[problem[s] * m2 + t];
            for (int j = 0; j < p; j++)
                take_product(row[q], of_task[j], X[j]);
            for (int j = 0; j < q; j++) {
                if (reflected == p || j < i)
                    memcpy(row[j], of_task[p + j], sizeof(lanes));
                else if (i == j)
                    memcpy(row[j], diagonal[p + j], sizeof(lanes));
                else
                    fill(row[j], 0.0);
            }
        }
        least_squares(M, q, k2, y);
        for (int i = 0; i < q; i++)
            memcpy(X[p + i], y[i], sizeof(lanes));
        for (int i = reflected - 1; i >= 0; i--)
            reflect(W + i * n, beta[i], X, i, n);
        inverse_square(W, n, p, diagonal, beta, inverse);
        for (int s = 0; s < LANES && base + s < count; s++) {
            int k = base + s;
            for (int j = 0; j < n; j++)
                x[k * n + j] = X[j][s] / w[j];
            double of_J = scale[k * each], least_A = clear * sqrt(size_S) * of_J;
            double least_M = clear * sqrt(size_1 * exact * exact + size_2 * of_J * of_J);
            ok[k] = 1.0 / MODERATE < size[s] && size[s] < MODERATE && of_J > 0.0
                    && inverse[s] * least_A * least_A < least * least && least_M < least;
        }
    }
}
