#include <math.h>
#include <string.h>

#include "kernels.h"

enum { N = 6, ANGLES = 2 };

/* Part of a column below which a pivot is round-off. */
static const double DEPENDENT = 1e-12;
/* Square of the largest number that the argument checks let pass. */
static const double MOST = 1e240;
/* Product of the norms of a Jacobian and its inverse beyond which ranks must be decided. */
static const double REGULAR = 1e6;

/* Sum of the squares of some numbers. */
static double square(const double *x, int count)
{
    double total = 0.0;
    for (int i = 0; i < count; i++)
        total += x[i] * x[i];
    return total;
}

/* Lengths of the struts at one pose and rows [(R a) x u, u]; of one without length NaN. */
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
static bool solve(const double *given, int columns, double *X)
{
    double A[N][N], size[N] = {0.0};
    memcpy(A, given, sizeof A);
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
    return square(X, N * columns) < MOST; /* NaN is not */
}

bool strut_twist(const double *A, double *b)
{
    return solve(A, 1, b);
}

bool strut_inverse(const double *A, double *inverse)
{
    for (int i = 0; i < N * N; i++)
        inverse[i] = i % (N + 1) == 0 ? 1.0 : 0.0;
    return solve(A, N, inverse) && square(A, N * N) * square(inverse, N * N) < REGULAR * REGULAR;
}

int follow(const strut_nodes *nodes, const double *R, const double *t, const double *A,
           const double *moved, const double *asked, double *R_new, double *t_new, double *A_new,
           double *moved_new)
{
    double step[N];
    for (int k = 0; k < N; k++)
        step[k] = asked[k] - moved[k];
    if (!solve(A, 1, step))
        return SINGULAR;
    move(1, R, t, step, R_new, t_new);
    bool found = lengths_at(nodes, R_new, t_new, moved_new, A_new);
    for (int k = 0; k < N; k++)
        moved_new[k] -= nodes->nominal_length_m[k];
    return found ? FOLLOWED : NO_LENGTH;
}

bool strut_displacements(const strut_mapping *mapping, const double *A, const double *demand,
                         double *displacements)
{
    double inverse[N * N], J[N * N], room[STRUT_ROOM], rates[N], square_J = 0.0;
    int left = mapping->problem->n;
    if (!strut_inverse(A, inverse))
        return false;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < left; j++) {
            double part = inverse[i * N + mapping->survivors[j]];
            J[i * left + j] = part;
            square_J += part * part;
        }
    double scale = sqrt((double)N) + sqrt(square_J); /* J_T = [0, 1] has the first size */
    if (problem1_solve(mapping->problem, J, &scale, mapping->w1, mapping->w2, demand, 0, 0, 0, room,
                       rates) != PROBLEM1_SOLVED)
        return false;
    memset(displacements, 0, N * sizeof *displacements);
    for (int j = 0; j < left; j++)
        displacements[mapping->survivors[j]] = rates[j];
    return true;
}

bool strut_tick(const strut_task *task, int k, const double *gaps, const int32_t *owners, int rows)
{
    const double *turned = task->observed->rotation + 9 * k;
    observe(task->observed, k, gaps, owners, rows);
    if (!(fabs(turned[8]) > 0.0))
        return false;
    double *measured = task->measured + ANGLES * k, errors[ANGLES];
    spot(turned, task->focal_length_m, task->half_width_m, task->noise_m, task->noise + ANGLES * k,
         measured);
    for (int i = 0; i < ANGLES; i++) {
        measured[i] += task->zeros[ANGLES * k + i];
        errors[i] = task->reference[ANGLES * k + i] - measured[i];
    }

    double commanded[N], *R = task->rotation + 9 * k, *t = task->translation_m + 3 * k;
    double *A = task->inverse_jacobian + N * N * k, *moved = task->displacement_m + N * k;
    convert(&task->to_displacement, N, task->inputs + N * k, commanded);
    if (task->constant) {
        memcpy(A + N * N, A, N * N * sizeof *A);
        memcpy(moved + N, moved, N * sizeof *moved);
        if (!strut_twist(A, commanded))
            return false;
        move(1, task->rotation, task->translation_m, commanded, R + 9, t + 3);
    } else if (follow(task->nodes, R, t, A, moved, commanded, R + 9, t + 3, A + N * N,
                      moved + N) != FOLLOWED)
        return false;

    double *states = task->compensator + task->order * k, after[STRUT_ROOM];
    double *demand = task->demand + ANGLES * (k + 1);
    compensate(task->M, task->order + ANGLES, task->order, ANGLES, states, errors, after);
    memcpy(states + task->order, after, (size_t)task->order * sizeof *after);
    for (int i = 0; i < ANGLES; i++)
        demand[i] = task->feedforward[ANGLES * k + i] + after[task->order + i];
    double *required = task->displacements + N * (k + 1);
    if (!strut_displacements(task->mapping, A + N * N, demand, required))
        return false;
    convert(&task->to_input, N, required, task->inputs + N * (k + 1));
    return true;
}
