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

static void *array(size_t length, size_t each)
{
    made[count] = calloc(length ? length : 1, each);
    return made[count++];
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
    union {
        uint64_t bits;
        double value;
    } any = {0};
    for (int i = 0; i < 8; i++)
        any.bits = any.bits << 8 | byte();
    return any.value;
}

static double *numbers(size_t length)
{
    double *x = array(length, sizeof *x);
    for (size_t i = 0; i < length; i++)
        x[i] = number();
    return x;
}

/* Finite ones of a usual size, where the caller of a kernel is to check them. */
static double *usual(size_t length)
{
    double *x = numbers(length);
    for (size_t i = 0; i < length; i++)
        if (!(fabs(x[i]) < 1e6))
            x[i] = 1.0;
    return x;
}

static double *room(int64_t length)
{
    return array((size_t)(length > 0 ? length : 0), sizeof(double));
}

static bool *flags(size_t length)
{
    bool *x = array(length, sizeof *x);
    for (size_t i = 0; i < length; i++)
        x[i] = byte() & 1;
    return x;
}

static int64_t *ordered(int length)
{
    int64_t *x = array((size_t)length, sizeof *x);
    for (int i = 0; i < length; i++)
        x[i] = i;
    for (int i = length - 1; i > 0; i--) {
        const int k = size(0, i);
        const int64_t kept = x[i];
        x[i] = x[k], x[k] = kept;
    }
    return x;
}

/* Where each of so many levels ends in the rows, the last one in the last row. */
static int32_t *ends(int levels, int rows)
{
    int32_t *x = array((size_t)levels, sizeof *x);
    for (int i = 0, row = 0; i < levels; i++)
        x[i] = row = i + 1 < levels ? size(row, rows) : rows;
    return x;
}

/* Limits (2, n), which a caller has checked with copy_limits. */
static double *limits(int n)
{
    double *x = room(2 * n);
    const double *lower = numbers((size_t)n), *upper = numbers((size_t)n);
    if (!copy_limits(n, lower, upper, x))
        for (int i = 0; i < n; i++)
            x[i] = -1.0, x[n + i] = 1.0;
    return x;
}

static bool within(const double *x, const double *of, int n)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(x[i]) || x[i] < of[i] || x[i] > of[n + i])
            return false;
    return true;
}

static bool finite(const double *x, int n)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(x[i]))
            return false;
    return true;
}

static void fuzz_lexicographic(void)
{
    const int n = size(0, 6), rows = size(0, 7), levels = size(1, 3), problems = size(0, 3);
    const bool own = byte() & 1, has_weight = byte() & 1;
    lexicographic_problem p = {.count = problems,
                               .n = n,
                               .levels = levels,
                               .most_steps = 50,
                               .matrices = own ? problems : 1,
                               .bounds = byte() & 1 ? problems : 1,
                               .beside = has_weight && byte() & 1,
                               .tolerance = 1e-10,
                               .ends = ends(levels, rows)};
    if (byte() & 1)
        p.damping = numbers((size_t)levels);
    for (int i = 0; p.damping && i < levels; i++)
        ((double *)p.damping)[i] = fabs(p.damping[i]) < 1e120 ? fabs(p.damping[i]) : 0.0;
    if (has_weight)
        p.weight = usual((size_t)n);
    for (int i = 0; p.weight && i < n; i++)
        ((double *)p.weight)[i] = fabs(p.weight[i]);
    const double *A = numbers((size_t)(p.matrices * rows * n)),
                 *b = numbers((size_t)(problems * rows));
    double *bounds = room(2 * (int64_t)n * p.bounds);
    for (int i = 0; i < p.bounds; i++)
        memcpy(bounds + 2 * n * i, limits(n), 2 * (size_t)n * sizeof(double));
    const double *wanted = has_weight ? usual((size_t)(problems * n)) : NULL;
    double *x = room(problems * n), *report = room(4 * problems);
    int8_t *state = array((size_t)(problems * n), 1);
    int32_t *ranks = byte() & 1 ? array((size_t)(problems * levels), sizeof *ranks) : NULL;
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
    problem1 p = {.count = targets,
                  .jacobians = byte() & 1 ? targets : 1,
                  .m = m,
                  .n = n,
                  .m1 = m1,
                  .m2 = m - m1,
                  .joint = byte() & 1,
                  .secondary = byte() & 1,
                  .tolerance = 1e-10,
                  .clear = byte() & 1 ? 1e-7 : 0.0};
    double *S = room(m * m);
    for (int i = 0; i < m; i++)
        S[i * m + i] = 1.0;
    p.S = S;
    const double *J = numbers((size_t)(p.jacobians * m * n));
    double *w1 = usual((size_t)n), *w2 = usual((size_t)p.m2);
    for (int i = 0; i < n; i++)
        w1[i] = fabs(w1[i]);
    for (int i = 0; i < p.m2; i++)
        w2[i] = fabs(w2[i]);
    const double *bounds = byte() & 1 ? limits(n) : NULL, *v = numbers((size_t)(targets * m1));
    const double *rates = byte() & 1 ? numbers((size_t)(targets * n)) : NULL;
    const double *v_s = byte() & 1 ? numbers((size_t)(targets * p.m2)) : NULL;
    double *x = room(targets * n);
    if (!problem1_fits(&p, J, w1, w2))
        return;
    if (problem1_solve(&p, J, NULL, w1, w2, v, rates, v_s, bounds, room(problem1_room(&p)), x) !=
        PROBLEM1_SOLVED)
        return;
    for (int i = 0; i < targets; i++)
        demand(bounds ? within(x + n * i, bounds, n) : finite(x + n * i, n),
               "a solution of Problem 1 is finite and within its limits");
}

