"""The dither that separates failures best for what it may cost.

Active fault diagnosis by an auxiliary input (Campbell and Nikoukhah, Auxiliary Signal Design for
Failure Detection, 2004), here a sinusoid in the null space of the major task: the least separation
of two actuators is maximized over direction and frequency. It grows with the amplitude, which is
therefore the largest allowed.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Mask
from ftc.fdi.design.dither_search import DitherSearch
from ftc.fdi.design.signatures import (
    Complex,
    checked_frequencies,
    fault_responses,
    sound_response,
)
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import NominalModel
from ftc.fdi.separation import Conditions, Separations
from prioritized import canonical_basis

_DEPENDENT, _ROUND_OFF = 1e-10, 1e-10


@dataclass(frozen=True)
class Cost:
    """What a dither may cost while nothing has failed.

    Attributes:
        largest_displacement: Of any actuator, commanded and made; for an actuator that works
            against a spring the command is also its force.
        task: What is to stand still, rows per state of the plant, shape (m, s).
        largest_task_motion: Of each row, a number or shape (m,). A direction in the null space
            moves the task by dynamics alone.

    Raises:
        ValueError: Not a matrix, or not positive numbers.
    """

    largest_displacement: float
    task: Array
    largest_task_motion: ArrayLike

    def __post_init__(self) -> None:
        check.positive("largest_displacement", self.largest_displacement)
        task = check.frozen(check.matrix("task", self.task))
        most = check.real("largest_task_motion", self.largest_task_motion)
        if most.shape not in ((), (len(task),)) or (most <= 1e-120).any():
            raise ValueError(
                f"largest_task_motion must be one positive number or {len(task)}, got "
                f"{check.shown(self.largest_task_motion)}"
            )
        object.__setattr__(self, "task", task)
        object.__setattr__(self, "largest_task_motion", check.frozen(most))

    def limits(self, nominal: NominalModel, frequency_hz: Array) -> Complex:
        """Rows per command that may reach one, complex, shape (F, 2 n + m, n)."""
        n, s = nominal.displacement.shape
        rows = np.vstack([nominal.displacement, check.matrix("task", self.task, columns=s)])
        moved = sound_response(nominal, rows, frequency_hz)
        commanded = np.broadcast_to(np.eye(n), (len(frequency_hz), n, n))
        task = np.broadcast_to(self.largest_task_motion, len(self.task))
        most = np.concatenate([np.full(2 * n, self.largest_displacement), task])
        return np.concatenate([commanded, moved], axis=1) / most[:, None]


@dataclass(frozen=True)
class DitherDesign:
    """A dither, and what it separates.

    Attributes:
        dither: Of amplitude zero where the task leaves no freedom.
        separations: With it.
        separable: Pairs of actuators that some direction and frequency of the search separated, and
            on the diagonal actuators that one separated from no failure, shape (n, n); the least of
            these was maximized. All, where none was.
        task_motion: Amplitude of each row of the task while nothing has failed, shape (m,).
        displacement: Amplitude of each actuator's motion, shape (n,).
    """

    dither: Dither
    separations: Separations
    separable: Mask
    task_motion: Array
    displacement: Array

    def __post_init__(self) -> None:
        for each in (self.separable, self.task_motion, self.displacement):
            each.setflags(write=False)

    @property
    def least(self) -> float:
        """Least separation among the separable."""
        return float(self.separations.between_actuators[self.separable].min())


def designed_dither(
    nominal: NominalModel,
    freedom: ArrayLike,
    frequencies_hz: ArrayLike,
    conditions: Conditions,
    cost: Cost,
    *,
    seed: int = 0,
) -> DitherDesign:
    """The dither of the largest least separation between actuators.

    The problem is not convex. Random directions at each frequency are compared, and the best of
    all improved by sequential quadratic programming: a good dither, without a proof that there is
    no better.

    Args:
        nominal: The plant without failures, and what is measured of it.
        freedom: Directions that the major task leaves, and closed loops allow, the columns of a
            matrix (n, r); they may depend on each other, as those of a mapping's gain `joint` do.
        frequencies_hz: To choose from, above zero and below half the control frequency, shape (F,).
        conditions: Measuring time, uncertainty, disturbance.
        cost: Largest displacement and task motion.
        seed: Of the random directions.

    Raises:
        ValueError, TypeError: An argument of the wrong shape or size, or an undamped mode at a
            frequency.
    """
    check.instance("nominal", nominal, NominalModel)
    hz = checked_frequencies(nominal, "frequencies_hz", frequencies_hz)
    noise = check.instance("conditions", conditions, Conditions).noise(
        nominal, "frequencies_hz", hz
    )
    limits = check.instance("cost", cost, Cost).limits(nominal, hz)
    basis = _basis(freedom, nominal.actuators)
    rng = np.random.default_rng(check.index("seed", seed))
    responses = fault_responses(nominal, hz, conditions.uncertainty)
    search = DitherSearch(basis, limits, noise, responses)
    k, u, separable = search.best(rng)
    amplitude, n = float(np.abs(u).max()), nominal.actuators
    direction = u / amplitude if amplitude else u
    moved = _size_of_sum(limits[k] * u)
    return DitherDesign(
        Dither(amplitude, float(hz[k]), tuple(direction.tolist())),
        search.separations(k, u),
        separable,
        moved[2 * n :] * np.asarray(cost.largest_task_motion),
        moved[n : 2 * n] * cost.largest_displacement,
    )


def _size_of_sum(terms: Complex) -> Array:
    """Of each row (r, n) of terms; zero where they cancel to round-off."""
    whole, parts = terms.sum(axis=1), np.abs(terms).sum(axis=1)
    size = np.hypot(whole.real, whole.imag)
    return np.where(size > _ROUND_OFF * parts, size, 0.0)


def _basis(freedom: ArrayLike, n: int) -> Array:
    """Orthonormal basis (n, r) of the span of columns, of which there may be none.

    Of the span alone: random directions in it are then the same, however it is given.
    """
    N = check.real("freedom", freedom)
    if N.ndim != 2 or len(N) != n:
        raise ValueError(f"freedom must be a matrix with {n} rows, got shape {N.shape}")
    if not N.any():
        return np.zeros((n, 0))
    return canonical_basis(scipy.linalg.orth(check.sized("freedom", N), rcond=_DEPENDENT))
