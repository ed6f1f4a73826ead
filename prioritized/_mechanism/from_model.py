"""Arguments of a constrained system, taken from a mechanism that was read from a model."""

from collections.abc import Sequence
from typing import Any, Protocol

from numpy.typing import ArrayLike

import argument_checks as check
from prioritized._mechanism.geometry import Accuracy
from prioritized._solver.rank import RANK_TOLERANCE

GEOMETRY_MARGIN = 10.0
"""Ratio of rank tolerance to accuracy: singular values err by a few times the geometry's error."""


class Mechanism(Protocol):
    """Jacobians of a mechanism, optionally with names, stiffness and accuracy.

    The accuracy is `accuracy`, entry by entry, or `geometry_accuracy`, one number.
    """

    @property
    def J_T(self) -> ArrayLike: ...
    @property
    def J_C(self) -> ArrayLike | None: ...
    @property
    def active(self) -> Sequence[int] | ArrayLike: ...


def arguments_of(
    mechanism: Mechanism, springs: bool, geometry_accuracy: float | None
) -> dict[str, Any]:
    """Return the arguments of :class:`prioritized.ConstrainedSystem` for a mechanism."""
    check.attributes("mechanism", mechanism, "J_T", "J_C", "active")
    check.flag("springs", springs)
    matrices = {"J_T": mechanism.J_T, "J_C": mechanism.J_C, "active": mechanism.active}
    stiffness = getattr(mechanism, "stiffness", None) if springs else None
    if springs and stiffness is None:
        raise ValueError(
            "springs must be False for a mechanism without stiffness: its springs are absent or "
            "not linear"
        )
    accuracy = accuracy_of(mechanism)
    if geometry_accuracy is None and accuracy is None:
        geometry_accuracy = getattr(mechanism, "geometry_accuracy", None)
    return matrices | {
        "stiffness": stiffness,
        "names": getattr(mechanism, "names", None),
        "geometry_accuracy": geometry_accuracy,
        "accuracy": accuracy,
    }


def accuracy_of(mechanism: Any) -> Accuracy | None:
    """Return the accuracy of the entries of a mechanism, or None if it has none."""
    return getattr(mechanism, "accuracy", None)


def error_bound_of(mechanism: Any) -> float:
    """Return the bound of the errors of all entries in natural units; zero if they are exact."""
    bound = getattr(mechanism, "error_bound", None)
    if bound is None:
        accuracy = accuracy_of(mechanism)
        return 0.0 if accuracy is None else accuracy.error_bound
    return bound


def tolerance_of(rank_tolerance: float | None, geometry_accuracy: float | None) -> float:
    """Return the rank tolerance, or that of the geometry's accuracy; refuse contradictory ones."""
    if rank_tolerance is not None:
        check.number("rank_tolerance", rank_tolerance, 0.0, 0.5)
    if geometry_accuracy is None:
        return RANK_TOLERANCE if rank_tolerance is None else rank_tolerance
    most = 0.5 / GEOMETRY_MARGIN
    implied = GEOMETRY_MARGIN * check.number("geometry_accuracy", geometry_accuracy, 0.0, most)
    tolerance = max(RANK_TOLERANCE, implied)  # round-off remains however accurate the geometry
    if rank_tolerance not in (None, tolerance):  # dataclasses.replace gives both, in agreement
        raise ValueError(
            "geometry_accuracy must not be given with another rank_tolerance, "
            f"got {geometry_accuracy} and {rank_tolerance}"
        )
    return tolerance