static void fuzz_tick(void)
{
    const int p = size(0, 3), n = size(1, 5), idles = size(0, 1), N = p + n + idles;
    const int m = size(1, 4), c = p ? size(p, p + 2) : 0, levels = size(1, 2), k = size(1, m);
    const bool weighted = byte() & 1;
    int64_t *of = ordered(N);
    double *limit = limits(N), *sizes = room(levels + 1), *on_rates = room(levels);
    for (int i = 0; i <= levels; i++)
        sizes[i] = 1.0 + size(0, 3);
    double *units[3];
    const int lengths[3] = {m, c, N};
    for (int i = 0; i < 3; i++) {
        units[i] = room(lengths[i]);
        for (int j = 0; j < lengths[i]; j++)
            units[i][j] = 0.5 + size(0, 3);
    }
    double *weight = usual((size_t)n);
    for (int i = 0; i < n; i++)
        weight[i] = fabs(weight[i]) + 1e-3;
    const int t = k + (weighted ? n : 0);
    double *T = room((weighted ? k + n : k) * t);
    for (int i = 0; i < t; i++)
        T[i * t + i] = 1.0;
    const tick_plan plan = {.m = m,
                            .c = c,
                            .N = N,
                            .t = t,
                            .p = p,
                            .n = n,
                            .idles = idles,
                            .k = k,
                            .levels = levels,
                            .order = of,
                            .idle = of + p + n,
                            .S = usual((size_t)(k * m)),
                            .T = T,
                            .R = byte() & 1 ? usual((size_t)(k * n)) : NULL,
                            .weight = weighted ? weight : NULL,
                            .sizes = sizes,
                            .on_rates = on_rates,
                            .ends = ends(levels, k),
                            .error_C = 1.0,
                            .error_T = 1.0,
                            .doubt = 1e-7,
                            .task_units = units[0],
                            .loop_units = units[1],
                            .velocity_units = units[2]};
    double *x = room(N);
    const double *J_T = numbers((size_t)(m * N)), *J_C = numbers((size_t)(c * N));
    const double *targets = numbers((size_t)t);
    if (tick_solve(&plan, J_T, J_C, targets, NULL, limit, limit + N, 0.0, x,
                   room(tick_room(&plan))) == TICK_SOLVED) {
        demand(finite(x, N), "velocities of a tick are finite");
    }
}

static void fuzz_loops(void)
{
    const int p = size(0, 4), n = size(0, 4), N = p + n, c = size(p, p + 3), m = size(0, 4);
    const bool closing = byte() & 1;
    const int width = p + n + (closing ? c : 0);
    const int64_t *order = ordered(N);
    double *M = room((c + 1) * width), *J = room(m * n);
    close_loops(numbers((size_t)(c * N)), c, N, order, p, n, closing, M);
    reduce_task(numbers((size_t)(m * N)), m, N, order, p, n, M + p, width, J);

    const int h = size(0, n), g = size(0, c);
    const drives_model of = {N, n, order, byte() & 1 ? usual((size_t)(N * N)) : NULL};
    int64_t *held = array((size_t)h, sizeof *held);
    for (int i = 0; i < h; i++)
        held[i] = size(0, n ? n - 1 : 0);
    double *motion = room(N);
    const int found = nearest_motion(&of, c, usual((size_t)(c * N)), g, usual((size_t)g), h, held,
                                     usual((size_t)n), usual((size_t)n),
                                     room(nearest_room(c, h, of.springs ? N : 0, N)), motion);
    demand(found != MOTION_FOUND || finite(motion, N), "a motion that was found is finite");

    const int bases = size(0, 2), columns = size(0, N);
    canonical_bases(bases, N, columns, usual((size_t)(bases * N * columns)),
                    room(bases * N * columns), room(columns));
}

