/* `make fuzz`: the kernels on whatever libFuzzer makes up, under the sanitizers.
 *
 * The first byte chooses a kernel, a few more its sizes, all others its numbers: round ones,
 * extreme ones, or any bits. Every array is of the exact size that kernels.h states, so that an
 * access beyond it ends the run; and what a kernel calls solved must be finite and within its
 * limits.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "kernels.h"

static const uint8_t *input;
static size_t left;
static void *made[256];
static int count;

static void demand(bool holds, const char *what)
{
    if (!holds) {
        fprintf(stderr, "broken: %s\n", what);
        abort();
    }
}

static unsigned byte(void)
{
    return left ? left--, *input++ : 0;
}

static int size(int least, int most)
{
    return least + (int)(byte() % (unsigned)(most - least + 1));
}

static void *array(int64_t length, size_t each)
{
    return made[count++] = calloc(length > 0 ? (size_t)length : 1, each);
}

static double number(void)
{
    static const double extreme[] = {0.0,     -0.0,     INFINITY, -INFINITY,  NAN,
                                     DBL_MAX, -DBL_MAX, 5e-324,   1e-310,     1e-160,
                                     1e160,   1e100,    1e-17,    DBL_EPSILON};
    const unsigned kind = byte();
    if (kind < 200)
        return ((int)kind - 100) / 16.0;
    if (kind < 200 + 14)
        return extreme[kind - 200];
    if (kind < 230)
        return ((int)byte() - 128) * 1e-9;
    double any;
    for (size_t i = 0; i < sizeof any; i++)
        ((uint8_t *)&any)[i] = (uint8_t)byte();
    return any;
}

static double *room(int64_t length)
{
    return array(length, sizeof(double));
}

static double *numbers(int64_t length)
{
    double *x = room(length);
    for (int64_t i = 0; i < length; i++)
        x[i] = number();
    return x;
}

/* Finite ones of a usual size, where the caller of a kernel is to check them. */
static double *usual(int64_t length)
{
    double *x = numbers(length);
    for (int64_t i = 0; i < length; i++)
        if (!(fabs(x[i]) < 1e6))
            x[i] = 1.0;
    return x;
}

static double *from(double least, int64_t length)
{
    double *x = usual(length);
    for (int64_t i = 0; i < length; i++)
        x[i] = least + fabs(x[i]);
    return x;
}

static double *identity(int rows, int columns)
{
    double *x = room(rows * columns);
    for (int i = 0; i < rows && i < columns; i++)
        x[i * columns + i] = 1.0;
    return x;
}

static bool *flags(int length)
{
    bool *x = array(length, sizeof *x);
    for (int i = 0; i < length; i++)
        x[i] = byte() & 1;
    return x;
}

static int64_t *ordered(int length)
{
    int64_t *x = array(length, sizeof *x);
    for (int i = 0; i < length; i++) {
        const int k = size(0, i);
        x[i] = x[k], x[k] = i;
    }
    return x;
}

/* Where each of so many levels ends in the rows, the last one in the last row. */
static int32_t *ends(int levels, int rows)
{
    int32_t *x = array(levels, sizeof *x);
    for (int i = 0, row = 0; i < levels; i++)
        x[i] = row = i + 1 < levels ? size(row, rows) : rows;
    return x;
}

/* Limits (2, n), which a caller has checked with copy_limits. */
static double *limits(int n)
{
    double *x = room(2 * n);
    const double *lower = numbers(n), *upper = numbers(n);
    if (!copy_limits(n, lower, upper, x))
        for (int i = 0; i < n; i++)
            x[i] = -1.0, x[n + i] = 1.0;
    return x;
}

/* Whether numbers are finite and, where there are any, within their limits. */
static bool within(const double *x, const double *of, int n)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(x[i]) || (of && (x[i] < of[i] || x[i] > of[n + i])))
            return false;
    return true;
}

static void fuzz_lexicographic(void)
{
    const int n = size(0, 6), rows = size(0, 7), levels = size(1, 3), problems = size(0, 3);
    const bool has_weight = byte() & 1;
    lexicographic_problem p = {.count = problems,
                               .n = n,
                               .levels = levels,
                               .most_steps = 50,
                               .tolerance = 1e-10,
                               .ends = ends(levels, rows)};
    p.matrices = byte() & 1 ? problems : 1;
    p.bounds = byte() & 1 ? problems : 1;
    p.beside = has_weight && byte() & 1;
    double *damping = numbers(levels);
    for (int i = 0; i < levels; i++)
        damping[i] = fabs(damping[i]) < 1e120 ? fabs(damping[i]) : 0.0;
    p.damping = byte() & 1 ? damping : NULL;
    p.weight = has_weight ? from(0.0, n) : NULL;
    const double *A = numbers(p.matrices * rows * n), *b = numbers(problems * rows);
    double *bounds = room(2 * n * p.bounds);
    for (int i = 0; i < p.bounds; i++)
        memcpy(bounds + 2 * n * i, limits(n), 2 * (size_t)n * sizeof(double));
    const double *wanted = has_weight ? usual(problems * n) : NULL;
    double *x = room(problems * n), *report = room(4 * problems);
    int8_t *state = array(problems * n, 1);
    int32_t *ranks = byte() & 1 ? array(problems * levels, sizeof *ranks) : NULL;
    lexicographic_solve(&p, A, b, NULL, bounds, wanted, room(lexicographic_room(&p)), x, state,
                        report, ranks);
    for (int i = 0; i < problems; i++)
        if (report[4 * i + 1] >= 0)
            demand(within(x + n * i, bounds + (p.bounds > 1 ? 2 * n * i : 0), n),
                   "a lexicographic optimum is finite and within its bounds");
    p.warm = true; /* from there, again */
    lexicographic_solve(&p, A, b, NULL, bounds, wanted, room(lexicographic_room(&p)), x, state,
                        report, NULL);
}

