#include <math.h>

#include "kernels.h"

/* Part of its variance below which a pivot is round-off. */
static const double PIVOT = 1e-13;

/* Write the root L (d, d) of P + Q by Cholesky, the lower triangle. */
static void factor(const double *P, const double *Q, int d, double *L)
{
    for (int i = 0; i < d; i++)
        for (int j = 0; j <= i; j++) {
            double whole = P[i * d + j] + Q[i * d + j], total = whole;
            for (int k = 0; k < j; k++)
                total -= L[i * d + k] * L[j * d + k];
            if (i == j)
                L[i * d + i] = sqrt(PIVOT * whole > total ? PIVOT * whole : total);
            else
                L[i * d + j] = total / L[j * d + j];
        }
}

void to_segments(int H, int E, int d, const double *points, const double *starts,
                 const double *ways, const double *own, const double *other, bool one,
                 double *room, double *distance)
{
    double *L = room, *a = L + d * d, *b = a + d;
    for (int h = 0; h < H; h++)
        for (int e = 0; e < E; e++) {
            if (!one || (h == 0 && e == 0))
                factor(own + h * d * d, other + e * d * d, d, L);
            double aa = 0.0, ab = 0.0, bb = 0.0;
            for (int i = 0; i < d; i++) {
                double from_start = points[h * d + i] - starts[e * d + i];
                double along = ways[e * d + i];
                for (int k = 0; k < i; k++) {
                    from_start -= L[i * d + k] * a[k];
                    along -= L[i * d + k] * b[k];
                }
                a[i] = from_start / L[i * d + i];
                b[i] = along / L[i * d + i];
                ab += a[i] * b[i];
                bb += b[i] * b[i];
            }
            double t = bb > 0.0 ? ab / bb : 0.0;
            t = 0.0 > t ? 0.0 : t;
            t = 1.0 < t ? 1.0 : t;
            for (int i = 0; i < d; i++)
                aa += (a[i] - t * b[i]) * (a[i] - t * b[i]);
            distance[h * E + e] = sqrt(aa);
        }
}
