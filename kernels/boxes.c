/* Rates from which limits can be satisfied forever, one joint after another. */
#include <math.h>

#include "kernels.h"

/* Relative violation of positions and rates up to which limits count as satisfied. */
static const double ROUND_OFF = 1e-12;
/* Same as in argument_checks: arrays.py, and ties.py. */
static const double LARGEST = 1e120, SMALLEST = 1e-120, ACCURACY = 1e-9;

static double larger(double a, double b)
{
    return b > a ? b : a;
}

static double smaller(double a, double b)
{
    return b < a ? b : a;
}

bool are_limits(double lower, double upper)
{
    bool is_number = fabs(lower) < LARGEST || lower == -INFINITY;
    return is_number && (fabs(upper) < LARGEST || upper == INFINITY) && lower <= upper;
}

bool copy_limits(int n, const double *lower, const double *upper, double *limits)
{
    for (int i = 0; i < n; i++) {
        if (!are_limits(lower[i], upper[i]))
            return false;
        limits[i] = lower[i];
        limits[n + i] = upper[i];
    }
    return true;
}

/* Replace infinity by zero: another term decides then. */
static double finite(double number)
{
    return isinf(number) ? 0.0 : number;
}

/* Return the largest rate w of the next tick after which full braking stops within a distance d.
 *
 * In n ticks the joint moves by T (w + (w - a T) + ... + (w - (n - 1) a T)), farthest for n =
 * ceil(w / (a T)), the positive terms. For a maximum over n of d, w = min over n of d / (n T) + a T
 * (n - 1) / 2, and the least one has d / (a T^2) between n (n - 1) / 2 and n (n + 1) / 2. A
 * negative distance must be corrected in one tick.
 */
static double stoppable(double distance, double braking, double T)
{
    if (isinf(distance))
        return distance;
    /* sqrt(8 d / (a T^2)), in an order that neither over- nor underflows */
    double root = sqrt(8.0 * larger(distance, 0.0) / braking) / T;
    double n = larger(ceil((hypot(1.0, root) - 1.0) / 2.0), 1.0);
    return distance / (n * T) + finite(braking) * T * (n - 1.0) / 2.0;
}

static double clip(double number, double least, double most)
{
    return smaller(larger(number, least), most);
}

bool exceeds(double value, double bound, double zero)
{
    double work = larger(ACCURACY * finite(larger(fabs(value), fabs(bound))), zero);
    return value > bound && !(value - bound <= work);
}

bool viable_box(int n, const double *inputs, double T, double *lower, double *upper, bool *viable)
{
    const double *x = inputs, *v = x + n, *x_min = v + n, *x_max = x_min + n, *v_min = x_max + n;
    const double *v_max = v_min + n, *a_min = v_max + n, *a_max = a_min + n;
    for (int k = 0; k < n; k++) {
        if (!(fabs(x[k]) < LARGEST && fabs(v[k]) < LARGEST && are_limits(x_min[k], x_max[k])
              && are_limits(v_min[k], v_max[k]) && are_limits(a_min[k], a_max[k])
              && v_min[k] <= 0.0 && 0.0 <= v_max[k] && a_min[k] <= -SMALLEST
              && a_max[k] >= SMALLEST))
            return false;
        double slowest = v[k] + T * a_min[k], fastest = v[k] + T * a_max[k];
        double least = -stoppable(x[k] - x_min[k], a_max[k], T);
        double most = stoppable(x_max[k] - x[k], -a_min[k], T);
        double size = larger(fabs(x[k]), finite(fabs(x_min[k])));
        size = larger(size, finite(fabs(x_max[k])));
        double lack = larger(larger(slowest, v_min[k]), least);
        lack -= smaller(smaller(fastest, v_max[k]), most);
        viable[k] = lack <= ROUND_OFF * (size / T + fabs(v[k]));
        /* Beyond a limit, the return must be slow enough to respect the other limit. */
        if (x[k] > x_max[k])
            most = larger(most, least);
        if (x[k] < x_min[k])
            least = smaller(least, most);
        double slow = clip(v_min[k], slowest, fastest), fast = clip(v_max[k], slowest, fastest);
        double low = clip(least, slow, fast), high = clip(most, slow, fast);
        /* If braking just suffices, a single rate remains: round-off must not turn it into an
         * interval. */
        lower[k] = low;
        upper[k] = exceeds(high, low, ACCURACY * fabs(v[k])) ? high : low;
    }
    return true;
}
