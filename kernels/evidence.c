#include <float.h>
#include <math.h>
#include <string.h>

#include "kernels.h"
#include "numerics.h"

/* Add columns, `stride` numbers apart, each times one entry of x, to `out`.
 *
 * Four at a time, because the sums are many and short.
 */
INLINED
void add_columns(const double *columns, int count, int stride, int64_t length,
                 const double *x, double *restrict out)
{
    int j = 0;
    for (; j + 4 <= count; j += 4, columns += 4 * stride) {
        const double *two = columns + stride, *three = two + stride, *four = three + stride;
        double a = x[j], b = x[j + 1], c = x[j + 2], d = x[j + 3];
        for (int64_t i = 0; i < length; i++)
            out[i] += columns[i] * a + two[i] * b + three[i] * c + four[i] * d;
    }
    for (; j < count; j++, columns += stride)
        for (int64_t i = 0; i < length; i++)
            out[i] += columns[i] * x[j];
}

/* Add contiguous columns times entries of x within their non-zero spans. */
INLINED
void add_spans(const double *columns, int count, int stride, const int64_t *spans,
               const double *x, double *out)
{
    for (int j = 0, next; j < count; j = next) {
        int64_t start = spans[2 * j], end = spans[2 * j + 1];
        for (next = j + 1; next < count && next < j + 4; next++) {
            start = spans[2 * next] < start ? spans[2 * next] : start;
            end = spans[2 * next + 1] > end ? spans[2 * next + 1] : end;
        }
        const double *first = columns + j * stride + start;
        add_columns(first, next - j, stride, end - start, x + j, out + start);
    }
}

WIDE
void advance_models(int H, int K, int rows, int s, int p, int r, const bool *steps,
                    const double *alone, const double *driven, const int64_t *spans,
                    const double *v, const double *age, double *work, double *X, double *outputs)
{
    int w = p + s, n = rows * w;
    double *input = work, *out = input + n;
    for (int h = 0; h < H; h++, alone += s * w, driven += (s + r) * n, spans += (s + r) * 2) {
        memset(input, 0, n * sizeof *input);
        add_spans(driven + s * n, r, n, spans + 2 * s, v, input);
        for (int k = 0; k < K; k++) {
            double *states = X + (h * K + k) * rows * s, *seen = outputs + (h * K + k) * rows * p;
            if (!steps[h * K + k])
                continue;
            memcpy(out, input, n * sizeof *out);
            add_spans(driven, s, n, spans, states, out);
            for (int i = n - w; i < n; i++)
                out[i] *= age[k];
            for (int row = 0; row < rows; row++) {
                double *sum = out + row * w;
                add_columns(alone, s, w, w, states + row * s, sum);
                memcpy(seen + row * p, sum, p * sizeof *sum);
                memcpy(states + row * s, sum + p, s * sizeof *sum);
            }
        }
    }
}

/* Return the evidence at one place, given the sizes of memory, sums and parameters. */
static evidence at(const evidence *all, int place, int memory, int sums, int R)
{
    return (evidence){all->memory + place * memory, all->information + place * sums,
                      all->score + place * R, all->energy + place};
}

