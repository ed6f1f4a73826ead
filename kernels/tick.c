/* Rates and passive velocities at a pose: loops are eliminated, then levels are solved.
 *
 * If loops or levels are ill-conditioned, near a singular pose, the caller must decide with the
 * accuracy of each entry of the geometry.
 */
#include <math.h>
#include <string.h>
#include "kernels.h"
#include "numerics.h"

typedef struct {
    double *at;
    int rows, width;
} matrix;

/* Result of eliminating the loops, with the magnitudes that count as zero. */
typedef struct {
    bool is_regular;    /* whether J_Cp is regular */
    double loops, task; /* magnitude up to which loops are zero, per |gain|, and of J */
    double follows;     /* |gain|^2 */
} reduction;

/* Mechanism at a pose: gains and constraints of the rates, the reduced task Jacobian. */
typedef struct {
    matrix M, J;
    reduction loops;
} mechanism;

static double *row(matrix A, int i)
{
    return A.at + i * A.width;
}

/* Return whether numbers with this sum of squares are zero or moderate. */
static bool fits(double square)
{
    return square == 0.0 || is_moderate(square);
}

/* Return whether the idle velocities move neither loops nor task, and may be zero. */
static bool are_idle(const tick_plan *g, const double *J_T, const double *J_C,
                     const double *lower, const double *upper)
{
    for (int k = 0; k < g->idles; k++) {
        int64_t j = g->idle[k];
        if (!(lower[j] <= 0.0 && 0.0 <= upper[j]))
            return false;
        for (int i = 0; i < g->m; i++)
            if (J_T[i * g->N + j] != 0.0)
                return false;
        for (int i = 0; i < g->c; i++)
            if (J_C[i * g->N + j] != 0.0)
                return false;
    }
    return true;
}

/* Write rows of A (rows, N) in natural units, and return their norm. */
static double to_natural(const tick_plan *g, const double *A, int rows, const double *units,
                         double *to)
{
    double total = 0.0;
    for (int i = 0; i < rows; i++) {
        double factor = 1.0 / units[i], *own = to + i * g->N;
        for (int j = 0; j < g->N; j++) {
            own[j] = A[i * g->N + j] * (factor * g->velocity_units[j]);
            total += own[j] * own[j];
        }
    }
    return sqrt(total);
}

/* Eliminate the loops of a mechanism at a pose, in natural units. */
static reduction eliminate(const tick_plan *g, const double *J_T, const double *J_C, double size_T,
                           double size_C, double bound, const mechanism *to)
{
    double *gain = row(to->M, 0) + g->p;
    double inverse = close_loops(J_C, g->c, g->N, g->order, g->p, g->n, false, to->M.at);
    double loops = fmax(g->doubt * size_C, MARGIN * g->error_C * bound), follows = 0.0;
    double scale = reduce_task(J_T, g->m, g->N, g->order, g->p, g->n, gain, to->M.width, to->J.at);
    for (int k = 0; k < g->p; k++)
        follows += dot(gain + k * to->M.width, gain + k * to->M.width, g->n);
    double reached = (g->error_T + size_T * inverse * g->error_C) * (1.0 + sqrt(follows));
    double task = fmax(g->doubt * scale, MARGIN * reached * bound);
    return (reduction){g->p == 0 || inverse * loops < 1.0, loops, task, follows};
}

/* Write A B, A (rows, B.rows), to rows of so many columns, which are at least as many as B's. */
static void product(const double *A, int rows, matrix B, int columns, double *to)
{
    memset(to, 0, (size_t)(rows * columns) * sizeof *to);
    for (int i = 0; i < rows; i++)
        for (int t = 0; t < B.rows; t++)
            add(to + i * columns, A[i * B.rows + t], row(B, t), B.width);
}

/* Levels in the form of lexicographic_solve, with w unknowns. */
typedef struct {
    int w, rows, levels;
    double *A, *b, *lower, *upper, *desired, *weight, *scales, *damping, *x, *work;
    int32_t *ends;
    int8_t *state;
} levels_t;

static levels_t levels_at(double *work, int w, int rows, int levels)
{
    levels_t at = {.w = w, .A = work};
    double **parts[] = {&at.b, &at.lower, &at.upper, &at.desired, &at.weight, &at.x, &at.scales,
                        &at.damping, &at.work};
    int sizes[] = {rows * w, rows, w, w, w, w, w, levels, 2 * levels + w};
    for (int i = 0; i < 9; i++)
        *parts[i] = (i ? *parts[i - 1] : work) + sizes[i];
    at.ends = (int32_t *)(at.damping + levels);
    at.state = (int8_t *)(at.damping + 2 * levels);
    for (int j = 0; j < w; j++) {
        at.lower[j] = -INFINITY;
        at.upper[j] = INFINITY;
        at.desired[j] = at.weight[j] = 0.0;
    }
    return at;
}

