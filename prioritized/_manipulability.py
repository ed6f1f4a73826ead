"""Velocity and force manipulability: the four conditions of section 2.2 and what they mean."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from argument_checks import Array
from prioritized._arrays import ReadOnly
from prioritized._rank import RankedSvd, frobenius, ranked_svd

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics


@dataclass(frozen=True, eq=False)
class Finding(ReadOnly):
    """Whether a condition holds, and what shows it.

    Attributes:
        holds: The verdict.
        basis: Orthonormal basis of the directions concerned, empty when it does not hold.
        gap: Factor the rank threshold could move before a decision behind the verdict changed.
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
        worst_gain: Least major speed per unit norm of the admissible active rates over all major
            directions: the smallest singular value of J_m on them; zero when unmanipulable,
            infinite for a task without rows.
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
        """The task moves with every active joint held: self-motion; basis (m, .)."""
        return self.findings["unstable"].holds

    @property
    def unstable_major(self) -> bool:
        """Self-motion moves the major task; basis of what it does there, (m1, .)."""
        return self.findings["unstable_major"].holds

    @property
    def unstable_secondary(self) -> bool:
        """Some self-motion leaves the major task untouched; basis (m, .)."""
        return self.findings["unstable_secondary"].holds

    @property
    def idle(self) -> bool:
        """Some self-motion no task row sees; basis in the passive velocities."""
        return self.findings["idle"].holds

    @property
    def irresolvable(self) -> bool:
        """Internal forces exist that rigid statics cannot resolve; basis as rows (., c)."""
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


def classify(kinematics: "Kinematics", S_m: Array) -> Manipulability:
    """Decide each condition for the major task S_m v."""
    kin, tolerance = kinematics, kinematics.rank_tolerance
    m1, size = len(S_m), float(frobenius(S_m))
    Z = _null(ranked_svd(kin.active_constraint, 1.0, tolerance, full=True))

    reach = ranked_svd(S_m @ kin.J @ Z, size * kin.scale, tolerance, full=True)
    reach_task = ranked_svd(kin.J @ Z, kin.scale, tolerance, full=True)
    drift = ranked_svd(kin.task_drift, 1.0, tolerance, full=True)
    drift_major = ranked_svd(S_m @ kin.task_drift, size, tolerance, full=True)
    # Of the self-motion that leaves the major task alone, what still moves the task.
    aside = ranked_svd(kin.task_drift @ _null(drift_major), 1.0, tolerance, full=True)
    # Each verdict is as safe as the least of the decisions it rests on: what is adrift is first of
    # all what neither loops nor springs hold.
    loose = min(kin.loop_gap, kin.spring_gap)
    moved = {
        "unmanipulable": (_left_null(reach), min(reach.gap, kin.gap)),
        "unmanipulable_task": (_left_null(reach_task), min(reach_task.gap, kin.gap)),
        "unstable": (kin.self_motion, min(drift.gap, loose)),
        "unstable_major": (_range(drift_major), min(drift_major.gap, loose)),
        "unstable_secondary": (_range(aside), min(aside.gap, drift_major.gap, loose)),
        "idle": (kin.passive_drift @ _null(drift), min(drift.gap, loose)),
    }
    opposed = {
        "irresolvable": (kin.internal_force, kin.loop_gap),
        "constrained_active": (kin.active_constraint, min(kin.constraint_gap, kin.loop_gap)),
    }
    findings = {name: _finding(name, A, A.shape[1], gap) for name, (A, gap) in moved.items()}
    findings |= {name: _finding(name, A, A.shape[0], gap) for name, (A, gap) in opposed.items()}
    reachable = reach.rank == m1
    worst = reach.sigma[:m1].min(initial=np.inf) if reachable else 0.0
    return Manipulability(findings, float(worst))


_SENTENCES = {
    "unmanipulable": (
        "The actuators cannot move the major task in {}.",
        "The actuators reach every major velocity.",
    ),
    "unmanipulable_task": (
        "They cannot move the task as a whole in {}.",
        "They reach every velocity of the task as a whole.",
    ),
    "unstable": (
        "With every actuator held the task still moves in {}: self-motion.",
        "With every actuator held the task stands still.",
    ),
    "unstable_major": (
        "Self-motion moves the major task in {}: no mapping can hold it.",
        "No self-motion moves the major task.",
    ),
    "unstable_secondary": (
        "Self-motion in {} leaves the major task untouched.",
        "No self-motion moves the secondary task alone.",
    ),
    "idle": (
        "Passive joints move in {} that the task does not see.",
        "No passive joint moves unseen by the task.",
    ),
    "irresolvable": (
        "Rigid statics leaves the internal force open in {}.",
        "Statics determines every constraint force.",
    ),
    "constrained_active": (
        "The loops forbid active rates in {}; torques there only squeeze the mechanism.",
        "The loops leave the active rates free.",
    ),
}
"""What a finding says when it holds, with the number of directions, and when it does not."""


def _finding(name: str, basis: Array, count: int, gap: Array | float) -> Finding:
    some, none = _SENTENCES[name]
    number = "one direction" if count == 1 else f"{count} directions"
    return Finding(count > 0, basis, float(gap), some.format(number) if count else none)


def _left_null(A: RankedSvd) -> Array:
    return A.U[:, int(A.rank) :]


def _range(A: RankedSvd) -> Array:
    return A.U[:, : int(A.rank)]


def _null(A: RankedSvd) -> Array:
    return A.Vt[int(A.rank) :].T
