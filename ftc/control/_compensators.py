"""What a controller computes at every tick, compiled: its compensators."""

from numba import types

from argument_checks.compilation import kernel

_vector = types.Array(types.float64, 1, "A", readonly=True)
_matrix = types.Array(types.float64, 2, "A", readonly=True)
_new = types.Array(types.float64, 1, "C")


@kernel(types.void(_matrix, _vector, _vector, _new))
def compensate(M, states, errors, after):
    """Write [next states; demands] = M [states; errors] to the last argument."""
    order = len(states)
    for i in range(len(M)):
        total = 0.0
        for j in range(order):
            total += M[i, j] * states[j]
        for j in range(len(errors)):
            total += M[i, order + j] * errors[j]
        after[i] = total