static void fuzz_boxes(void)
{
    const int n = size(0, 6);
    double *lower = room(n), *upper = room(n);
    bool *viable = flags((size_t)n);
    static const double periods_s[] = {1e-9, 1e-3, 0.01, 1.0, 1e6};
    if (viable_box(n, numbers(8 * (size_t)n), periods_s[size(0, 4)], lower, upper, viable))
        for (int i = 0; i < n; i++)
            demand(lower[i] <= upper[i], "a box of viable rates is not empty");
    const conversion by = {number(), -1.0, 1.0, 2.0, byte() & 1};
    convert(&by, n, numbers((size_t)n), numbers((size_t)n));
}

static void fuzz_evidence(void)
{
    const int H = size(1, 2), K = size(1, 2), J = size(0, 2), p = size(1, 2), q = size(1, 2);
    const size_t HK = (size_t)(H * K), row = (size_t)((5 + J) * p);
    const int R = J + p + 4;
    const evidence of = {usual(HK * (size_t)q * row), usual(HK * (size_t)(R * (R + 1) / 2)),
                         usual(HK * (size_t)R), usual(HK)};
    weigh_sample(H, K, J, p, q, flags(HK), flags((size_t)K), byte() & 1, &of, usual(HK * row),
                 usual(HK * (size_t)p), usual((size_t)p), usual((size_t)(J + p)),
                 usual(2 * (size_t)q * row), room(p * (2 * J + p + 12)), &of);
    double *spread = usual((size_t)(R * R));
    for (int i = 0; i < R; i++)
        for (int j = i + 1; j < R; j++)
            spread[i * R + j] = 0.0;
    integrate_out((int)HK, R, of.information, spread, room(R * (2 * R + 1)),
                  usual(HK * (size_t)R * 3), room((int64_t)HK));
}

static void fuzz_detection(void)
{
    const int q = size(1, 3), J = size(0, 2), p = size(1, 3), k = J + p, n = size(0, 4);
    const watched of = {usual((size_t)(q * (1 + J) * p)), usual((size_t)k), usual((size_t)(k * k)),
                        usual((size_t)(q * p)), usual((size_t)(q * p))};
    const watched after = {room(q * (1 + J) * p), room(k), room(k * k), room(q * p), room(q * p)};
    correct(q, J, p, &of, usual((size_t)((1 + J) * p)), numbers((size_t)p),
            usual((size_t)(p * (q + 1))), usual((size_t)k), 0.01, number(), byte() & 1,
            room(k * (2 * k + p + 2) + p), &after, room(p));
    predict(usual((size_t)(q + 1)), q, room(q));
    spread_root(usual((size_t)(k * k)), usual((size_t)k), k, room(2 * k * (k + 1)), room(k * k));
    const int M = size(1, 40);
    alarming(M, p, numbers((size_t)(M * p)), byte() & 1 ? numbers(2 * (size_t)M) : NULL, size(1, 4),
             number(), number(), room(3 * p));
    const int E = size(0, 3), d = size(1, 4), H = size(0, 3);
    const bool one = byte() & 1;
    to_segments(H, E, d, usual((size_t)(H * d)), usual((size_t)(E * d)), usual((size_t)(E * d)),
                usual((size_t)((one ? 1 : H) * d * d)), usual((size_t)((one ? 1 : E) * d * d)), one,
                room(segments_room(d)), room(H * E));
    compensate(numbers((size_t)((n + p) * (n + q))), n + p, n, q, numbers((size_t)n),
               numbers((size_t)q), room(n + p));
    recur(n, M, numbers((size_t)(n * n)), numbers((size_t)(M * n)), numbers((size_t)((M + 1) * n)));
}

static void fuzz_friction(void)
{
    const int s = size(0, 4), r = size(0, 2), n = size(0, 2), p = size(0, 2), states = size(0, 2);
    double *K = usual((size_t)(r * r)), *limit = usual((size_t)r);
    for (int i = 0; i < r; i++)
        limit[i] = fabs(limit[i]), K[i * r + i] = 1.0 + fabs(K[i * r + i]);
    const rubbing of = {s,
                        r,
                        n,
                        p,
                        size(1, 3),
                        usual((size_t)(s * s)),
                        usual((size_t)(s * (n + 1))),
                        usual((size_t)(s * r)),
                        usual((size_t)(r * s)),
                        usual((size_t)(r * (n + 1))),
                        K,
                        limit,
                        usual((size_t)(p * s))};
    slide(&of, states, usual((size_t)(states * (n + 1))), room(2 * s + 3 * r),
          usual((size_t)(states * s)));
}

static void fuzz_poses(void)
{
    const int poses = size(0, 3);
    double *R = numbers(9 * (size_t)poses), *t = numbers(3 * (size_t)poses);
    double *twists = numbers(6 * (size_t)poses);
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