static void fuzz_problem1(void)
{
    const int m = size(1, 6), n = size(1, 7), m1 = size(0, m), targets = size(0, 3);
    problem1 p = {.count = targets, .m = m, .n = n, .m1 = m1, .m2 = m - m1, .tolerance = 1e-10};
    p.jacobians = byte() & 1 ? targets : 1;
    p.joint = byte() & 1;
    p.secondary = byte() & 1;
    p.clear = byte() & 1 ? 1e-7 : 0.0;
    p.S = identity(m, m);
    const double *J = numbers(p.jacobians * m * n);
    const double *w1 = from(0.0, n), *w2 = from(0.0, p.m2);
    const double *bounds = byte() & 1 ? limits(n) : NULL, *v = numbers(targets * m1);
    const double *rates = byte() & 1 ? numbers(targets * n) : NULL;
    const double *v_s = byte() & 1 ? numbers(targets * p.m2) : NULL;
    double *x = room(targets * n);
    if (problem1_fits(&p, J, w1, w2) &&
        problem1_solve(&p, J, NULL, w1, w2, v, rates, v_s, bounds, room(problem1_room(&p)), x) ==
            PROBLEM1_SOLVED)
        for (int i = 0; i < targets; i++)
            demand(within(x + n * i, bounds, n),
                   "a solution of Problem 1 is finite and within its limits");
}

static void fuzz_tick(void)
{
    const int p = size(0, 3), n = size(1, 5), idles = size(0, 1), N = p + n + idles;
    const int m = size(1, 4), c = p ? size(p, p + 2) : 0, levels = size(1, 2), k = size(1, m);
    const int t = k + (byte() & 1 ? n : 0);
    const int64_t *of = ordered(N);
    const double *limit = limits(N);
    tick_plan plan = {.m = m, .c = c, .N = N, .t = t, .p = p, .n = n, .idles = idles, .k = k};
    plan.levels = levels;
    plan.order = of;
    plan.idle = of + p + n;
    plan.S = usual(k * m);
    plan.T = identity(t, t);
    plan.R = byte() & 1 ? usual(k * n) : NULL;
    plan.weight = t > k ? from(1e-3, n) : NULL;
    plan.sizes = from(1.0, levels + 1);
    plan.on_rates = room(levels);
    plan.ends = ends(levels, k);
    plan.error_C = plan.error_T = 1.0;
    plan.doubt = 1e-7;
    plan.task_units = from(0.5, m);
    plan.loop_units = from(0.5, c);
    plan.velocity_units = from(0.5, N);
    double *x = room(N);
    const double *J_T = numbers(m * N), *J_C = numbers(c * N), *targets = numbers(t);
    if (tick_solve(&plan, J_T, J_C, targets, NULL, limit, limit + N, 0.0, x,
                   room(tick_room(&plan))) == TICK_SOLVED)
        demand(within(x, NULL, N), "velocities of a tick are finite");
}

static void fuzz_loops(void)
{
    const int p = size(0, 4), n = size(0, 4), N = p + n, c = size(p, p + 3), m = size(0, 4);
    const bool closing = byte() & 1;
    const int width = p + n + (closing ? c : 0);
    const int64_t *order = ordered(N);
    double *M = room((c + 1) * width);
    close_loops(numbers(c * N), c, N, order, p, n, closing, M);
    reduce_task(numbers(m * N), m, N, order, p, n, M + p, width, room(m * n));

    const int h = size(0, n), g = size(0, c);
    const drives_model of = {N, n, order, byte() & 1 ? usual(N * N) : NULL};
    int64_t *held = array(h, sizeof *held);
    for (int i = 0; i < h; i++)
        held[i] = size(0, n ? n - 1 : 0);
    double *motion = room(N), *work = room(nearest_room(c, h, of.springs ? N : 0, N));
    if (nearest_motion(&of, c, usual(c * N), g, usual(g), h, held, usual(n), usual(n), work,
                       motion) == MOTION_SOLVED)
        demand(within(motion, NULL, N), "a motion that was found is finite");

    const int bases = size(0, 2), columns = size(0, N), all = bases * N * columns;
    canonical_bases(bases, N, columns, usual(all), room(all), room(columns));
}

