"""Classification of the remaining major task in each condition of a failure atlas."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fjh.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, YELLOW
from prioritized import Classes, FailureAtlas

KEPT = ("exact", "rigid", "springs")
"""Names of the classes in which the major task is possible."""

_NUMBERS = ("no", "one", "two", "three", "four", "five")
_LEFT = (BLACK, YELLOW, ORANGE, PURPLE, GREEN, "#999999")
"""Colors by the number of remaining directions."""


@dataclass(frozen=True)
class Verdict:
    """Class of the conditions of an atlas that leave the same part of the major task.

    Attributes:
        name: Name in files.
        label: Label for people.
        color: Color on a map.
        holds: True for the conditions of this class, shape (C,).
        by_failures: Number of conditions by number of failed actuators, shape (n + 1,).
    """

    name: str
    label: str
    color: str
    holds: NDArray[np.bool_]
    by_failures: NDArray[np.intp]


def left_of(classes: Classes) -> NDArray[np.object_]:
    """Return the class of the major task in each condition, strings (C,).

    "exact"; "drifts" if self-motion moves the task; else the number of remaining directions:
    "two_directions", "one_direction" or "none".
    """
    # With all directions the task is exact or drifts.
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
    """Return disjoint classes that cover all conditions of an atlas, the best first.

    They are those of :func:`left_of`; for an elastic mechanism "exact" is split into "rigid", exact
    with and without springs, and "springs", exact with the springs only.

    Args:
        atlas: Atlas of any mechanism.
        task: Adjective of the major task's directions in labels.
        body: Name of what a self-motion moves, in labels.
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
    """Return the name of each condition's class, strings (C,)."""
    names = np.empty(len(found[0].holds), dtype=object)
    for verdict in found:
        names[verdict.holds] = verdict.name
    return names
