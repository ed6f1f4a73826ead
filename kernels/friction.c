#include <math.h>
#include <string.h>

#include "kernels.h"

/* Largest number of sweeps of a step, and the relative change of a force at which they end. */
enum { SWEEPS = 1000 };
static const double CHANGE = 1e-11;

/* Write the product of A (rows, columns) with x. */
static void product(const double *A, int rows, int columns, const double *x, double *out)
{
    for (int i = 0; i < rows; i++) {
        double total = 0.0;
        for (int j = 0; j < columns; j++)
            total += A[i * columns + j] * x[j];
        out[i] = total;
    }
}

/* Update forces f (r) to those that balance c (r) within their limits, by Gauss-Seidel. */
static void hold(const friction_model *of, const double *c, double *f)
{
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double change = 0.0;
        for (int i = 0; i < of->r; i++) {
            const double *row = of->K + i * of->r, limit = of->limit[i];
            double gap = c[i];
            for (int j = 0; j < of->r; j++)
                gap += row[j] * f[j];
            double force = f[i] - gap / row[i];
            force = -limit > force ? -limit : force;
            force = limit < force ? limit : force;
            double moved = fabs(force - f[i]) / limit;
            change = moved > change ? moved : change;
            f[i] = force;
        }
        if (change < CHANGE)
            return;
    }
}

/* Advance x (s) by a step, in place; `driven` is B u and `pulled` D u. Workspace: r + s. */
static void rub(const friction_model *of, const double *driven, const double *pulled, double *x,
                 double *f, double *work)
{
    double *c = work, *after = c + of->r;
    product(of->E, of->r, of->s, x, c);
    for (int i = 0; i < of->r; i++)
        c[i] += pulled[i];
    hold(of, c, f);
    product(of->A, of->s, of->s, x, after);
    for (int i = 0; i < of->s; i++) {
        double total = after[i] + driven[i];
        for (int j = 0; j < of->r; j++)
            total += of->G[i * of->r + j] * f[j];
        x[i] = total;
    }
}

void slide(const friction_model *of, int states, const double *U, double *work, double *X)
{
    int s = of->s, r = of->r;
    double *driven = work, *pulled = driven + s, *f = pulled + r, *left = f + r;
    for (int k = 0; k < states; k++) {
        const double *u = U + k * (of->n + 1);
        product(of->B, s, of->n + 1, u, driven);
        product(of->D, r, of->n + 1, u, pulled);
        memset(f, 0, r * sizeof *f);
        for (int step = 0; step < of->steps_a_tick; step++)
            rub(of, driven, pulled, X + k * s, f, left);
    }
}

/* Write the derivative of the state after a step by that before it, (s, s), with contacts (r) stuck
 * or at their limits.
 *
 * Forces at their limits remain constant. M (r, r) and pull (r, s) are workspace.
 */
static void write_slopes(const friction_model *of, const bool *stuck, double *M, double *pull,
                         double *slopes)
{
    int s = of->s, r = of->r;
    for (int i = 0; i < r; i++) {
        for (int j = 0; j < r; j++)
            M[i * r + j] = stuck[i] ? of->K[i * r + j] : i == j;
        for (int j = 0; j < s; j++)
            pull[i * s + j] = stuck[i] ? -of->E[i * s + j] : 0.0;
    }
    for (int k = 0; k < r; k++)
        for (int i = 0; i < r; i++) { /* K is positive definite: no pivot is small */
            double factor = i == k ? 0.0 : M[i * r + k] / M[k * r + k];
            for (int j = k; j < r; j++)
                M[i * r + j] -= factor * M[k * r + j];
            for (int j = 0; j < s; j++)
                pull[i * s + j] -= factor * pull[k * s + j];
        }
    memcpy(slopes, of->A, s * s * sizeof *slopes);
    for (int i = 0; i < s; i++)
        for (int k = 0; k < r; k++)
            for (int j = 0; j < s; j++)
                slopes[i * s + j] += of->G[i * r + k] * pull[k * s + j] / M[k * r + k];
}

/* Write the product of A (s, s) with W (s, s). */
static void multiply(const double *A, const double *W, int s, double *out)
{
    memset(out, 0, s * s * sizeof *out);
    for (int i = 0; i < s; i++)
        for (int k = 0; k < s; k++)
            for (int j = 0; j < s; j++)
                out[i * s + j] += A[i * s + k] * W[k * s + j];
}

