#include <math.h>
#include <string.h>

#include "kernels.h"
#include "numerics.h"

/* Fraction of its variance below which a pivot is round-off. */
static const double PIVOT = 1e-13;

/* Pairs computed in parallel, each with the same arithmetic as alone. */
enum { LANES = 8 };

/* Write roots L (d, d, LANES) of P + Q by Cholesky, lower triangles, of Q (LANES) that are `next`
 * numbers apart. */
WIDE
static void factor(const double *P, const double *Q, int64_t next, int d, double *L)
{
    for (int i = 0; i < d; i++)
        for (int j = 0; j <= i; j++) {
            double whole[LANES], total[LANES];
            const double *a = L + i * d * LANES, *b = L + j * d * LANES;
            for (int l = 0; l < LANES; l++)
                total[l] = whole[l] = P[i * d + j] + Q[l * next + i * d + j];
            for (int k = 0; k < j * LANES; k += LANES)
                for (int l = 0; l < LANES; l++)
                    total[l] -= a[k + l] * b[k + l];
            double *to = L + (i * d + j) * LANES;
            for (int l = 0; l < LANES; l++)
                if (i == j)
                    to[l] = sqrt(PIVOT * whole[l] > total[l] ? PIVOT * whole[l] : total[l]);
                else
                    to[l] = total[l] / L[(j * d + j) * LANES + l];
        }
}

/* Write the distances (LANES) of a point (d) from segments that are `next` numbers apart. */
WIDE
static void distances(const double *L, int d, const double *point, const double *starts,
                      const double *spans, int64_t next, double *a, double *b, double *distance)
{
    double aa[LANES] = {0.0}, ab[LANES] = {0.0}, bb[LANES] = {0.0};
    for (int i = 0; i < d; i++) {
        const double *row = L + i * d * LANES;
        double from_start[LANES], along[LANES];
        for (int l = 0; l < LANES; l++) {
            from_start[l] = point[i] - starts[l * next + i];
            along[l] = spans[l * next + i];
        }
        for (int k = 0; k < i * LANES; k += LANES)
            for (int l = 0; l < LANES; l++) {
                from_start[l] -= row[k + l] * a[k + l];
                along[l] -= row[k + l] * b[k + l];
            }
        for (int l = 0; l < LANES; l++) {
            double pivot = row[i * LANES + l];
            double x = a[i * LANES + l] = from_start[l] / pivot;
            double y = b[i * LANES + l] = along[l] / pivot;
            ab[l] += x * y;
            bb[l] += y * y;
        }
    }
    for (int l = 0; l < LANES; l++) {
        double t = bb[l] > 0.0 ? ab[l] / bb[l] : 0.0;
        t = 0.0 > t ? 0.0 : t;
        ab[l] = 1.0 < t ? 1.0 : t;
    }
    for (int i = 0; i < d * LANES; i += LANES)
        for (int l = 0; l < LANES; l++) {
            double left = a[i + l] - ab[l] * b[i + l];
            aa[l] += left * left;
        }
    for (int l = 0; l < LANES; l++)
        distance[l] = sqrt(aa[l]);
}

int segments_room(int d)
{
    return LANES * d * (d + 2);
}

void to_segments(int H, int E, int d, const double *points, const double *starts,
                 const double *spans, const double *own, const double *other, bool one,
                 double *work, double *distance)
{
    double *L = work, *a = L + d * d * LANES, *b = a + d * LANES, found[LANES];
    int step = E < LANES ? 1 : LANES; /* fewer than lanes: one pair at a time, in all lanes */
    int64_t next = E < LANES ? 0 : 1;
    for (int h = 0; h < H; h++)
        for (int e = 0; e < E; e += step) {
            int k = e + step <= E ? e : E - step; /* overlaps the previous lanes at the end */
            if (!one || (h == 0 && e == 0))
                factor(own + h * d * d, other + k * d * d, one ? 0 : next * d * d, d, L);
            distances(L, d, points + h * d, starts + k * d, spans + k * d, next * d, a, b, found);
            memcpy(distance + h * E + k, found, (size_t)step * sizeof *found);
        }
}
