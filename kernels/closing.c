/* Elimination of passive velocities: square loops far from singular; bases of the rest. */
#include <math.h>

#include "kernels.h"

/* Part of a number by which equal ones may differ: ACCURACY in argument_checks/ties.py. */
static const double ACCURACY = 1e-9;

/* Sum of squares, in four sums that the processor adds to at once. */
static double square(const double *A, int count)
{
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    int i = 0;
    for (; i + 4 <= count; i += 4)
        for (int k = 0; k < 4; k++)
            sums[k] += A[i + k] * A[i + k];
    double total = (sums[0] + sums[1]) + (sums[2] + sums[3]);
    for (; i < count; i++)
        total += A[i] * A[i];
    return total;
}

/* The columns of J_Cp with the fewest numbers first: elimination then fills in fewer. */
static void fullest_last(const double *J_C, int p, int N, const int64_t *moving, int *filled,
                         int *order)
{
    for (int k = 0; k < p; k++) { /* by insertion */
        int place = k;
        filled[k] = 0;
        for (int i = 0; i < p; i++)
            filled[k] += J_C[i * N + moving[k]] != 0.0;
        for (; place > 0 && filled[order[place - 1]] > filled[k]; place--)
            order[place] = order[place - 1];
        order[place] = k;
    }
}

/* Subtract a multiple of one row from another. */
static void subtract(double *restrict target, const double *restrict source, double factor,
                     int first, int last)
{
    if (factor != 0.0) /* loops share few joints */
        for (int j = first; j < last; j++)
            target[j] -= factor * source[j];
}

bool close_loops(const double *J_C, int p, int N, const int64_t *active, int n,
                 const int64_t *moving, double clear, double *closing, double *gain, double *room)
{
    int w = 2 * p + n, *order = (int *)(room + p * w), *row = order + p;
    fullest_last(J_C, p, N, moving, row, order);
    for (int i = 0; i < p; i++) {
        double *own = room + i * w;
        row[i] = i * w;
        for (int k = 0; k < p; k++) {
            own[k] = J_C[i * N + moving[order[k]]];
            own[p + k] = k == i ? 1.0 : 0.0;
        }
        for (int k = 0; k < n; k++)
            own[2 * p + k] = J_C[i * N + active[k]];
    }
    for (int k = 0; k < p; k++) {
        int best = k;
        for (int i = k + 1; i < p; i++)
            if (fabs(room[row[i] + k]) > fabs(room[row[best] + k]))
                best = i;
        int chosen = row[best];
        row[best] = row[k];
        row[k] = chosen;
        const double *own = room + chosen;
        if (own[k] == 0.0)
            return false;
        for (int i = k + 1; i < p; i++)
            subtract(room + row[i], own, room[row[i] + k] / own[k], k + 1, w);
    }
    for (int k = p - 1; k >= 0; k--) {
        double *own = room + row[k], pivot = own[k];
        for (int j = p; j < w; j++)
            own[j] /= pivot;
        for (int i = 0; i < k; i++)
            subtract(room + row[i], own, room[row[i] + k], p, w);
        for (int j = 0; j < p; j++)
            closing[order[k] * p + j] = own[p + j];
        for (int j = 0; j < n; j++)
            gain[order[k] * n + j] = -own[2 * p + j];
    }
    return clear * sqrt(square(J_C, p * N)) * sqrt(square(closing, p * p)) < 1.0;
}

double reduce_task(const double *J_T, int m, int N, const int64_t *active, int n,
                   const int64_t *moving, int p, const double *gain, double *J)
{
    double through = 0.0;
    for (int t = 0; t < m; t++)
        for (int j = 0; j < n; j++)
            J[t * n + j] = J_T[t * N + active[j]];
    for (int k = 0; k < p; k++) {
        const double *follow = gain + k * n;
        double column = 0.0, follows = 0.0;
        for (int j = 0; j < n; j++)
            follows += follow[j] * follow[j];
        for (int t = 0; t < m; t++) {
            double moved = J_T[t * N + moving[k]];
            column += moved * moved;
            if (moved != 0.0)
                for (int j = 0; j < n; j++)
                    J[t * n + j] += moved * follow[j];
        }
        /* A fast passive joint adds to the size only if it moves the task. */
        through += column * follows;
    }
    return sqrt(square(J_T, m * N)) + sqrt(through);
}

void canonical_bases(int count, int N, int k, double *rest, double *made, double *along)
{
    for (int b = 0; b < count; b++, rest += N * k, made += N * k)
        for (int t = 0; t < k; t++) {
            int pivot = 0;
            double most = 0.0, left = 0.0;
            for (int i = 0; i < N; i++) {
                double size = 0.0;
                for (int j = 0; j < k; j++)
                    size += rest[i * k + j] * rest[i * k + j];
                left += size;
                if (size > most * (1.0 + ACCURACY)) {
                    pivot = i;
                    most = size;
                }
            }
            if (left < 0.5) /* what is left has the dimension that is left */
                break;
            for (int j = 0; j < k; j++)
                along[j] = rest[pivot * k + j] / sqrt(most);
            for (int i = 0; i < N; i++) {
                double part = 0.0;
                for (int j = 0; j < k; j++)
                    part += rest[i * k + j] * along[j];
                made[i * k + t] = part;
                for (int j = 0; j < k; j++)
                    rest[i * k + j] -= part * along[j];
            }
        }
}