/* Return one of several models. */
static friction_model model(const friction_model *of, int h)
{
    friction_model one = *of;
    one.A += h * of->s * of->s;
    one.B += h * of->s * (of->n + 1);
    one.G += h * of->s * of->r;
    one.E += h * of->r * of->s;
    one.D += h * of->r * (of->n + 1);
    one.K += h * of->r * of->r;
    one.limit += h * of->r;
    one.C += h * of->p * of->s;
    return one;
}

int sliding_room(const friction_model *of, int ticks)
{
    int s = of->s, r = of->r;
    return of->n + of->p + 1 + 4 * s + 4 * r + 3 * s * s + r * (r + s + ticks * of->steps_a_tick);
}

void slide_samples(const friction_model *all, int H, int N, int rows, const bool *steps,
                   const double *before, const double *v, const double *lifted, int ticks,
                   int first, double spread, bool *stuck, double *work, double *X, double *outputs)
{
    int s = all->s, r = all->r, p = all->p, n = all->n, varied = spread > 0.0 ? r : 0;
    double *u = work, *x = u + n + 1, *mean = x + s, *driven = mean + s, *pulled = driven + s;
    double *f = pulled + r, *other = f + r, *left = other + r, *seen = left + r + s;
    double *W = seen + p, *slopes = W + s * s, *after = slopes + s * s;
    double *M = after + s * s, *pull = M + r * r, *forces = pull + r * s;
    memcpy(u, v, n * sizeof *u);
    u[n] = 1.0;
    for (int h = 0; h < H; h++, lifted += s * s) {
        friction_model of = model(all, h), weaker = of;
        weaker.limit = other;
        product(of.B, s, n + 1, u, driven);
        product(of.D, r, n + 1, u, pulled);
        memset(stuck, 0, r * sizeof *stuck);
        memcpy(slopes, of.A, s * s * sizeof *slopes);
        for (int k = 0; k < N; k++) {
            int at = (h * N + k) * rows;
            const double *start = before + at * s;
            double *new = X + at * s, *out = outputs + at * p;
            if (!steps[h * N + k])
                continue;
            memcpy(x, start, s * sizeof *x);
            memset(mean, 0, s * sizeof *mean);
            memset(f, 0, r * sizeof *f);
            for (int i = 0; i < s * s; i++)
                W[i] = i % (s + 1) == 0;
            for (int step = 0; step < ticks * of.steps_a_tick; step++) {
                for (int i = 0; step % of.steps_a_tick == 0 && i < s; i++)
                    mean[i] += x[i] / ticks;
                rub(&of, driven, pulled, x, f, left);
                memcpy(forces + step * r, f, r * sizeof *f);
                bool same = true;
                for (int i = 0; i < r; i++) {
                    bool holds = fabs(f[i]) < of.limit[i];
                    same &= holds == stuck[i];
                    stuck[i] = holds;
                }
                if (!same) /* it seldom changes between onsets and steps */
                    write_slopes(&of, stuck, M, pull, slopes);
                multiply(slopes, W, s, after);
                memcpy(W, after, s * s * sizeof *W);
            }
            memcpy(new, x, s * sizeof *x);
            product(of.C, p, s, mean, out);
            for (int row = 1; row < rows; row++)
                for (int i = 0; (row < first || row >= first + varied) && i < s; i++)
                    for (int j = 0; j < s; j++)
                        new[row * s + i] += (W[i * s + j] - lifted[i * s + j]) * start[row * s + j];
            for (int j = 0; j < varied; j++) {
                int row = first + j;
                memcpy(other, of.limit, r * sizeof *other);
                other[j] *= 1.0 - spread;
                memset(mean, 0, s * sizeof *mean);
                for (int i = 0; i < s; i++)
                    x[i] = start[i] - start[row * s + i];
                for (int step = 0; step < ticks * of.steps_a_tick; step++) {
                    for (int i = 0; step % of.steps_a_tick == 0 && i < s; i++)
                        mean[i] += x[i] / ticks;
                    memcpy(f, forces + step * r, r * sizeof *f); /* a good initial guess */
                    rub(&weaker, driven, pulled, x, f, left);
                }
                for (int i = 0; i < s; i++)
                    new[row * s + i] = new[i] - x[i];
                product(of.C, p, s, mean, seen);
                for (int i = 0; i < p; i++)
                    out[row * p + i] = out[i] - seen[i];
            }
        }
    }
}
