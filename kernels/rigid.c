#include <math.h>

#include "kernels.h"

/* Half of a gap that counts as round-off. */
static const double COINCIDENT_M = 5e-15;

/* Rotate about the rotation vector by Rodrigues' formula, then translate. */
static void move_one(const double *R, const double *t, const double *twist, double *R_new,
                     double *t_new)
{
    double x = twist[0], y = twist[1], z = twist[2];
    double square = x * x + y * y + z * z, half = 0.5 * sqrt(square);
    /* sin(angle) / angle and (1 - cos(angle)) / angle^2, without cancellation. */
    double sinc = half > 0.0 ? sin(half) / half : 1.0;
    double s = sinc * cos(half), c = 0.5 * sinc * sinc;
    for (int j = 0; j < 3; j++) {
        double a = R[j], b = R[3 + j], d = R[6 + j];
        double along = c * (x * a + y * b + z * d);
        /* In increments: a factor close to 1 would be rounded the same way at every tick. */
        R_new[j] = a + (s * (y * d - z * b) + (along * x - c * square * a));
        R_new[3 + j] = b + (s * (z * a - x * d) + (along * y - c * square * b));
        R_new[6 + j] = d + (s * (x * b - y * a) + (along * z - c * square * d));
    }
    for (int i = 0; i < 3; i++)
        t_new[i] = t[i] + twist[3 + i];
}

void move(int poses, const double *R, const double *t, const double *twists, double *R_new,
          double *t_new)
{
    for (int k = 0; k < poses; k++)
        move_one(R + 9 * k, t + 3 * k, twists + 6 * k, R_new + 9 * k, t_new + 3 * k);
}

/* Write the rotation vector of E and return its angle, by its quaternion. */
static double turn(const double *E, double *vector)
{
    double trace = E[0] + E[4] + E[8], w;
    int k = 0;
    for (int i = 1; i < 3; i++)
        if (E[4 * i] > E[4 * k])
            k = i;
    int i = (k + 1) % 3, j = (k + 2) % 3;
    if (trace > E[4 * k]) {
        w = 1.0 + trace;
        vector[0] = E[7] - E[5], vector[1] = E[2] - E[6], vector[2] = E[3] - E[1];
    } else {
        w = E[3 * j + i] - E[3 * i + j];
        vector[k] = 1.0 + E[4 * k] - E[4 * i] - E[4 * j];
        vector[i] = E[3 * i + k] + E[3 * k + i], vector[j] = E[3 * j + k] + E[3 * k + j];
        if (w < 0.0) {
            w = -w;
            for (int n = 0; n < 3; n++)
                vector[n] = -vector[n];
        }
    }
    double sine = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    double angle = 2.0 * atan2(sine, w), factor = sine > 0.0 ? angle / sine : 0.0;
    for (int n = 0; n < 3; n++)
        vector[n] *= factor;
    return angle;
}

double way(const double *R, const double *p, const double *R_to, const double *p_to, double *twist)
{
    double E[9];
    for (int i = 0; i < 3; i++) {
        const double *to = R_to + 3 * i;
        for (int j = 0; j < 3; j++)
            E[3 * i + j] = to[0] * R[3 * j] + to[1] * R[3 * j + 1] + to[2] * R[3 * j + 2];
        twist[3 + i] = p_to[i] - p[i];
    }
    return turn(E, twist);
}

double displacements(int poses, const double *R, const double *t, double *twists)
{
    double most = 0.0;
    for (int k = 0; k < poses; k++, R += 9, t += 3, twists += 6) {
        double angle = turn(R, twists);
        most = angle > most ? angle : most;
        for (int i = 0; i < 3; i++)
            twists[3 + i] = t[i];
    }
    return most;
}