/* End a level after `rows` more rows, whose singular values up to `doubt` may be zero. */
static void end_level(levels_t *at, int rows, double doubt, double damping)
{
    at->rows += rows;
    at->ends[at->levels] = at->rows;
    at->scales[at->levels] = doubt / (CLEAR * RANK);
    at->damping[at->levels++] = damping;
}

/* Solve the levels; returns whether the optimum was found and all ranks are certain. */
static bool solve(levels_t *at, bool weighted, bool beside)
{
    lexicographic_problem p = {.count = 1, .n = at->w, .levels = at->levels, .matrices = 1,
                               .bounds = 1, .most_steps = 20 * (at->w + 1) * (at->levels + 1),
                               .beside = beside, .tolerance = RANK, .ends = at->ends,
                               .damping = at->damping, .weight = weighted ? at->weight : 0};
    double report[4];
    lexicographic_solve(&p, at->A, at->b, at->scales, at->lower, at->desired, at->work, at->x,
                        at->state, report, 0);
    return report[1] && report[2] >= CLEAR && report[3] >= DECIDED;
}

/* Add the constraints of the rates as the first level. */
static void constrain(const tick_plan *g, const mechanism *of, levels_t *at)
{
    int q = g->c - g->p;
    for (int i = 0; i < q; i++) {
        double *own = at->A + (at->rows + i) * at->w;
        memset(own, 0, (size_t)at->w * sizeof *own);
        memcpy(own, row(of->M, g->p + i) + g->p, (size_t)g->n * sizeof *own);
        at->b[at->rows + i] = 0.0;
    }
    if (q)
        end_level(at, q, of->loops.loops * (1.0 + sqrt(of->loops.follows)), 0.0);
}

/* Return whether the ranks of task directions in the level with the norm are certain. */
static bool are_clear(const tick_plan *g, const mechanism *of, double *work)
{
    int first = g->k - g->e;
    levels_t at = levels_at(work, g->n, g->c - g->p + first + g->d, 2);
    constrain(g, of, &at);
    product(g->S, first, of->J, at.w, at.A + at.rows * at.w);
    product(g->D, g->d, of->J, at.w, at.A + (at.rows + first) * at.w);
    memset(at.b, 0, (size_t)(at.rows + first + g->d) * sizeof *at.b);
    end_level(&at, first + g->d, g->sizes[g->levels] * of->loops.task, 0.0);
    return solve(&at, false, false);
}

/* Solve the levels, with limits of the passive velocities `limited` (p). */
static bool solve_levels(const tick_plan *g, const mechanism *of, const double *right,
                         const double *lower, const double *upper, const int *limited, int s,
                         levels_t *at)
{
    int n = g->n, p = g->p, rows = s + g->c - p + g->k;
    *at = levels_at(at->A, n + s, rows, g->levels + 2);
    for (int j = 0; j < n; j++) {
        double unit = g->velocity_units[g->order[p + j]];
        at->lower[j] = lower[g->order[p + j]] / unit;
        at->upper[j] = upper[g->order[p + j]] / unit;
        at->desired[j] = g->weight ? right[g->k + j] : 0.0;
        at->weight[j] = g->weight ? g->weight[j] : 1.0;
    }
    for (int i = 0; i < s; i++) { /* gain rates / size = y, y within limits / size */
        double *own = at->A + i * at->w, *gain = row(of->M, limited[i]) + p;
        double size = sqrt(dot(gain, gain, n));
        size = size > 0.0 ? size : 1.0;
        double unit = size * g->velocity_units[g->order[limited[i]]];
        memset(own, 0, (size_t)at->w * sizeof *own);
        add(own, 1.0 / size, gain, n);
        own[n + i] = -1.0;
        at->b[i] = 0.0;
        at->lower[n + i] = lower[g->order[limited[i]]] / unit;
        at->upper[n + i] = upper[g->order[limited[i]]] / unit;
    }
    if (s)
        end_level(at, s, CLEAR * RANK, 0.0);
    constrain(g, of, at);
    int first = at->rows; /* the preceding levels must be satisfied */
    product(g->S, g->k, of->J, at->w, at->A + first * at->w);
    for (int i = 0; i < g->k; i++) {
        if (g->R)
            add(at->A + (first + i) * at->w, 1.0, g->R + i * n, n);
        at->b[first + i] = right[i];
    }
    for (int k = 0, begin = 0; k < g->levels; begin = g->ends[k++])
        end_level(at, g->ends[k] - begin, g->sizes[k] * of->loops.task + g->on_rates[k],
                  g->damping ? g->damping[k] : 0.0);
    if (!solve(at, g->weight || s, g->e > 0))
        return false;
    for (int i = 0; i < first; i++) {
        const double *own = at->A + i * at->w;
        double residual = dot(own, at->x, at->w), terms = 0.0;
        for (int j = 0; j < at->w; j++)
            terms += fabs(own[j] * at->x[j]);
        if (fabs(residual) > RANK * terms)
            return false;
    }
    return true;
}

/* Return a velocity from its natural value, within its limits exactly. */
static double within(const tick_plan *g, int64_t k, double value, const double *lower,
                     const double *upper)
{
    return fmin(fmax(value * g->velocity_units[k], lower[k]), upper[k]);
}

