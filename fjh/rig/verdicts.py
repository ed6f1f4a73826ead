"""What is left of the major task in each condition of a failure atlas, as verdicts in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fjh.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, YELLOW
from prioritized import Classes, FailureAtlas

KEPT = ("exact", "rigid", "springs")
"""Names of the verdicts with which the major task is possible."""

_NUMBERS = ("no", "one", "two", "three", "four", "five")
_LEFT = (BLACK, YELLOW, ORANGE, PURPLE, GREEN, "#999999")
"""Number of directions that are left, in words and in colours."""


@dataclass(frozen=True)
class Verdict:
    """What is left of the major task in some of the conditions of an atlas.

    Attributes:
        name: As in files.
        label: For a reader.
        color: On a map.
        holds: In which conditions, shape (C,).
        by_failures: Their number, by how many actuators have failed, shape (n + 1,).
    """

    name: str
    label: str
    color: str
    holds: NDArray[np.bool_]
    by_failures: NDArray[np.intp]


def left_of(classes: Classes) -> NDArray[np.object_]:
    """What is left of the major task in each condition, strings (C,).

    It is "exact", or "drifts": self-motion moves it; else so many directions are left:
    "two_directions", "one_direction" or "none".
    """
    # The last has all its directions, and is exact or drifts.
    names = [_counted(count) for count in range(classes.gains.shape[1] + 1)]
    left = np.array(names, dtype=object)[classes.major_rank]
    left[classes.unstable_major] = "drifts"
    left[classes.possible] = "exact"
    return left


def _counted(count: int) -> str:
    return f"{_NUMBERS[count]}_{_noun(count)}" if 0 < count < len(_NUMBERS) else "none"


def _noun(count: int) -> str:
    return "directions" if count > 1 else "direction"


def verdicts(atlas: FailureAtlas, *, task: str = "task", body: str = "task") -> list[Verdict]:
    """The atlas' flags as verdicts of which each condition has exactly one, the best first.

    Those of :func:`left_of`, with springs where the mechanism has some: then what is exact is
    "rigid", without them as well, or exact with the "springs" only.

    Args:
        atlas: Of any mechanism.
        task: The adjective of the major task's directions in labels.
        body: What a self-motion moves, in labels.
    """
    springs, rigid = atlas.elastic, atlas.possible
    left, failing = left_of(springs or atlas), (atlas.codes != 0).sum(axis=1)

    def verdict(name: str, label: str, color: str, holds: NDArray[np.bool_]) -> Verdict:
        by_failures = np.bincount(failing[holds], minlength=atlas.codes.shape[1] + 1)
        return Verdict(name, label, color, holds, by_failures)

    if springs is None:
        found = [verdict("exact", "exact", BLUE, rigid)]
    else:
        found = [
            verdict("rigid", "exact, with or without springs", BLUE, rigid),
            verdict("springs", "exact with the springs only", SKY, ~rigid & (left == "exact")),
        ]
    found.append(verdict("drifts", f"{body} drifts", VERMILION, ~rigid & (left == "drifts")))
    for count in reversed(range(atlas.gains.shape[1])):
        name, label = _counted(count), f"{_NUMBERS[count]} {task} {_noun(count)} left"
        found.append(verdict(name, label, _LEFT[count], ~rigid & (left == name)))
    return found


def names_of(found: Sequence[Verdict]) -> NDArray[np.object_]:
    """Name of the verdict of each condition of the atlas, strings (C,)."""
    names = np.empty(len(found[0].holds), dtype=object)
    for verdict in found:
        names[verdict.holds] = verdict.name
    return names
