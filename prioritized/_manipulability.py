"""Velocity and force manipulability: the four conditions of section 2.2."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from argument_checks import Array
from argument_checks.ties import ACCURACY
from prioritized._amplification import closure_sentences, gain_sentences
from prioritized._canonical import canonical
from prioritized._findings import Finding, found
from prioritized._names import Known, involved
from prioritized._rank import RankedSvd, frobenius, largest, ranked_svd


@dataclass(frozen=True, eq=False)
class Manipulability:
    """The conditions of section 2.2 for one major task; `str()` says them in words.

    Attributes:
        findings: By name: `unmanipulable`, `unmanipulable_task`, `unstable`, `unstable_major`,
            `unstable_secondary`, `idle`, `irresolvable`, `constrained_active`.
        worst_gain: Smallest singular value of J_m on the admissible active rates: the least major
            speed per unit norm of these rates. Zero when unmanipulable, infinite without rows.
        largest_gain: Its largest singular value, the greatest major speed per unit norm; zero
            without rows.
        closure_condition: Condition number of the closure J_Cp on its rank, 1 without loops: errors
            of the geometry are multiplied by up to as much. It depends on the units of J_C.
    """

    findings: Mapping[str, Finding]
    worst_gain: float
    largest_gain: float
    closure_condition: float

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
        sentences = [finding.sentence for finding in self.findings.values()]
        sentences += gain_sentences(self.largest_gain, self.worst_gain)
        return "\n".join(sentences + closure_sentences(self.closure_condition))


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
    self_motions: tuple[RankedSvd, Array, Array],
    constraints: tuple[Array, Array],
    gaps: Gaps,
    closure_condition: float,
    known: tuple[Known, Known],
    tolerance: float,
) -> Manipulability:
    """The conditions for the major task S_m v, from arrays of :class:`prioritized.Kinematics`.

    Args:
        S_m: Shape (m1, m).
        jacobian: J and its scale.
        self_motions: The decision on the relative task motion, that motion, and the basis of the
            passive joints'.
        constraints: Rows of internal_force and of active_constraint.
        gaps: Those behind these arrays.
        closure_condition: Of J_Cp.
        known: Names of the passive and of the active joints.
        tolerance: Of the rank decisions.
    """
    (J, scale), (internal_force, active_constraint) = jacobian, constraints
    moved, relative_self_motion, passive_self_motion = self_motions
    m1, size = len(S_m), float(frobenius(S_m))
    Z = _null(ranked_svd(active_constraint, 1.0, tolerance, full=True))
    reach = ranked_svd(S_m @ J @ Z, size * scale, tolerance, full=True)
    reach_task = ranked_svd(J @ Z, scale, tolerance, full=True)
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
        "unstable": (_range(moved), min(moved.gap, free_gap)),
        "unstable_major": (_range(moved_major), min(moved_major.gap, free_gap)),
        "unstable_secondary": (_range(aside), min(aside.gap, moved_major.gap, free_gap)),
        "idle": (passive_self_motion @ _null(moved), min(moved.gap, free_gap)),
    }
    columns = {name: (canonical(A), gap) for name, (A, gap) in columns.items()}
    rows = {
        "irresolvable": (internal_force, gaps.loops),
        "constrained_active": (active_constraint, min(gaps.constraint, gaps.loops)),
    }
    idle, _ = columns["idle"]
    accuracy = max(ACCURACY, tolerance)  # of the inputs, if that is worse
    joints = {
        "idle": involved(idle, known[0], accuracy),
        "constrained_active": involved(active_constraint.T, known[1], accuracy),
    }
    findings = {
        name: found(name, A, count, least, joints.get(name, ""))
        for name, A, count, least in [
            *((name, A, A.shape[1], least) for name, (A, least) in columns.items()),
            *((name, A, A.shape[0], least) for name, (A, least) in rows.items()),
        ]
    }
    worst = reach.sigma[:m1].min(initial=np.inf) if reach.rank == m1 else 0.0
    largest_gain = reach.sigma.max(initial=0.0)
    return Manipulability(findings, float(worst), float(largest_gain), closure_condition)


def _left_null(A: RankedSvd) -> Array:
    return A.U[:, int(A.rank) :]


def _range(A: RankedSvd) -> Array:
    return A.U[:, : int(A.rank)]


def _null(A: RankedSvd) -> Array:
    return A.Vt[int(A.rank) :].T
