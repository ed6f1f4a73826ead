"""Dry friction beside a linear plant: what it does from one physics step to the next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from argument_checks import Array, Mask
from kernels import ffi, lib, pointer


class Rubbing(NamedTuple):
    """One physics step with dry friction: x' = A x + B [u; 1] + G f, each force within its limit.

    f (r,) minimizes f'K f / 2 + f'(E x + D [u; 1]), of states x (s,) and commands u (n,). Outputs
    in units of their noise are C x (p,); a control tick has `steps_a_tick` such steps. Of H models
    side by side each array has a further first axis.

    Coulomb's law as a convex problem, with the softness of the simulator or of the contact itself:
    E. Todorov, "Convex and analytically-invertible dynamics with contacts and constraints", ICRA
    2014; in the rigid limit the linear complementarity problem of D. Stewart and J. Trinkle, Int.
    J. Numerical Methods in Engineering 39, 1996.
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

    def given(self) -> Any:
        """Struct of the kernels."""
        sizes = self.A.shape[-1], self.K.shape[-1], self.B.shape[-1] - 1, self.C.shape[-2]
        parts = (pointer(part) for part in self[:8])
        return ffi.new("rubbing *", [*sizes, self.steps_a_tick, *parts])

    def moved(self, x: Array, commanded: Array) -> Array:
        """States (..., s) a control tick later, with displacements (..., n) commanded."""
        X = np.array(x, dtype=float).reshape(-1, len(self.A))
        U = np.ones((len(X), self.B.shape[1]))
        U[:, :-1] = commanded.reshape(len(X), -1)
        room = np.empty(2 * len(self.A) + 3 * len(self.K))
        lib.slide(self.given(), len(X), pointer(U), pointer(room), pointer(X))
        return X.reshape(x.shape)


@dataclass(frozen=True)
class SampledFriction:
    """What dry friction changes of samples that were stepped without it, for one model or H.

    Attributes:
        lifted: States after a sample without friction per state before, (s, s) or (H, s, s).
        ticks: Of a sample.
        first: Row of the first of the deviations that limits cause, `spread` smaller each.
        spread: Standard deviation of the limits, relative; zero: there are no such rows.
    """

    rubbing: Rubbing
    lifted: Array
    ticks: int
    first: int
    spread: float

    @property
    def limits(self) -> int:
        """Number of rows of limits."""
        return self.rubbing.limit.shape[-1] if self.spread > 0 else 0

    def apply(self, steps: Mask, before: Array, X: Array, outputs: Array, v: Array) -> None:
        """Correct states X (H, K, rows, s) after a sample, and outputs (H, K, rows, p), in place.

        Of the models and onsets that `steps` (H, K); rows are the model, then its deviations.
        """
        every = self.rubbing.given()
        room = np.empty(lib.sliding_room(every, self.ticks))
        held = np.empty(self.rubbing.limit.shape[-1], dtype=bool)
        given = pointer(steps), pointer(before), pointer(v), pointer(self.lifted), self.ticks
        changing = pointer(held), pointer(room), pointer(X), pointer(outputs)
        lib.slide_samples(every, *X.shape[:3], *given, self.first, self.spread, *changing)


def together(models: Sequence[SampledFriction]) -> SampledFriction:
    """Friction of models of one size, side by side."""
    every = [each.rubbing for each in models]
    names = (name for name in Rubbing._fields if name != "steps_a_tick")
    arrays = {name: np.array([getattr(each, name) for each in every]) for name in names}
    lifted = np.array([each.lifted for each in models])
    return replace(models[0], rubbing=every[0]._replace(**arrays), lifted=lifted)
