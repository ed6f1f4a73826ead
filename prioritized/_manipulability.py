"""Velocity and force manipulability: the four conditions of section 2.2."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from argument_checks import Array
from prioritized._arrays import ReadOnly
from prioritized._rank import RankedSvd, frobenius, largest, ranked_svd


@dataclass(frozen=True, eq=False)
class Finding(ReadOnly):
    """Whether a condition holds, and in which directions.

    Attributes:
        holds: The verdict.
        basis: Orthonormal basis of the directions concerned, empty when it does not hold.
        gap: Factor by which the rank threshold could change before the verdict might.
        sentence: The verdict in words.
    """

    holds: bool
    basis: Array
    gap: float
    sentence: str


@dataclass(frozen=True, eq=False)
class Manipulability:
    """The conditions of section 2.2 for one major task; `str()` says them in words.

    Attributes:
        findings: By name: `unmanipulable`, `unmanipulable_task`, `unstable`, `unstable_major`,
            `unstable_secondary`, `idle`, `irresolvable`, `constrained_active`.
        worst_gain: Smallest singular value of J_m on the admissible active rates: the least major
            speed per unit norm of these rates. Zero when unmanipulable, infinite without rows.
    """

    findings: Mapping[str, Finding]
    worst_gain: float

    @property
    def unmanipulable(self) -> bool:
        """Some major velocity is out of reach; basis in major coordinates, (m1, .)."""
        return self.findings["unmanipulable"].holds

    @property
    def unmanipulable_task(self) -> bool:
        """Some task velocity is out of reach, major or not; basis (m, .)."""
        return self.findings["unmanipulable_task"].holds

    @property
    def unstable(self) -> bool:
        """The task can move with every active joint locked: self-motion; basis (m, .)."""
        return self.findings["unstable"].holds

    @property
    def unstable_major(self) -> bool:
        """Self-motion moves the major task; basis of these major velocities, (m1, .)."""
        return self.findings["unstable_major"].holds

    @property
    def unstable_secondary(self) -> bool:
        """Some self-motion moves the task but not the major task; basis (m, .)."""
        return self.findings["unstable_secondary"].holds

    @property
    def idle(self) -> bool:
        """Passive joints can move without active joints and task; basis in passive velocities."""
        return self.findings["idle"].holds

    @property
    def irresolvable(self) -> bool:
        """Rigid statics does not determine the internal force; basis as rows (., c)."""
        return self.findings["irresolvable"].holds

    @property
    def constrained_active(self) -> bool:
        """The loops constrain the active rates, eq. (17); basis as rows (., n)."""
        return self.findings["constrained_active"].holds

    @property
    def bases(self) -> dict[str, Array]:
        """The basis of each finding, empty where it does not hold."""
        return {name: finding.basis for name, finding in self.findings.items()}

    @property
    def gaps(self) -> dict[str, float]:
        """The gap of the rank decision of each finding."""
        return {name: finding.gap for name, finding in self.findings.items()}

    def __str__(self) -> str:
        return "\n".join(finding.sentence for finding in self.findings.values())


class Gaps(NamedTuple):
    """Gaps of the rank decisions of an elimination; infinite where there was nothing to decide.

    Attributes:
        loops: Of J_Cp.
        springs: Of the motion that springs resist or the passive metric weighs.
        constraint: Of the active constraint.
    """

    loops: float
    springs: float
    constraint: float


def classify(
    S_m: Array,
    jacobian: tuple[Array, float],
    self_motions: tuple[Array, Array, Array],
    constraints: tuple[Array, Array],
    gaps: Gaps,
    tolerance: float,
) -> Manipulability:
    """The conditions for the major task S_m v, from arrays of :class:`prioritized.Kinematics`.

    Args:
        S_m: Shape (m1, m).
        jacobian: J and its scale.
        self_motions: Basis of the task's, relative task motion, and basis of the passive joints'.
        constraints: Rows of internal_force and of active_constraint.
        gaps: Those behind these arrays.
        tolerance: Of the rank decisions.
    """
    (J, scale), (internal_force, active_constraint) = jacobian, constraints
    self_motion, relative_self_motion, passive_self_motion = self_motions
    m1, size = len(S_m), float(frobenius(S_m))
    Z = _null(ranked_svd(active_constraint, 1.0, tolerance, full=True))
    reach = ranked_svd(S_m @ J @ Z, size * scale, tolerance, full=True)
    reach_task = ranked_svd(J @ Z, scale, tolerance, full=True)
    moved = ranked_svd(relative_self_motion, 1.0, tolerance, full=True)
    # Against the 2-norm, so that with every row major it is the decision on the whole task.
    moved_major = ranked_svd(S_m @ relative_self_motion, largest(S_m), tolerance, full=True)
    # The self-motion that does not move the major task may move the rest.
    aside = ranked_svd(relative_self_motion @ _null(moved_major), 1.0, tolerance, full=True)
    # The gap of a verdict is the smallest of all decisions behind it: self-motion is what neither
    # loops nor springs prevent.
    gap, free_gap = min(gaps), min(gaps.loops, gaps.springs)
    columns = {
        "unmanipulable": (_left_null(reach), min(reach.gap, gap)),
        "unmanipulable_task": (_left_null(reach_task), min(reach_task.gap, gap)),
        "unstable": (self_motion, min(moved.gap, free_gap)),
        "unstable_major": (_range(moved_major), min(moved_major.gap, free_gap)),
        "unstable_secondary": (_range(aside), min(aside.gap, moved_major.gap, free_gap)),
        "idle": (passive_self_motion @ _null(moved), min(moved.gap, free_gap)),
    }
    rows = {
        "irresolvable": (internal_force, gaps.loops),
        "constrained_active": (active_constraint, min(gaps.constraint, gaps.loops)),
    }
    findings = {name: _finding(name, A, A.shape[1], least) for name, (A, least) in columns.items()}
    findings |= {name: _finding(name, A, A.shape[0], least) for name, (A, least) in rows.items()}
    worst = reach.sigma[:m1].min(initial=np.inf) if reach.rank == m1 else 0.0
    return Manipulability(findings, float(worst))


_SENTENCES = {
    "unmanipulable": (
        "The actuators cannot move the major task in {}.",
        "The actuators reach every major velocity.",
    ),
    "unmanipulable_task": (
        "The actuators cannot move the whole task in {}.",
        "The actuators reach every velocity of the whole task.",
    ),
    "unstable": (
        "With every actuator locked the task can still move in {}: self-motion.",
        "With every actuator locked the task cannot move.",
    ),
    "unstable_major": (
        "Self-motion moves the major task in {}: no mapping can prevent it.",
        "No self-motion moves the major task.",
    ),
    "unstable_secondary": (
        "Self-motion moves the secondary task alone in {}.",
        "No self-motion moves the secondary task alone.",
    ),
    "idle": (
        "Passive joints can move in {} without moving the task.",
        "No passive joint can move without an active joint or the task.",
    ),
    "irresolvable": (
        "Rigid statics does not determine the internal force in {}.",
        "Rigid statics determines every constraint force.",
    ),
    "constrained_active": (
        "The loops forbid active rates in {}; torques there cause internal force only.",
        "The loops do not constrain the active rates.",
    ),
}
"""The sentence when a condition holds, with the number of directions, and when it does not."""


def _finding(name: str, basis: Array, count: int, gap: Array | float) -> Finding:
    holds, fails = _SENTENCES[name]
    number = "one direction" if count == 1 else f"{count} directions"
    return Finding(count > 0, basis, float(gap), holds.format(number) if count else fails)


def _left_null(A: RankedSvd) -> Array:
    return A.U[:, int(A.rank) :]


def _range(A: RankedSvd) -> Array:
    return A.U[:, : int(A.rank)]


def _null(A: RankedSvd) -> Array:
    return A.Vt[int(A.rank) :].T