static void fuzz_boxes(void)
{
    const int n = size(0, 6);
    double *box = room(2 * n);
    static const double periods_s[] = {1e-9, 1e-3, 0.01, 1.0, 1e6};
    if (viable_box(n, numbers(8 * n), periods_s[size(0, 4)], box, box + n, flags(n)))
        for (int i = 0; i < n; i++)
            demand(box[i] <= box[n + i], "a box of viable rates is not empty");
    const conversion by = {number(), -1.0, 1.0, 2.0, byte() & 1};
    convert(&by, n, numbers(n), numbers(n));
}

static void fuzz_evidence(void)
{
    const int H = size(1, 2), K = size(1, 2), J = size(0, 2), p = size(1, 2), q = size(1, 2);
    const int HK = H * K, row = (5 + J) * p, R = J + p + 4;
    const evidence of = {usual(HK * q * row), usual(HK * (R * (R + 1) / 2)), usual(HK * R),
                         usual(HK)};
    weigh_sample(H, K, J, p, q, flags(HK), flags(K), byte() & 1, &of, usual(HK * row),
                 usual(HK * p), usual(p), usual(J + p), usual(2 * q * row),
                 room(p * (2 * J + p + 12)), &of);
    double *spread = usual(R * R);
    for (int i = 0; i < R; i++)
        for (int j = i + 1; j < R; j++)
            spread[i * R + j] = 0.0;
    integrate_out(HK, R, of.information, spread, room(R * (2 * R + 1)), usual(HK * R * 3),
                  room(HK));
}

static void fuzz_detection(void)
{
    const int q = size(1, 3), J = size(0, 2), p = size(1, 3), k = J + p, n = size(0, 4);
    const int rows = (1 + J) * p, M = size(1, 40);
    const observer_state of = {usual(q * rows), usual(k), usual(k * k), usual(q * p), usual(q * p)};
    const observer_state after = {room(q * rows), room(k), room(k * k), room(q * p), room(q * p)};
    correct(q, J, p, &of, usual(rows), numbers(p), usual(p * (q + 1)), usual(k), 0.01, number(),
            byte() & 1, room(k * (2 * k + p + 2) + p), &after, room(p));
    predict(usual(q + 1), q, room(q));
    spread_root(usual(k * k), usual(k), k, room(2 * k * (k + 1)), room(k * k));
    alarming(M, p, numbers(M * p), byte() & 1 ? numbers(2 * M) : NULL, size(1, 4), number(),
             number(), room(3 * p));
    const int E = size(0, 3), d = size(1, 4), H = size(0, 3);
    const bool one = byte() & 1;
    to_segments(H, E, d, usual(H * d), usual(E * d), usual(E * d), usual((one ? 1 : H) * d * d),
                usual((one ? 1 : E) * d * d), one, room(segments_room(d)), room(H * E));
    compensate(numbers((n + p) * (n + q)), n + p, n, q, numbers(n), numbers(q), room(n + p));
    recur(n, M, numbers(n * n), numbers(M * n), numbers((M + 1) * n));
}

static void fuzz_friction(void)
{
    const int s = size(0, 4), r = size(0, 2), n = size(0, 2), p = size(0, 2), states = size(0, 2);
    double *K = usual(r * r);
    for (int i = 0; i < r; i++)
        K[i * r + i] = 1.0 + fabs(K[i * r + i]);
    friction_model of = {.s = s, .r = r, .n = n, .p = p, .steps_a_tick = size(1, 3), .K = K};
    of.A = usual(s * s), of.B = usual(s * (n + 1)), of.G = usual(s * r);
    of.E = usual(r * s), of.D = usual(r * (n + 1)), of.limit = from(0.0, r), of.C = usual(p * s);
    slide(&of, states, usual(states * (n + 1)), room(2 * s + 3 * r), usual(states * s));
}

static void fuzz_poses(void)
{
    const int poses = size(0, 3);
    double *R = numbers(9 * poses), *t = numbers(3 * poses), *twists = numbers(6 * poses);
    move(poses, R, t, twists, room(9 * poses), room(3 * poses));
    displacements(poses, R, t, twists);
    const strut_nodes nodes = {numbers(18), numbers(18), numbers(6)};
    double *A = room(36 * poses), *lengths = room(6 * poses);
    if (strut_lengths(&nodes, poses, R, t, lengths, A) && poses)
        follow(&nodes, R, t, A, numbers(6), numbers(6), room(9), room(3), room(36), room(6));
    spot(numbers(9), number(), 1.0, number(), numbers(2), room(2));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t length)
{
    static void (*const kernels[])(void) = {fuzz_lexicographic, fuzz_problem1, fuzz_tick,
                                            fuzz_loops,         fuzz_boxes,    fuzz_evidence,
                                            fuzz_detection,     fuzz_friction, fuzz_poses};
    input = data, left = length, count = 0;
    kernels[byte() % (sizeof kernels / sizeof *kernels)]();
    while (count)
        free(made[--count]);
    return 0;
}
