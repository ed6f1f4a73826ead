/* Whether matrices are clearly of full rank: a bound in place of singular values. */
#include <math.h>

#include "kernels.h"

bool all_exceed(double *A, int rows, int n, const int64_t *ends, int count, const double *least)
{
    double total = 0.0;
    if (rows > n)
        return false;
    for (int i = 0; i < rows; i++) {
        double *own = A + i * n, square = 0.0;
        for (int j = i; j < n; j++)
            square += own[j] * own[j];
        double norm = sqrt(square);
        if (!(norm > 0.0))
            return false;
        double first = copysign(norm, own[i]);
        own[i] += first;
        double beta = 1.0 / (norm * fabs(own[i]));
        for (int r = i + 1; r < rows; r++) {
            double *other = A + r * n, dot = 0.0;
            for (int j = i; j < n; j++)
                dot += own[j] * other[j];
            dot *= beta;
            for (int j = i; j < n; j++)
                other[j] -= dot * own[j];
        }
        own[i] = -first;
    }
    for (int i = 0, k = 0; i < rows; i++) {
        /* Row i of the inverse, from the diagonal to the left, is put into column i above it. */
        double corner = 1.0 / A[i * n + i];
        total += corner * corner;
        for (int j = i - 1; j >= 0; j--) {
            double rest = 0.0;
            for (int c = j + 1; c < i; c++)
                rest -= A[c * n + i] * A[c * n + j];
            rest -= corner * A[i * n + j];
            A[j * n + i] = rest / A[j * n + j];
            total += A[j * n + i] * A[j * n + i];
        }
        for (; k < count && ends[k] == i + 1; k++)
            if (!(sqrt(total) * least[k] < 1.0))
                return false;
    }
    return true;
}