WIDE
void weigh_sample(int H, int K, int J, int p, int q, const bool *steps, const bool *begins,
                  bool weighs, const evidence *before, const double *outputs,
                  const double *slopes, const double *y, const double *mean,
                  const double *weights, double *work, const evidence *after)
{
    int rows = 4 + J, n = (rows + 1) * p, R = J + p + 4, sums = R * (R + 1) / 2;
    double *white = work, *regressors = white + n, *offsets = regressors + p * R;
    double *own = offsets + 2 * p;
    memset(regressors, 0, (p * R + 2 * p) * sizeof *work);
    for (int row = 0; row < 2 * q; row++)
        for (int i = 0; i < p; i++)
            offsets[row / q * p + i] += weights[row * n + i];
    for (int place = H * K - 1; place >= 0; place--) {
        int h = place / K, k = place % K, last = h == H - 1;
        bool first = steps[place] && begins[k] && 0 < h && !last;
        evidence old = at(before, first ? 0 : place, q * n, sums, R);
        evidence updated = at(after, place, q * n, sums, R);
        double *newest = updated.memory + (q - 1) * n;
        const double *output = outputs + place * rows * p;
        if (steps[place])
            memmove(updated.memory, old.memory + n, (q - 1) * n * sizeof *newest);
        else if (updated.memory != old.memory)
            memcpy(updated.memory, old.memory, q * n * sizeof *newest);
        if (!steps[place] || !weighs) {
            memmove(updated.information, old.information, sums * sizeof *newest);
            memmove(updated.score, old.score, R * sizeof *newest);
            *updated.energy = *old.energy;
        }
        if (!steps[place])
            continue;
        for (int i = 0; i < p; i++) {
            double left = y[i] - output[i] - mean[J + i];
            for (int row = 1; row <= J; row++)
                left -= mean[row - 1] * output[row * p + i];
            newest[i] = left;
            newest[rows * p + i] = slopes[place * p + i];
        }
        memcpy(newest + p, output + p, (rows - 1) * p * sizeof *newest);
        if (!weighs)
            continue;
        memset(white, 0, n * sizeof *white);
        for (int j = 0; j < q * n; j += n)
            for (int i = 0; i < n; i++)
                white[i] += weights[last * q * n + j + i] * updated.memory[j + i];
        double energy = *old.energy;
        for (int i = 0; i < p; i++) {
            energy += white[i] * white[i];
            regressors[i * R + J + i] = offsets[last * p + i];
            for (int row = 0; row < J + 4; row++)
                regressors[i * R + (row < J ? row : p + row)] = white[(1 + row) * p + i];
        }
        *updated.energy = energy;
        for (int row = 0; row < R; row++) {
            double total = old.score[row], *sum = updated.information + row * (row + 1) / 2;
            for (int i = 0; i < p; i++) {
                own[i] = regressors[i * R + row];
                total += own[i] * white[i];
            }
            memmove(sum, old.information + row * (row + 1) / 2, (row + 1) * sizeof *sum);
            int only = row - J; /* the offset of a sensor affects one output */
            if (0 <= only && only < p)
                add_columns(regressors + only * R, 1, R, row + 1, own + only, sum);
            else
                add_columns(regressors, p, R, row + 1, own, sum);
            updated.score[row] = total;
        }
    }
}

WIDE
void integrate_out(int count, int R, const double *information, const double *spread,
                   double *work, double *solved, double *log_det)
{
    /* Computed by rows of the transposed root. */
    double *product = work, *root = product + R * R, *x = root + R * R;
    for (; count > 0; count--, information += R * (R + 1) / 2, solved += R * 3, log_det++) {
        memset(work, 0, 2 * R * R * sizeof *work);
        *log_det = 0.0;
        for (int row = 0; row < R; row++) {
            for (int b = 0; b < R; b++)
                x[b] = information[b < row ? row * (row + 1) / 2 + b : b * (b + 1) / 2 + row];
            add_columns(spread, R, R, row + 1, x, product + row * R);
        }
        for (int row = 0; row < R; row++) {
            double *own = root + row * R;
            for (int b = 0; b < R; b++)
                x[b] = b < row ? -root[b * R + row] : product[b * R + row];
            add_columns(spread + row * R + row, R - row, R, R - row, x + row, own + row);
            double least = R * DBL_EPSILON * own[row];
            least = least > 1.0 ? least : 1.0;
            own[row] += 1.0;
            add_columns(root + row, row, R, R - row, x, own + row);
            own[row] = sqrt(least > own[row] ? least : own[row]);
            for (int b = row + 1; b < R; b++)
                own[b] /= own[row];
            *log_det += log(own[row]);
            for (int i = 0; i < 3; i++) {
                solved[row * 3 + i] /= own[row];
                for (int b = row + 1; b < R; b++)
                    solved[b * 3 + i] -= own[b] * solved[row * 3 + i];
            }
        }
        for (int row = R - 1; row >= 0; row--)
            for (int i = 0; i < 3; i++) {
                double left = solved[row * 3 + i];
                for (int b = row + 1; b < R; b++)
                    left -= root[row * R + b] * solved[b * 3 + i];
                solved[row * 3 + i] = left / root[row * R + row];
            }
    }
}
