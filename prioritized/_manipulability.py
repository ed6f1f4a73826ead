"""Velocity and force manipulability: the four conditions of section 2.2."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from argument_checks import Array, Indices
from argument_checks.ties import ACCURACY
from prioritized._amplification import closure_sentences, doubt_sentences, gain_sentences
from prioritized._canonical import canonical
from prioritized._decisions import MajorTask, respanned
from prioritized._findings import Finding, found
from prioritized._names import Known, involved
from prioritized._rank import RankedSvd


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
            of the geometry are multiplied by up to as much. In natural units.
        gain_uncertainty: Relative error that the accuracy of the geometry allows the worst gain; 0
            when unmanipulable.
    """

    findings: Mapping[str, Finding]
    worst_gain: float
    largest_gain: float
    closure_condition: float
    gain_uncertainty: float

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
        sentences += doubt_sentences(self.worst_gain, self.gain_uncertainty)
        return "\n".join(sentences + closure_sentences(self.closure_condition))


def classify(
    task: MajorTask,
    constraints: tuple[Array, Array],
    passive: Indices,
    closure_condition: float,
    known: tuple[Known, Known],
) -> Manipulability:
    """The conditions for a major task, from the decisions on it under one failure condition.

    Args:
        task: The decisions.
        constraints: Rows of internal_force and of active_constraint.
        passive: Velocity indices of the passive joints.
        closure_condition: Of J_Cp.
        known: Names of the passive and of the active joints.
    """
    whole, (internal_force, active_constraint) = task.task, constraints
    motions, reach, moved = whole.motions, task.reach, whole.moved
    geometry, major, gap = motions.geometry, task.major_units, float(motions.gap)
    velocities, units = geometry.velocity_units[passive], geometry.task_units
    idle = geometry.motions[passive] @ (motions.self_motion @ moved.null)
    joints = _orthonormal(velocities[:, None] * idle)
    # The gap of a verdict is the smallest of all decisions behind it.
    columns = {
        "unmanipulable": (respanned(_left_null(reach), 1.0 / major), reach.gap),
        "unmanipulable_task": (respanned(_left_null(whole.reach), 1.0 / units), whole.reach.gap),
        "unstable": (respanned(_range(moved), units), moved.gap),
        "unstable_major": (respanned(_range(task.moved), major), task.moved.gap),
        "unstable_secondary": (
            respanned(_range(task.aside), units),
            min(task.aside.gap, task.moved.gap),
        ),
        "idle": (joints, moved.gap),
    }
    columns = {name: (canonical(A), min(own, gap)) for name, (A, own) in columns.items()}
    rows = {"irresolvable": internal_force, "constrained_active": active_constraint}
    accuracy = max(ACCURACY, geometry.rank_tolerance, geometry.error_bound)
    of_joints = {
        "idle": involved(columns["idle"][0], known[0], accuracy),
        "constrained_active": involved(active_constraint.T, known[1], accuracy),
    }
    findings = {
        name: found(name, A, count, least, of_joints.get(name, ""))
        for name, A, count, least in [
            *((name, A, A.shape[1], least) for name, (A, least) in columns.items()),
            *((name, A, A.shape[0], gap) for name, A in rows.items()),
        ]
    }
    is_reached = reach.rank == len(task.S_m)
    worst = reach.sigma.min(initial=np.inf, where=reach.kept) if is_reached else 0.0
    return Manipulability(
        findings,
        float(worst) * task.gain_unit,
        float(reach.sigma.max(initial=0.0)) * task.gain_unit,
        closure_condition,
        reach.uncertainty,
    )


def _orthonormal(columns: Array) -> Array:
    return np.linalg.qr(columns)[0] if columns.size else columns


def _left_null(A: RankedSvd) -> Array:
    return A.U[:, int(A.rank) :]


def _range(A: RankedSvd) -> Array:
    return A.U[:, : int(A.rank)]
