#include <math.h>
#include <string.h>

#include "kernels.h"

/* Return the sum of squares of some numbers. */
static double sum_of_squares(const double *numbers, int count)
{
    double total = 0.0;
    for (int i = 0; i < count; i++)
        total += numbers[i] * numbers[i];
    return total;
}

/* Write the transpose of a matrix (k, k). */
static void transpose(const double *matrix, int k, double *out)
{
    for (int i = 0; i < k; i++)
        for (int j = 0; j < k; j++)
            out[j * k + i] = matrix[i * k + j];
}

/* Overwrite upper (k, k), the transpose of a root, by that of spread_root.
 *
 * Column by column one reflection moves all deviations into the diagonal. Workspace: k (k + 2).
 */
static void spread(const double *deviations, int k, double *work, double *upper)
{
    double *steps = work, *unit = steps + k * k, *along = unit + k;
    memset(steps, 0, k * k * sizeof *steps);
    for (int j = 0; j < k; j++) {
        steps[j * k + j] = deviations[j];
        double square = 0.0;
        for (int i = 0; i <= j; i++)
            square += steps[i * k + j] * steps[i * k + j];
        double size = sqrt(square), diagonal = upper[j * k + j];
        if (size == 0.0)
            continue;
        double length = sqrt(diagonal * diagonal + square);
        double cosine = diagonal / length, sine = size / length;
        memset(along, 0, k * sizeof *along);
        for (int i = 0; i <= j; i++) {
            unit[i] = steps[i * k + j] / size;
            for (int a = j; a < k; a++)
                along[a] += unit[i] * steps[i * k + a];
        }
        for (int a = j; a < k; a++) {
            double kept = upper[j * k + a], step = along[a];
            upper[j * k + a] = cosine * kept + sine * step;
            along[a] = cosine * step - sine * kept - step;
        }
        for (int i = 0; i <= j; i++)
            for (int a = j; a < k; a++)
                steps[i * k + a] += unit[i] * along[a];
    }
}

void spread_root(const double *root, const double *deviations, int k, double *work, double *after)
{
    double *upper = work + k * (k + 2);
    transpose(root, k, upper);
    spread(deviations, k, work, upper);
    transpose(upper, k, after);
}

/* Update errors (p), mean (k) and the transposed root (k, k) by whitened residuals, in place.
 *
 * One output after another, each by rotations of [1, g' root; 0, root] into [deviation of its
 * error, 0; gain, updated root]. Errors are in standard deviations, which grow with the regressors
 * (k, p) and with the covariance.
 */
static void measure(const double *white, const double *regressors, int k, int p, double *gain,
                    double *mean, double *upper, double *errors)
{
    for (int i = 0; i < p; i++) {
        double left = white[i], deviation = 1.0;
        memset(gain, 0, k * sizeof *gain);
        for (int a = 0; a < k; a++)
            left -= mean[a] * regressors[a * p + i];
        for (int j = k - 1; j >= 0; j--) {
            double seen = 0.0, *row = upper + j * k;
            for (int a = j; a < k; a++)
                seen += row[a] * regressors[a * p + i];
            double length = sqrt(deviation * deviation + seen * seen);
            double cosine = deviation / length, sine = seen / length;
            for (int a = j; a < k; a++) {
                double kept = row[a];
                row[a] = cosine * kept - sine * gain[a];
                gain[a] = cosine * gain[a] + sine * kept;
            }
            deviation = length;
        }
        errors[i] = left / deviation;
        for (int a = 0; a < k; a++)
            mean[a] += gain[a] * errors[i];
    }
}

bool correct(int q, int J, int p, const observer_state *before, const double *predicted,
             const double *y, const double *whitening, const double *drift, double rate,
             double largest, bool learns, double *work, const observer_state *after,
             double *residual)
{
    int k = J + p, n = (1 + J) * p;
    double *upper = work + k * (k + 2), *regressors = upper + k * k, *white = regressors + k * p;
    double *newest = after->memory + (q - 1) * n;
    memcpy(after->memory, before->memory + n, (q - 1) * n * sizeof *newest);
    memcpy(newest, predicted, n * sizeof *newest);
    memset(white, 0, p * sizeof *white);
    memset(regressors, 0, k * p * sizeof *regressors);
    for (int i = 0; i < p; i++)
        newest[i] = y[i] - predicted[i];
    for (int lag = 0; lag < q; lag++) {
        const double *weights = whitening + (q - 1 - lag) * p, *past = after->memory + lag * n;
        for (int i = 0; i < p; i++) {
            white[i] += weights[i] * past[i];
            regressors[(J + i) * p + i] += weights[i];
        }
        for (int row = 0; row < J; row++)
            for (int i = 0; i < p; i++)
                regressors[row * p + i] += weights[i] * past[(row + 1) * p + i];
    }
    memcpy(after->mean, before->mean, k * sizeof *after->mean);
    transpose(before->root, k, upper);
    measure(white, regressors, k, p, work, after->mean, upper, residual);
    if (!learns || sum_of_squares(residual, p) > largest)
        return false;
    spread(drift, k, work, upper);
    transpose(upper, k, after->root);
    double *left = after->recent + (q - 1) * p;
    memcpy(after->recent, before->recent + p, (q - 1) * p * sizeof *left);
    for (int i = 0; i < p; i++) {
        left[i] = newest[i] - after->mean[J + i];
        for (int row = 0; row < J; row++)
            left[i] -= after->mean[row] * newest[(row + 1) * p + i];
        for (int lag = 0; lag < q; lag++) {
            double past = before->covariance[lag * p + i];
            double product = left[i - lag * p] * left[i];
            after->covariance[lag * p + i] = past + rate * (product - past);
        }
    }
    return true;
}

void predict(const double *covariance, int q, double *weights)
{
    double variance = covariance[0];
    for (int k = 0; k < q; k++) {
        double left = covariance[k + 1];
        for (int i = 0; i < k; i++)
            left -= weights[i] * covariance[k - i];
        weights[k] = left / variance;
        for (int i = 0, j = k - 1; i <= j; i++, j--) {
            double one = weights[i], other = weights[j];
            weights[i] = one - weights[k] * other;
            weights[j] = other - weights[k] * one;
        }
        variance *= 1.0 - weights[k] * weights[k];
    }
}

int alarming(int M, int p, const double *recent, const double *swing, int shortest,
             double threshold, double demodulated_threshold, double *work)
{
    double *turned = work + p;
    int window = 1;
    memset(work, 0, 3 * p * sizeof *work);
    for (int k = 0; k < M; k++) {
        for (int i = 0; i < p; i++) {
            double newest = recent[(M - 1 - k) * p + i];
            work[i] += newest;
            for (int phase = 0; swing && phase < 2; phase++)
                turned[phase * p + i] += swing[2 * k + phase] * newest;
        }
        if (k + 1 < window)
            continue;
        if (sum_of_squares(work, p) > threshold * window)
            return window;
        /* The mean square of a sinusoid is one half. */
        if (window >= shortest
            && 2.0 * sum_of_squares(turned, 2 * p) > demodulated_threshold * window)
            return window;
        window *= 2;
    }
    return 0;
}
