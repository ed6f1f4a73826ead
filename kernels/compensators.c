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
