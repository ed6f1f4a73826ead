#include <math.h>
#include <string.h>

#include "kernels.h"

enum { N = 6 };

/* Fraction of a column below which a pivot is round-off. */
static const double DEPENDENT = 1e-12;
/* Square of the largest number that the argument checks accept. */
static const double MOST = 1e240;

/* Return the sum of squares of some numbers. */
static double square(const double *x, int count)
{
    double total = 0.0;
    for (int i = 0; i < count; i++)
        total += x[i] * x[i];
    return total;
}

/* Write strut lengths at one pose and rows [(R a) x u, u]; NaN for a length of zero. */
static bool lengths_at(const strut_nodes *nodes, const double *R, const double *t, double *lengths,
                       double *A)
{
    const double *bottom = nodes->bottom_m, *top = nodes->top_m;
    bool found = true;
    for (int k = 0; k < N; k++, bottom += 3, top += 3, A += N) {
        double a0 = R[0] * top[0] + R[1] * top[1] + R[2] * top[2];
        double a1 = R[3] * top[0] + R[4] * top[1] + R[5] * top[2];
        double a2 = R[6] * top[0] + R[7] * top[1] + R[8] * top[2];
        double u0 = a0 + (t[0] - bottom[0]), u1 = a1 + (t[1] - bottom[1]);
        double u2 = a2 + (t[2] - bottom[2]), length = sqrt(u0 * u0 + u1 * u1 + u2 * u2);
        lengths[k] = length;
        found = found && length != 0.0;
        u0 = u0 / length, u1 = u1 / length, u2 = u2 / length;
        A[0] = a1 * u2 - a2 * u1, A[1] = a2 * u0 - a0 * u2, A[2] = a0 * u1 - a1 * u0;
        A[3] = u0, A[4] = u1, A[5] = u2;
    }
    return found;
}

bool strut_lengths(const strut_nodes *nodes, int poses, const double *R, const double *t,
                   double *lengths, double *A)
{
    bool found = true;
    for (int k = 0; k < poses; k++)
        found &= lengths_at(nodes, R + 9 * k, t + 3 * k, lengths + N * k, A + N * N * k);
    return found;
}

static void swap(double *x, double *y)
{
    double before = *x;
    *x = *y, *y = before;
}

/* Overwrite X (6, columns) by the solution of A X = X: Gauss, partial pivoting. */
static bool solve(const double *matrix, int columns, double *X)
{
    double A[N][N], size[N] = {0.0};
    memcpy(A, matrix, sizeof A);
    for (int i = 0; i < N; i++)
        for (int r = 0; r < N; r++)
            size[i] = fabs(A[r][i]) > size[i] ? fabs(A[r][i]) : size[i];
    for (int i = 0; i < N; i++) {
        int pivot = i;
        for (int r = i + 1; r < N; r++)
            if (fabs(A[r][i]) > fabs(A[pivot][i]))
                pivot = r;
        if (!(fabs(A[pivot][i]) > DEPENDENT * size[i]))
            return false;
        if (pivot != i) {
            for (int j = i; j < N; j++)
                swap(&A[i][j], &A[pivot][j]);
            for (int j = 0; j < columns; j++)
                swap(&X[i * columns + j], &X[pivot * columns + j]);
        }
        for (int r = i + 1; r < N; r++) {
            double factor = A[r][i] / A[i][i];
            for (int j = i + 1; j < N; j++)
                A[r][j] -= factor * A[i][j];
            for (int j = 0; j < columns; j++)
                X[r * columns + j] -= factor * X[i * columns + j];
        }
    }
    for (int i = N - 1; i >= 0; i--)
        for (int j = 0; j < columns; j++) {
            double x = X[i * columns + j];
            for (int k = i + 1; k < N; k++)
                x -= A[i][k] * X[k * columns + j];
            X[i * columns + j] = x / A[i][i];
        }
    return square(X, N * columns) < MOST; /* false for NaN */
}

bool strut_twist(const double *A, double *b)
{
    return solve(A, 1, b);
}

int follow(const strut_nodes *nodes, const double *R, const double *t, const double *A,
           const double *moved, const double *target, double *R_new, double *t_new, double *A_new,
           double *moved_new)
{
    double step[N];
    for (int k = 0; k < N; k++)
        step[k] = target[k] - moved[k];
    if (!solve(A, 1, step))
        return SINGULAR;
    move(1, R, t, step, R_new, t_new);
    bool found = lengths_at(nodes, R_new, t_new, moved_new, A_new);
    for (int k = 0; k < N; k++)
        moved_new[k] -= nodes->nominal_length_m[k];
    return found ? FOLLOWED : NO_LENGTH;
}
