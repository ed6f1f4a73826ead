"""A control tick of the hexapod as one compiled call, made of the kernels of all rooms."""

import numpy as np
from numba import types

from argument_checks.compilation import kernel
from ftc.control import _compensators as _control
from prioritized._solver import unlimited as _unlimited
from sim import _tick as _sim
from sim.hexapod.closed_form import REGULAR

DONE, IN_DOUBT = 0, 1
"""Solved; or singular, in doubt, or not finite: the general way must say what that means."""

_SIZE_OF_J_T = np.sqrt(6.0)

_any = {k: types.Array(types.float64, k, "A", readonly=True) for k in (1, 2, 3)}
_new = {k: types.Array(types.float64, k, "C") for k in (1, 2, 3)}
_int, _float = types.int64, types.float64
_places = types.Array(_int, 1, "A", readonly=True)

_solve, _clear = _unlimited.solve, _unlimited.CLEAR
_invert, _follow, _found = _sim.invert, _sim.follow, _sim.FOUND
_solve_square, _move = _sim.solve, _sim.move
_observe, _spot, _convert = _sim.observe, _sim.spot, _sim.convert
_compensate = _control.compensate

_MAPPING = (_places, *[_any[2]] * 4, _float, _float, _int)
_CONVERSION = (*[_float] * 4, types.boolean)


@kernel(_int(_any[2], *_MAPPING, _any[1], _new[1]), calls=(_sim, _unlimited))
def displace(A, survivors, S_m, S_s, W1, W2, clear, exact, room, demand, displacements):
    """Write optimal displacements (n,) for a demand (p,), where l_dot = A x_dot.

    Of the n struts the `survivors` are not locked; the others get zero. The rest is as of `solve`
    in :mod:`prioritized._solver.unlimited`, `room` being the size of its F.
    """
    n, left = len(A), len(survivors)
    inverse, J = np.empty((n, n)), np.empty((n, left))
    if _invert(A, inverse, REGULAR) != _found:
        return IN_DOUBT
    square = 0.0
    for i in range(n):
        for j in range(left):
            J[i, j] = inverse[i, survivors[j]]
            square += J[i, j] * J[i, j]
    scale = _SIZE_OF_J_T + np.sqrt(square)
    still, rates = np.zeros(left), np.empty(left)
    F, zero = np.empty(room), np.zeros(len(S_s))
    if _solve(J, S_m, S_s, W1, W2, scale, clear, exact, demand, still, zero, F, rates) != _clear:
        return IN_DOUBT
    displacements[:] = 0.0
    for j in range(left):
        displacements[survivors[j]] = rates[j]
    return DONE


@kernel(
    _int(
        *(_int, _any[1], types.Array(types.int32, 1, "A"), _int, _any[1]),
        *(_any[2], _any[2], _int, _any[2], _int, _any[2], _any[1]),
        *(_any[1], _places, _places, _any[1], _places, _places, _any[1], _any[1], _any[1]),
        *(_new[3], _new[2], _new[2], _new[1], _new[2], _new[2]),
        *(_float, _float, _float, _any[2], _any[2]),
        *(*_CONVERSION, *_CONVERSION),
        *(_any[2], _any[2], _any[1], types.boolean, *_MAPPING),
        *(_any[2], _any[2], _any[2]),
        *(_new[2], _new[2], _new[3], _new[2], _new[3], _new[2], _new[2], _new[2], _new[2]),
    ),
    calls=(_sim, _control, _unlimited),
)
def tick(
    k, gaps, owners, rows, counts,
    xmat, xpos, frame, base_xmat, base, R_0, p_0,
    qpos, joints, at, lengths, others, outputs, gear, nominal, forces,
    R, t, moved, gap, all_qpos, all_forces,
    focal, half_width, deviation, noise, zeros,
    factor, lower, upper, gain, whole, in_factor, in_lower, in_upper, in_gain, in_whole,
    bottom, top, nominal_length, constant, survivors, S_m, S_s, W1, W2, clear, exact, room,
    M, reference, feedforward,
    measured, states, rotation, translation, A, struts, demands, required, inputs,
):  # fmt: skip
    """Tick k of the loop, from what the sensors see to the inputs of the drives.

    Arguments are those of `observe` in :mod:`sim._tick`; the detector, its noise and zero at all
    ticks; the conversions from inputs to displacements and back; the geometry, and whether its
    Jacobian is the first one at all ticks; those of :func:`displace`; the compensators, reference
    and feedforward at all ticks; and the log of the controller: what is measured in row k, and
    what it knows in row k + 1, from what it knew in row k. A locked strut, which is at zero, is
    commanded zero from the first tick on.
    """
    _observe(
        k, gaps, owners, rows, counts,
        xmat, xpos, frame, base_xmat, base, R_0, p_0,
        qpos, joints, at, lengths, others, outputs, gear, nominal, forces,
        R, t, moved, gap, all_qpos, all_forces,
    )  # fmt: skip
    if not abs(R[k, 2, 2]) > 0.0:
        return IN_DOUBT
    _spot(R[k], focal, half_width, deviation, noise[k], measured[k])
    order, errors = states.shape[1], np.empty(reference.shape[1])
    for i in range(len(errors)):
        measured[k, i] += zeros[k, i]
        errors[i] = reference[k, i] - measured[k, i]

    commanded = np.empty(inputs.shape[1])
    _convert(inputs[k], factor, lower, upper, gain, whole, commanded)
    if constant:
        A[k + 1], struts[k + 1] = A[k], struts[k]
        found = _solve_square(A[k], commanded.reshape(-1, 1))
        twist, to = commanded.reshape(1, -1), slice(k + 1, k + 2)
        _move(rotation[:1], translation[:1], twist, rotation[to], translation[to])
    else:
        found = _follow(
            bottom, top, nominal_length, rotation[k], translation[k], A[k], struts[k], commanded,
            rotation[k + 1], translation[k + 1], A[k + 1], struts[k + 1],
        )  # fmt: skip
    if found != _found:
        return IN_DOUBT

    after = np.empty(order + len(errors))
    _compensate(M, states[k], errors, after)
    states[k + 1] = after[:order]
    for i in range(len(errors)):
        demands[k + 1, i] = feedforward[k, i] + after[order + i]
    found = displace(
        A[k + 1], survivors, S_m, S_s, W1, W2, clear, exact, room, demands[k + 1], required[k + 1]
    )
    if found != DONE:
        return IN_DOUBT
    _convert(required[k + 1], in_factor, in_lower, in_upper, in_gain, in_whole, inputs[k + 1])
    return DONE
