"""Velocity and force manipulability: the conditions of section 2.2."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from argument_checks import Array
from argument_checks.ties import ACCURACY
from prioritized._mapping.amplification import (
    closure_sentences,
    gain_sentences,
    uncertainty_sentences,
)
from prioritized._mechanism.decisions import MajorTask, respanned
from prioritized._mechanism.names import Aliases, involved_joints
from prioritized._mechanism.task_motion import TaskMotion
from prioritized._solver.arrays import ReadOnly
from prioritized._solver.canonical import canonical
from prioritized._solver.rank import RankedSvd


@dataclass(frozen=True, eq=False)
class Finding(ReadOnly):
    """Result of testing a condition, with the directions concerned.

    Attributes:
        holds: Whether the condition holds.
        basis: Orthonormal basis of the directions concerned, empty when it does not hold.
        sentence: The result as a sentence.
    """

    holds: bool
    basis: Array
    sentence: str
    _gap: Callable[[], float]

    @cached_property
    def gap(self) -> float:
        """Factor by which the rank threshold could change without changing the result."""
        return self._gap()


class Findings(Mapping[str, Finding]):
    """Findings by name, each computed when first accessed."""

    def __init__(self, make: Callable[[str], Finding]) -> None:
        """Store the function that computes the finding of a name."""
        self._make = make
        self._cache: dict[str, Finding] = {}

    def __getitem__(self, name: str) -> Finding:
        if name not in self._cache:
            if name not in _SENTENCES:
                raise KeyError(name)
            self._cache[name] = self._make(name)
        return self._cache[name]

    def __iter__(self) -> Iterator[str]:
        return iter(_SENTENCES)

    def __len__(self) -> int:
        return len(_SENTENCES)


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
    "unobservable": (
        "Passive joints can move in {} without moving the task.",
        "No passive joint can move while the active joints and the task stand still.",
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
"""Sentences for a condition that holds, with directions and joints, and for one that does not."""


def finding_of(
    name: str, basis: Array, count: int, gap: Callable[[], float], joints: str = ""
) -> Finding:
    """Return the finding on a condition with a basis of `count` directions of these joints."""
    holds, fails = _SENTENCES[name]
    number = "one direction" if count == 1 else f"{count} directions"
    where = f"{number} (of {joints})" if joints else number
    return Finding(count > 0, basis, holds.format(where) if count else fails, gap)


@dataclass(frozen=True, eq=False)
class Manipulability:
    """Conditions of section 2.2 for one major task, evaluated on access; `str()` is a summary."""

    _task: MajorTask
    _of_mechanism: Callable[[str], Any]
    _aliases: Mapping[str, Callable[[], Aliases]]

    @cached_property
    def findings(self) -> Mapping[str, Finding]:
        """Findings on the conditions by name, each computed when first accessed.

        `unmanipulable`, `unmanipulable_task`, `unstable`, `unstable_major`, `unstable_secondary`,
        `unobservable`, `irresolvable`, `constrained_active`.
        """
        return Findings(self._finding)

    @property
    def worst_gain(self) -> float:
        """Least major speed per unit norm of the admissible rates: J_m's least singular value.

        Zero when unmanipulable, infinite without major rows.
        """
        decision = self._task.decision
        if decision.rank < len(self._task.S_m):
            return 0.0
        least = decision.sigma.min(initial=np.inf, where=decision.significant)
        return float(least) * self._task.measure.gain_unit

    @property
    def largest_gain(self) -> float:
        """Greatest major speed per unit norm of the admissible rates; zero without rows."""
        return float(self._task.decision.sigma.max(initial=0.0)) * self._task.measure.gain_unit

    @property
    def gain_uncertainty(self) -> float:
        """Relative error of `worst_gain` due to the geometry; zero if the task is unmanipulable."""
        return self._task.gain_uncertainty

    @property
    def closure_condition(self) -> float:
        """Condition number of J_Cp, the passive columns of J_C, on its rank; 1 without loops.

        It bounds the amplification of geometric errors in the passive rates. Lengths are in units
        of the mechanism's length.
        """
        return self._of_mechanism("closure_condition")

    @property
    def unmanipulable(self) -> bool:
        """Return whether some major velocity is unreachable; basis in major rows, (m1, .)."""
        return self.findings["unmanipulable"].holds

    @property
    def unmanipulable_task(self) -> bool:
        """Return whether some task velocity is unreachable; basis (m, .)."""
        return self.findings["unmanipulable_task"].holds

    @property
    def unstable(self) -> bool:
        """Return whether the task has self-motion with all active joints locked; basis (m, .)."""
        return self.findings["unstable"].holds

    @property
    def unstable_major(self) -> bool:
        """Return whether self-motion moves the major task; basis of these velocities, (m1, .)."""
        return self.findings["unstable_major"].holds

    @property
    def unstable_secondary(self) -> bool:
        """Return whether some self-motion moves the task but not the major task; basis (m, .)."""
        return self.findings["unstable_secondary"].holds

    @property
    def unobservable(self) -> bool:
        """Return whether passive joints can move alone, without moving the task; basis (p, .)."""
        return self.findings["unobservable"].holds

    @property
    def irresolvable(self) -> bool:
        """Return whether rigid statics leaves internal forces undetermined; basis rows (., c)."""
        return self.findings["irresolvable"].holds

    @property
    def constrained_active(self) -> bool:
        """Return whether the loops constrain the active rates, eq. (17); basis rows (., n)."""
        return self.findings["constrained_active"].holds

    @property
    def bases(self) -> dict[str, Array]:
        """Basis of each finding by name, empty where the condition does not hold."""
        return {name: finding.basis for name, finding in self.findings.items()}

    @property
    def gaps(self) -> dict[str, float]:
        """Gap of each finding: factor by which its rank threshold could change without effect."""
        return {name: finding.gap for name, finding in self.findings.items()}

    def __repr__(self) -> str:
        """Return a one-line summary for interactive use."""
        return f"<Manipulability. {' '.join(str(self).splitlines())}>"

    def __str__(self) -> str:
        sentences = [finding.sentence for finding in self.findings.values()]
        sentences += gain_sentences(self.largest_gain, self.worst_gain)
        if self.worst_gain:
            sentences += uncertainty_sentences(1.0 / self.worst_gain, self.gain_uncertainty)
        return "\n".join(sentences + closure_sentences(self.closure_condition))

    def _finding(self, name: str) -> Finding:
        task, joints = self._task.task, ""
        if name in _OF_ROWS:
            public_basis, decisions = self._of_mechanism(_OF_ROWS[name]), ()
            basis = public_basis.T
        else:
            columns, decisions = _COLUMNS[name](self._task, self._of_mechanism)
            public_basis = basis = canonical(columns)
        if name in self._aliases and basis.size:
            geometry = task.geometry
            accuracy = max(ACCURACY, geometry.rank_tolerance, geometry.error_bound)
            joints = involved_joints(basis, self._aliases[name](), accuracy)
        gap = partial(_gap, task, decisions)
        return finding_of(name, public_basis, basis.shape[1], gap, joints)


_Directions = tuple[Array, tuple[RankedSvd, ...]]
"""Directions as columns, and the rank decisions that they result from."""


def _unmanipulable(task: MajorTask, _: Any) -> _Directions:
    return respanned(_left_null(task.decision), 1.0 / task.major_units), (task.decision,)


def _unmanipulable_task(task: MajorTask, _: Any) -> _Directions:
    motion = task.task
    return respanned(_left_null(motion.decision), 1.0 / motion.task_units), (motion.decision,)


def _unstable(task: MajorTask, _: Any) -> _Directions:
    motion = task.task
    return respanned(_range(motion.moved), motion.task_units), (motion.moved,)


def _unstable_major(task: MajorTask, _: Any) -> _Directions:
    return respanned(_range(task.moved), task.major_units), (task.moved,)


def _unstable_secondary(task: MajorTask, _: Any) -> _Directions:
    svd = task.moved_secondary
    return respanned(_range(svd), task.task.task_units), (svd, task.moved)


def _unobservable(task: MajorTask, of_mechanism: Callable[[str], Any]) -> _Directions:
    motion, passive = task.task, of_mechanism("passive")
    null, units = motion.moved.null, motion.geometry.velocity_units[passive, None]
    columns = units * (motion.self_motion[passive] @ null)
    return np.linalg.qr(columns)[0] if columns.size else columns, (motion.moved,)


_COLUMNS = {
    "unmanipulable": _unmanipulable,
    "unmanipulable_task": _unmanipulable_task,
    "unstable": _unstable,
    "unstable_major": _unstable_major,
    "unstable_secondary": _unstable_secondary,
    "unobservable": _unobservable,
}
_OF_ROWS = {"irresolvable": "internal_force", "constrained_active": "active_constraint"}
"""Findings based on rows of the mechanism, with the attribute that has these rows."""


def _gap(task: TaskMotion, decisions: tuple[RankedSvd, ...]) -> float:
    """Return the smallest gap of all rank decisions that a finding depends on."""
    return float(min([task.gap, *(svd.gap for svd in decisions)]))


def _left_null(A: RankedSvd) -> Array:
    return A.U[:, int(A.rank) :]


def _range(A: RankedSvd) -> Array:
    return A.U[:, : int(A.rank)]