void seen_from(const double *xmat, const double *xpos, const double *base_xmat, const double *R_0,
               const double *p_0, double *R, double *t)
{
    for (int i = 0; i < 3; i++) {
        t[i] = 0.0;
        for (int k = 0; k < 3; k++)
            t[i] += base_xmat[3 * k + i] * (xpos[k] - p_0[k]);
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double total = 0.0;
            for (int k = 0; k < 3; k++) {
                double turned = 0.0, back = 0.0;
                for (int u = 0; u < 3; u++) {
                    turned += base_xmat[3 * u + i] * xmat[3 * u + k];
                    back += R_0[3 * k + u] * base_xmat[3 * u + j];
                }
                total += turned * back;
            }
            R[3 * i + j] = total;
        }
}

double largest_gap(const double *gaps, const int32_t *owners, const double *counts, int rows)
{
    double most = 0.0;
    for (int i = 0; i < rows; i++) {
        double gap = fabs(gaps[i] * counts[owners[i]]);
        if (gap > most)
            most = gap;
    }
    return most;
}

double largest(const double *gaps, const double *units, int count)
{
    double most = 0.0;
    for (int i = 0; i < count && most < INFINITY; i++) {
        double gap = fabs(gaps[i] * units[i]);
        if (!(gap <= most))
            most = gap;
    }
    return most;
}

void at_midpoints(const double *gaps, const double *axes, int velocities, const int64_t *points,
                  int count, const double *carried, double *J)
{
    for (int i = 0; i < count; i += 3) {
        const int64_t *row = points + i;
        double D[3] = {gaps[row[0]] / 2, gaps[row[1]] / 2, gaps[row[2]] / 2}, most = fabs(D[0]);
        for (int n = 1; n < 3; n++)
            most = fabs(D[n]) > most ? fabs(D[n]) : most;
        if (!(most > COINCIDENT_M))
            continue;
        for (int j = 0; j < velocities; j++) {
            double bodies = carried[i * velocities + j];
            if (bodies != 0.0) {
                double x = axes[6 * j], y = axes[6 * j + 1], z = axes[6 * j + 2];
                J[row[0] * velocities + j] += (D[1] * z - D[2] * y) * bodies;
                J[row[1] * velocities + j] += (D[2] * x - D[0] * z) * bodies;
                J[row[2] * velocities + j] += (D[0] * y - D[1] * x) * bodies;
            }
        }
    }
}

double observe(const observation *log, int k, const double *gaps, const int32_t *owners, int rows)
{
    double *displacement = log->displacement + k * log->drives;
    seen_from(log->xmat, log->xpos, log->base_xmat, log->R_0, log->p_0, log->rotation + 9 * k,
              log->translation_m + 3 * k);
    for (int i = 0; i < log->at_joints; i++) {
        int64_t own = log->joints[i];
        displacement[own] = log->qpos[log->places[i]] - log->nominal[own];
    }
    for (int i = 0; i < log->drives - log->at_joints; i++) {
        int64_t own = log->others[i];
        displacement[own] = log->lengths[log->outputs[i]] / log->gear[i] - log->nominal[own];
    }
    log->closure_residual_m[k] = largest_gap(gaps, owners, log->counts, rows);
    for (int i = 0; i < log->logged_qpos; i++)
        log->all_qpos[k * log->logged_qpos + i] = log->qpos[i];
    for (int i = 0; i < log->logged_forces; i++)
        log->all_forces[k * log->logged_forces + i] = log->forces[i];
    return displacements(1, log->rotation + 9 * k, log->translation_m + 3 * k, log->task + 6 * k);
}

void spot(const double *R, double focal, double half_width, double deviation, const double *noise,
          double *seen)
{
    for (int i = 0; i < 2; i++) {
        double at = focal * R[6 + i] / R[8] + deviation * noise[i];
        at = -half_width > at ? -half_width : at;
        at = (half_width < at ? half_width : at) / focal;
        seen[1 - i] = i == 0 ? -at : at;
    }
}

void convert(const conversion *by, int n, const double *x, double *y)
{
    for (int i = 0; i < n; i++) {
        double value = x[i] * by->factor;
        if (by->whole)
            value = rint(value);
        y[i] = by->gain * (value < by->lower ? by->lower : value > by->upper ? by->upper : value);
    }
}
