"""The conditions of section 2.2 in words."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from argument_checks import Array
from prioritized._solver.arrays import ReadOnly


@dataclass(frozen=True, eq=False)
class Finding(ReadOnly):
    """Whether a condition holds, and in which directions.

    Attributes:
        holds: The verdict.
        basis: Orthonormal basis of the directions concerned, empty when it does not hold.
        sentence: The verdict in words.
    """

    holds: bool
    basis: Array
    sentence: str
    _gap: Callable[[], float]

    @cached_property
    def gap(self) -> float:
        """Factor by which the rank threshold could change before the verdict might."""
        return self._gap()


class Findings(Mapping[str, Finding]):
    """Findings by name, each made when it is first looked up."""

    def __init__(self, make: Callable[[str], Finding]) -> None:
        """Take what makes one of its name."""
        self._make = make
        self._made: dict[str, Finding] = {}

    def __getitem__(self, name: str) -> Finding:
        if name not in self._made:
            if name not in _SENTENCES:
                raise KeyError(name)
            self._made[name] = self._make(name)
        return self._made[name]

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
"""The sentence when a condition holds, with its directions and joints, and when it does not."""


def found(
    name: str, basis: Array, count: int, gap: Callable[[], float], joints: str = ""
) -> Finding:
    """The finding on a condition with a basis of `count` directions, which concern these joints."""
    holds, fails = _SENTENCES[name]
    number = "one direction" if count == 1 else f"{count} directions"
    where = f"{number} (of {joints})" if joints else number
    return Finding(count > 0, basis, holds.format(where) if count else fails, gap)
