"""What happens to actuators in a flight, and what a diagnosis takes them for."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from experiments.rig.run import SOUND as SOUND

_FORMER = {"strut": "actuator"}
"""Attributes of marks by the names that they have in earlier recordings."""


@dataclass(frozen=True)
class Mark:
    """The failure of an actuator in a run and its diagnosis, each a time, a kind and in words.

    A failure that is never diagnosed has an infinite time of diagnosis.
    """

    actuator: int
    failed_s: float
    failure: str
    diagnosed_s: float = np.inf
    diagnosis: str = ""
    kind: str = ""
    named: str = ""  # the kind that it was first taken for

    @property
    def is_found(self) -> bool:
        """Whether it was ever diagnosed."""
        return self.diagnosed_s < np.inf


@dataclass(frozen=True)
class Belief:
    """What a diagnosis takes an actuator for, from a time on: a kind of failure, or `SOUND`."""

    actuator: int
    time_s: float
    kind: str


def found_in(marks: Sequence[Mark]) -> list[Belief]:
    """The beliefs of a diagnosis of which the marks alone are known."""
    return [Belief(m.actuator, m.diagnosed_s, m.named or "found") for m in marks if m.is_found]


def marks_text(marks: Sequence[Mark]) -> str:
    """Marks as JSON, for :func:`marks_from`."""
    return json.dumps([asdict(mark) for mark in marks])


def marks_from(text: str, end_s: float) -> list[Mark]:
    """Marks of a hexapod's run that lasts until `end_s`, from JSON: a list of their attributes.

    Raises:
        ValueError: It is something else; the message states what came.
    """
    try:
        entries: list[dict[str, Any]] = json.loads(text)
        named = [{_FORMER.get(key, key): value for key, value in each.items()} for each in entries]
        marks = [Mark(**each) for each in named]
        valid = all(_is_valid(mark, end_s) for mark in marks)
    except (ValueError, TypeError, AttributeError):
        valid, marks = False, []
    if not valid:
        raise ValueError(
            f"expected a list of failures of struts 0 to 5 within {end_s:g} s, got {text!s:.80}"
        )
    return marks


def _is_valid(mark: Mark, end_s: float) -> bool:
    return (
        isinstance(mark.actuator, int)
        and mark.actuator in range(6)
        and 0 <= mark.failed_s <= end_s
        and mark.failed_s <= mark.diagnosed_s
        and (mark.diagnosed_s <= end_s or not mark.is_found)
        and all(isinstance(w, str) for w in (mark.failure, mark.diagnosis, mark.kind, mark.named))
    )
