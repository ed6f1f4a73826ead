"""Velocity and force manipulability: the four conditions of section 2.2."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from argument_checks import Array, Indices
from argument_checks.ties import ACCURACY
from prioritized._analysis.findings import Finding, found
from prioritized._mapping.amplification import closure_sentences, doubt_sentences, gain_sentences
from prioritized._mechanism.decisions import MajorTask, respanned
from prioritized._mechanism.names import Known, involved
from prioritized._mechanism.task_motion import TaskMotion
from prioritized._solver.canonical import canonical
from prioritized._solver.rank import RankedSvd


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
        gain_uncertainty: Relative error that the accuracy of the geometry allows the worst gain; 0
            when unmanipulable.
    """

    findings: Mapping[str, Finding]
    worst_gain: float
    largest_gain: float
    gain_uncertainty: float
    _closure_condition: Callable[[], float]

    @property
    def closure_condition(self) -> float:
        """Condition number of the closure J_Cp on its rank, 1 without loops.

        Errors of the geometry are multiplied by up to as much. In natural units.
        """
        return self._closure_condition()

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
        if self.worst_gain:
            sentences += doubt_sentences(1.0 / self.worst_gain, self.gain_uncertainty)
        return "\n".join(sentences + closure_sentences(self.closure_condition))


def classify(
    task: MajorTask,
    constraints: tuple[Array, Array],
    passive: Indices,
    known: tuple[Callable[[], Known], Callable[[], Known]],
    closure_condition: Callable[[], float],
) -> Manipulability:
    """The conditions for a major task, from the decisions on it under one failure condition.

    Args:
        task: The decisions.
        constraints: Rows of internal_force and of active_constraint.
        passive: Velocity indices of the passive joints.
        known: Names of the passive and of the active joints.
        closure_condition: Of J_Cp.
    """
    whole, reach, moved = task.task, task.reach, task.task.moved
    geometry, major, units = whole.geometry, task.major_units, whole.task_units
    internal_force, active_constraint = constraints
    idle = whole.self_motion[passive] @ moved.null
    columns = {
        "unmanipulable": (respanned(_left_null(reach), 1.0 / major), (reach,)),
        "unmanipulable_task": (respanned(_left_null(whole.reach), 1.0 / units), (whole.reach,)),
        "unstable": (respanned(_range(moved), units), (moved,)),
        "unstable_major": (respanned(_range(task.moved), major), (task.moved,)),
        "unstable_secondary": (respanned(_range(task.aside), units), (task.aside, task.moved)),
        "idle": (_orthonormal(geometry.velocity_units[passive, None] * idle), (moved,)),
    }
    bases = {name: canonical(A) for name, (A, _) in columns.items()}
    bases |= {"irresolvable": internal_force.T, "constrained_active": active_constraint.T}
    accuracy = max(ACCURACY, geometry.rank_tolerance, geometry.error_bound)
    of_joints = dict(zip(("idle", "constrained_active"), known, strict=True))
    findings = {}
    for name, basis in bases.items():
        joints = ""
        if name in of_joints and basis.size:
            joints = involved(basis, of_joints[name](), accuracy)
        decisions = columns[name][1] if name in columns else ()
        shown = basis if name in columns else basis.T
        findings[name] = found(name, shown, basis.shape[1], partial(_gap, whole, decisions), joints)
    is_reached = reach.rank == len(task.S_m)
    worst = reach.sigma.min(initial=np.inf, where=reach.kept) if is_reached else 0.0
    return Manipulability(
        findings,
        float(worst) * task.measure.gain_unit,
        float(reach.sigma.max(initial=0.0)) * task.measure.gain_unit,
        task.gain_uncertainty,
        closure_condition,
    )


def _gap(task: TaskMotion, decisions: tuple[RankedSvd, ...]) -> float:
    """The gap of a verdict is the smallest of all decisions behind it."""
    return float(min([task.gap, *(one.gap for one in decisions)]))


def _orthonormal(columns: Array) -> Array:
    return np.linalg.qr(columns)[0] if columns.size else columns


def _left_null(A: RankedSvd) -> Array:
    return A.U[:, int(A.rank) :]


def _range(A: RankedSvd) -> Array:
    return A.U[:, : int(A.rank)]
