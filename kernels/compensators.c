#include "kernels.h"

void compensate(const double *M, int rows, int order, int inputs, const double *states,
                const double *errors, double *after)
{
    for (int i = 0; i < rows; i++) {
        const double *row = M + i * (order + inputs);
        double total = 0.0;
        for (int j = 0; j < order; j++)
            total += row[j] * states[j];
        for (int j = 0; j < inputs; j++)
            total += row[order + j] * errors[j];
        after[i] = total;
    }
}

void recur(int n, int64_t steps, const double *A, const double *sources, double *states)
{
    for (; steps > 0; steps--, sources += n, states += n)
        for (int i = 0; i < n; i++) {
            double total = sources[i];
            for (int j = 0; j < n; j++)
                total += A[i * n + j] * states[j];
            states[n + i] = total;
        }
}
