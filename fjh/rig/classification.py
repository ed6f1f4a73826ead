"""Classification of the conditions of a failure atlas by what remains of the major task."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fjh.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, YELLOW
from prioritized import Classes, FailureAtlas

POSSIBLE = ("exact", "rigid", "springs")
"""Names of the classes in which the major task is possible."""

_NUMBERS = ("no", "one", "two", "three", "four", "five")
_COLORS = (BLACK, YELLOW, ORANGE, PURPLE, GREEN, "#999999")
"""Colors by the number of remaining directions."""


@dataclass(frozen=True)
class Classification:
    """Class of conditions of an atlas in which the same part of the major task remains.

    Attributes:
        name: Name in files.
        label: Label for people.
        color: Color on a map.
        holds: True for each of the C conditions that is in this class, shape (C,).
        by_failures: Number of its conditions by number of failed actuators, shape (n + 1,).
    """

    name: str
    label: str
    color: str
    holds: NDArray[np.bool_]
    by_failures: NDArray[np.intp]


def classify(classes: Classes) -> NDArray[np.object_]:
    """Return the name of the major task's class in each of C conditions, strings (C,).

    "exact"; "drifts" if self-motion moves the task; else the number of remaining directions:
    "two_directions", "one_direction" or "none".
    """
    # With all directions the task is exact or drifts.
    names = [_counted(count) for count in range(classes.gains.shape[1] + 1)]
    labels = np.array(names, dtype=object)[classes.major_rank]
    labels[classes.unstable_major] = "drifts"
    labels[classes.possible] = "exact"
    return labels


def _counted(count: int) -> str:
    return f"{_NUMBERS[count]}_{_noun(count)}" if 0 < count < len(_NUMBERS) else "none"


def _noun(count: int) -> str:
    return "directions" if count > 1 else "direction"


def classifications(
    atlas: FailureAtlas, *, task: str = "task", body: str = "task"
) -> list[Classification]:
    """Return disjoint classes that cover all conditions of an atlas, beginning with "exact".

    The classes are those of :func:`classify`, but an elastic mechanism has two in place of "exact":
    "rigid", exact with and without springs, and "springs", exact with the springs only.

    Args:
        atlas: Atlas of any mechanism.
        task: Adjective for directions of the major task in labels, such as "pointing".
        body: Name in labels of the body that a self-motion moves.
    """
    springs, rigid = atlas.elastic, atlas.possible
    names, failing = classify(springs or atlas), (atlas.codes != 0).sum(axis=1)

    if springs is None:
        classes = [("exact", "exact", BLUE, rigid)]
    else:
        classes = [
            ("rigid", "exact, with or without springs", BLUE, rigid),
            ("springs", "exact with the springs only", SKY, ~rigid & (names == "exact")),
        ]
    classes.append(("drifts", f"{body} drifts", VERMILION, ~rigid & (names == "drifts")))
    for count in reversed(range(atlas.gains.shape[1])):
        name, label = _counted(count), f"{_NUMBERS[count]} {task} {_noun(count)} left"
        classes.append((name, label, _COLORS[count], ~rigid & (names == name)))
    sizes = atlas.codes.shape[1] + 1
    return [
        Classification(name, label, color, holds, np.bincount(failing[holds], minlength=sizes))
        for name, label, color, holds in classes
    ]


def names_of(classifications: Sequence[Classification]) -> NDArray[np.object_]:
    """Return the name of each condition's class, strings (C,)."""
    names = np.empty(len(classifications[0].holds), dtype=object)
    for classification in classifications:
        names[classification.holds] = classification.name
    return names
