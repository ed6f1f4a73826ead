"""Feedforward by inversion of the linear model for a path that is known in advance."""

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.fdi.fault_model import NominalModel, fault_model
from kernels import lib, pointer

WEIGHT = 1e-2
"""Weight of the squared deviation of the demand from the path, relative to that of the response. At
one frequency, a plant with response P has an error of WEIGHT (P - 1) / (|P|^2 + WEIGHT) of the
path: for |P| near 1 a hundredth of the error P - 1 without inversion. The demand is at most
1 + 1 / (2 sqrt(WEIGHT)) = 6 times the path: fast modes and zeros next to the unit circle do not
ring, and steps of 1 mm do not saturate the wrist of a Panda, as they did with 1e-3 (12 times)."""

_DOUBLINGS, _CONVERGED = 24, 1e-13
"""Largest number of doublings of a horizon of one tick, and the relative change that ends them."""


def inverse_feedforward(nominal: NominalModel, gain: Array, path: Array) -> Array:
    """Return demands (N, m1) whose response follows a path (N, m1) that ends at standstill.

    They minimize the sum of |response - path|^2 + WEIGHT |demand - path|^2, each row in units of
    the noise of its sensor, starting at rest: linear-quadratic tracking with preview (Tomizuka, J.
    Dynamic Systems 97, 1975; Katayama et al., Int. J. Control 41, 1985). The demands are noncausal,
    as plants with delays or zeros outside the unit circle require (Devasia, Chen and Paden, IEEE
    Trans. Automatic Control 41, 1996).

    Args:
        nominal: Plant whose outputs are the m1 rows of the path, in [rad] or [m].
        gain: Displacements per demand, shape (n, m1).
        path: Desired outputs, tick by tick.

    Raises:
        ValueError: The demands exceed 1e120.
    """
    model = fault_model(nominal)
    m1 = len(nominal.noise)
    path = check.array("path", path, None, m1)
    gain = check.array("gain", gain, nominal.actuators, m1)
    if not len(path):
        return path
    with np.errstate(all="ignore"):
        A, C, B = model.A, model.C, model.B @ gain * nominal.noise
        scaled, P = path / nominal.noise, _cost_to_go(A, B, C)
        towards = np.linalg.solve(WEIGHT * np.eye(m1) + B.T @ P @ B, B.T)
        K, ahead = towards @ P @ A, towards @ P @ B
        closed = A - B @ K
        # The cost of a state x is x' P x - 2 g' x; g runs backwards from the standstill.
        sources = scaled @ (C - B.T @ P @ closed)
        g = _recursion(closed.T, _summed(closed.T, sources[-1]), sources[:0:-1])[::-1]
        driven = scaled + g @ towards.T - scaled @ ahead.T
        x = _recursion(closed, np.zeros(len(A)), driven[:-1] @ B.T)
        demands = (driven - x @ K.T) * nominal.noise
    if not check.is_moderate(demands):
        raise ValueError(f"path must have demands below {check.LARGEST:g} by this gain, got more")
    return demands


def _recursion(A: Array, start: Array, sources: Array) -> Array:
    """Return the states (N + 1, s) of x' = A x + source for a start (s,) and sources (N, s)."""
    states = np.empty((len(sources) + 1, len(start)))
    states[0] = start
    parts = map(np.ascontiguousarray, (A, sources))
    lib.recur(len(start), len(sources), *map(pointer, parts), pointer(states))
    return states


def _summed(F: Array, source: Array) -> Array:
    """Return the sum of F^k source over all k >= 0, (s,), by doubling."""
    total = source
    for _ in range(_DOUBLINGS):
        more = F @ total
        total, F = total + more, F @ F
        if np.abs(more).max() <= _CONVERGED * np.abs(total).max():
            break
    return total


def _cost_to_go(A: Array, B: Array, C: Array) -> Array:
    """Return P (s, s) of the Riccati equation: the least cost-to-go of a state x is x' P x.

    The horizon is doubled (Anderson, Int. J. Control 28, 1978), which handles unobservable modes on
    the unit circle, for which the equation has no stabilizing solution.
    """
    G, P, eye = B @ B.T / WEIGHT, C.T @ C, np.eye(len(A))
    for _ in range(_DOUBLINGS):
        # One factorization of I + G P serves both products.
        AW, GW = np.split(np.linalg.solve(eye + G @ P, np.hstack([A, G])), 2, axis=1)
        more = A.T @ P @ AW
        A, G, P = A @ AW, G + A @ GW @ A.T, P + (more + more.T) / 2
        if np.abs(more).max() <= _CONVERGED * np.abs(P).max():
            break
    return P
