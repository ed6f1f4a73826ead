"""The search for a dither: random directions, the best improved by quadratic programming."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.optimize

from argument_checks import Array, Mask
from argument_checks.ties import ascending, exceeds, greatest
from ftc.fdi.design.signatures import Complex, FaultResponses
from ftc.fdi.fault_model import KINDS
from ftc.fdi.separation import ACCURACY, ALIKE, Separations, separations_at

_STARTS, _REFINED, _ITERATIONS = 16, 4, 30
"""Random directions per dimension, how many of the best are improved, and steps of each."""
_FAR = 1e3  # in sizes of the start, so that nothing overflows


@dataclass(frozen=True)
class DitherSearch:
    """For directions `basis` x, at each of F frequencies.

    Attributes:
        basis: Orthonormal, shape (n, r).
        limits: Rows per command none of which may exceed one, shape (F, l, n).
        noise: Covariance of each part of the whitened phasors, shape (F, p, p).
        responses: To the failures.
    """

    basis: Array
    limits: Complex
    noise: Array
    responses: FaultResponses

    def separations(self, k: int, commanded: Array) -> Separations:
        """At the k-th frequency, driven by commands (n,)."""
        return separations_at(self.responses, k, commanded, self.noise[k])

    def best(self, rng: np.random.Generator) -> tuple[int, Array, Mask]:
        """Number of the frequency, commands (n,), and which pairs are separable, shape (n, n).

        These as of :class:`ftc.fdi.DitherDesign`.
        """
        n, r = self.basis.shape
        if not r:
            return 0, np.zeros(n), np.ones((n, n), dtype=bool)
        starts = rng.normal(size=(_STARTS * r, r))
        tried = [(k, self._largest(k, x)) for k in range(len(self.limits)) for x in starts]
        found = [self.separations(k, self.basis @ x).between_actuators for k, x in tried]
        separable = np.max(found, axis=0) >= ALIKE
        if not separable.any():
            separable[:] = True
        least = np.array([each[separable].min() for each in found])
        chosen = [tried[i] for i in ascending(-least, accuracy=ACCURACY)[:_REFINED]]
        refined = [self._improved(k, x, separable) for k, x in chosen]
        _, k, x = refined[greatest([reached for reached, *_ in refined], ACCURACY)]
        u = self.basis @ x
        return k, u * np.sign(u[greatest(np.abs(u), ACCURACY)]), separable

    def _largest(self, k: int, x: Array) -> Array:
        """As far along x as the limits allow."""
        return x / np.abs(self.limits[k] @ (self.basis @ x)).max()

    def _improved(self, k: int, x: Array, separable: Mask) -> tuple[float, int, Array]:
        """Least separation, and where: max t with all separations t or more, within the limits."""

        def least(x: Array) -> float:
            between = self.separations(k, self.basis @ x).between_actuators
            return float(between[separable].min())

        before, size = least(x), float(np.linalg.norm(x))
        if not before:  # by symmetry: nothing tells where to go
            return before, k, x
        start = np.append(x / size, 1.0)
        end = scipy.optimize.minimize(
            lambda xt: -xt[-1],
            start,
            jac=lambda xt: -np.eye(len(xt))[-1],
            bounds=[(-_FAR, _FAR)] * len(start),
            constraints={"type": "ineq", "fun": self._room(k, size, before, separable)},
            method="SLSQP",
            options={"maxiter": _ITERATIONS},
        ).x[:-1]
        if not (np.isfinite(end).all() and end.any()):
            return before, k, x
        after = self._largest(k, end)
        reached = least(after)
        return (reached, k, after) if exceeds(reached, before, ACCURACY) else (before, k, x)

    def _room(
        self, k: int, size: float, before: float, separable: Mask
    ) -> Callable[[Array], Array]:
        """What is not to become negative, of [x / size; t], with t in units of `before`.

        All distances, not the least of each pair, which would have kinks.
        """
        number = np.repeat(np.arange(len(separable)), len(KINDS))
        others = separable[number[:, None], number] & (number[:, None] != number)
        detected = separable.diagonal()[number]

        @lru_cache(maxsize=2)  # differences along t, and of the point before, are of the same x
        def apart_and_within(x: bytes) -> tuple[Array, Array]:
            u = size * self.basis @ np.nan_to_num(np.frombuffer(x))  # a step that failed is NaN
            found = self.separations(k, u)
            apart = np.concatenate([found.distance[others], found.from_none[detected]])
            return apart / before, 1 - np.abs(self.limits[k] @ u) ** 2

        def room(xt: Array) -> Array:
            apart, within = apart_and_within(xt[:-1].tobytes())
            return np.concatenate([apart - xt[-1], within])

        return room
