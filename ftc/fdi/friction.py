"""Dry friction beside a linear plant: what it does from one physics step to the next.

Coulomb's law as a convex problem in every step, with the softness of the simulator or of the
contact itself: E. Todorov, "Convex and analytically-invertible dynamics with contacts and
constraints", ICRA 2014; in the rigid limit the linear complementarity problem of D. Stewart and
J. Trinkle, Int. J. Numerical Methods in Engineering 39, 1996.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

import argument_checks as check
from argument_checks import Array, Mask
from kernels import ffi, lib, pointer


class DryFriction(NamedTuple):
    """Friction at r places of a plant with k positions q; softened as contacts are.

    Attributes:
        push: Accelerations of q per force, shape (k, r).
        rows: Velocity of each place per velocity of q, shape (r, k).
        limit: Largest force of each, positive, shape (r,).
        softness: Acceleration per force, shape (r,).
        rate: With which a place that sticks comes to rest, shape (r,), [1/s].
    """

    push: Array
    rows: Array
    limit: Array
    softness: Array
    rate: Array

    def checked(self, positions: int) -> "DryFriction":
        """The same with read-only copies, of a plant with so many positions.

        Raises:
            ValueError: Of another shape, or not positive.
        """
        r = check.real("friction.limit", self.limit).size
        shapes = (positions, r), (r, positions), (r,), (r,), (r,)
        found = DryFriction(
            *(
                check.frozen(check.exactly(f"friction.{name}", part, *shape))
                for name, part, shape in zip(self._fields, self, shapes, strict=True)
            )
        )
        for name in ("limit", "softness", "rate"):
            check.not_negative(f"friction.{name}", getattr(found, name))
        return found


class Rubbing(NamedTuple):
    """One physics step, x' = A x + B [u; 1] + G f, f within its limit.

    f minimizes f'K f / 2 + f'c, with c = E x + D [u; 1].

    Attributes:
        A: Shape (s, s).
        B: Shape (s, n + 1).
        G: Shape (s, r).
        E: Shape (r, s).
        D: Shape (r, n + 1).
        K: Shape (r, r).
        limit: Shape (r,).
        C: Outputs in units of their noise, shape (p, s).
        steps_a_tick: Physics steps of a control tick.
    """

    A: Array
    B: Array
    G: Array
    E: Array
    D: Array
    K: Array
    limit: Array
    C: Array
    steps_a_tick: int

    def moved(self, x: Array, commanded: Array) -> Array:
        """States (..., s) a control tick later, with displacements (..., n) commanded."""
        X = np.array(x, dtype=float).reshape(-1, len(self.A))
        U = np.ones((len(X), self.B.shape[1]))
        U[:, :-1] = commanded.reshape(len(X), -1)
        room = np.empty(2 * len(self.A) + 3 * len(self.K))
        lib.slide(_given(self, self), len(X), pointer(U), pointer(room), pointer(X))
        return X.reshape(x.shape)


def _given(one: Rubbing, parts: Sequence[Any]) -> Any:
    """What the kernels take: of `one`, or of several like it, whose parts stand together."""
    sizes = len(one.A), len(one.K), one.B.shape[1] - 1, len(one.C), one.steps_a_tick
    return ffi.new("rubbing *", [*sizes, *(pointer(part) for part in parts[:8])])


@dataclass(frozen=True)
class SampledFriction:
    """What dry friction changes of samples that were stepped without it, for H models.

    Attributes:
        rubbing: Of each model.
        lifted: Their states after a sample without friction per state before, (H, s, s).
        ticks: Of a sample.
        first: Row of the first of the deviations that limits cause, `spread` smaller each.
        spread: Standard deviation of the limits, relative; zero: there are no such rows.
    """

    rubbing: tuple[Rubbing, ...]
    lifted: Array
    ticks: int
    first: int
    spread: float

    @cached_property
    def _parts(self) -> list[Array]:
        every = zip(*self.rubbing, strict=True)
        return [np.ascontiguousarray(np.array(part)) for part in every][:-1]

    @property
    def limits(self) -> int:
        """How many rows there are of limits."""
        return len(self.rubbing[0].limit) if self.spread > 0 else 0

    def apply(self, steps: Mask, before: Array, X: Array, outputs: Array, v: Array) -> None:
        """Correct states and outputs in place.

        Args:
            steps: Which of the models and K onsets, shape (H, K).
            before: States before the sample, shape (H, K, rows, s): of the model, then deviations.
            X: After it.
            outputs: Shape (H, K, rows, p).
            v: Inputs of the sample.
        """
        every = _given(self.rubbing[0], self._parts)
        room = np.empty(lib.sliding_room(every, self.ticks))
        held = np.empty(len(self.rubbing[0].limit), dtype=bool)
        given = pointer(steps), pointer(before), pointer(v), pointer(self.lifted), self.ticks
        changing = pointer(held), pointer(room), pointer(X), pointer(outputs)
        lib.slide_samples(every, *X.shape[:3], *given, self.first, self.spread, *changing)


def together(parts: Sequence[SampledFriction]) -> SampledFriction:
    """Of all models of a bank."""
    first = parts[0]
    return SampledFriction(
        tuple(each for part in parts for each in part.rubbing),
        np.concatenate([part.lifted for part in parts]),
        first.ticks,
        first.first,
        first.spread,
    )