/* Write the passive velocities (p) to x; returns whether one violates a limit beyond round-off. */
static bool move_passive(const tick_plan *g, const mechanism *of, const double *lower,
                         const double *upper, const double *rates, double *x)
{
    bool is_beyond = false;
    for (int i = 0; i < g->p; i++) {
        int64_t k = g->order[i];
        const double *gain = row(of->M, i) + g->p;
        double value = dot(gain, rates, g->n), terms = 0.0, unit = g->velocity_units[k];
        for (int j = 0; j < g->n; j++)
            terms += fabs(gain[j] * rates[j]);
        double beyond = fmax(lower[k] / unit - value, value - upper[k] / unit);
        is_beyond = is_beyond || beyond > ROUND_OFF * terms;
        x[k] = within(g, k, value, lower, upper);
    }
    return is_beyond;
}

int tick_room(const tick_plan *g)
{
    int w = g->n + g->p, rows = g->p + g->c + g->k + g->d, levels = g->levels + 2;
    int32_t ends[2] = {rows, rows};
    double one = 1.0;
    lexicographic_problem most = {.n = w, .levels = 2, .ends = ends, .weight = &one};
    int solver = (int)lexicographic_room(&most) + 4 * levels;
    int loops = (g->c + 1) * w + g->p + g->m * g->n + g->k + w + (g->m + g->c) * g->N;
    return loops + rows * (w + 1) + 6 * w + 4 * levels + solver;
}

/* Add the task motion of the rates `along` (n) to the targets of all levels but the first. */
static void move_along(const tick_plan *g, const mechanism *of, const double *along, double *right)
{
    for (int t = 0; t < g->m; t++) {
        double moved = 0.0;
        for (int j = 0; j < g->n; j++)
            moved += row(of->J, t)[j] * along[j] / g->velocity_units[g->order[g->p + j]];
        for (int i = g->ends[0]; i < g->k; i++)
            right[i] += g->S[i * g->m + t] * moved;
    }
}

int tick_solve(const tick_plan *g, const double *J_T, const double *J_C, const double *targets,
               const double *along, const double *lower, const double *upper, double bound,
               double *x, double *work)
{
    int p = g->p, n = g->n, s = 0;
    double own[TICK_OWN_ROOM];
    work = work ? work : own;
    double squares_T = dot(J_T, J_T, g->m * g->N), squares_C = dot(J_C, J_C, g->c * g->N);
    double asked = dot(targets, targets, g->t) + (along ? dot(along, along, g->n) : 0.0);
    if (!(squares_T < INFINITY && squares_C < INFINITY && asked < INFINITY && bound >= 0.0))
        return TICK_REFUSED;
    for (int i = 0; i < p + n; i++)
        if (!are_limits(lower[g->order[i]], upper[g->order[i]]))
            return TICK_REFUSED;
    if (!(bound < INFINITY && fits(squares_T) && fits(squares_C)))
        return TICK_IN_DOUBT;
    if (!fits(asked) || p > g->c || !are_idle(g, J_T, J_C, lower, upper))
        return TICK_IN_DOUBT;
    mechanism of = {.M = {work, g->c + 1, p + n}};
    int *limited = (int *)row(of.M, g->c + 1);
    of.J = (matrix){row(of.M, g->c + 1) + p, g->m, n};
    double *task = row(of.J, g->m), *loops = task + g->m * g->N;
    double size_T = to_natural(g, J_T, g->m, g->task_units, task);
    double size_C = to_natural(g, J_C, g->c, g->loop_units, loops);
    of.loops = eliminate(g, task, loops, size_T, size_C, bound, &of);
    if (!of.loops.is_regular)
        return TICK_IN_DOUBT;
    double *right = loops + g->c * g->N;
    for (int i = 0; i < g->k + n; i++)
        right[i] = i < g->k || g->weight ? dot(g->T + i * g->t, targets, g->t) : 0.0;
    if (along)
        move_along(g, &of, along, right);
    levels_t at = {.A = right + g->k + n};
    if (g->d && !are_clear(g, &of, at.A))
        return TICK_IN_DOUBT;
    if (!solve_levels(g, &of, right, lower, upper, limited, 0, &at))
        return TICK_IN_DOUBT;
    memset(x, 0, (size_t)g->N * sizeof *x);
    if (move_passive(g, &of, lower, upper, at.x, x)) {
        for (int i = 0; i < p; i++)
            if (isfinite(lower[g->order[i]]) || isfinite(upper[g->order[i]]))
                limited[s++] = i;
        if (g->damping || !solve_levels(g, &of, right, lower, upper, limited, s, &at))
            return TICK_IN_DOUBT;
        move_passive(g, &of, lower, upper, at.x, x);
    }
    for (int j = 0; j < n; j++)
        x[g->order[p + j]] = within(g, g->order[p + j], at.x[j], lower, upper);
    return TICK_SOLVED;
}
