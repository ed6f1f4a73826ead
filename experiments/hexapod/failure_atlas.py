"""Verdicts on the failure conditions of the hexapod: what is left of pointing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.output.plotting import BLACK, BLUE, SKY, VERMILION, YELLOW
from prioritized import FailureAtlas


@dataclass(frozen=True)
class Verdict:
    """What is left of the pointing task in some of the conditions.

    Attributes:
        name: As in `figures.json`.
        label: For a reader.
        color: On the map.
        holds: In which conditions, shape (C,).
    """

    name: str
    label: str
    color: str
    holds: NDArray[np.bool_]


def verdicts(atlas: FailureAtlas) -> list[Verdict]:
    """The atlas' flags as five verdicts of which each condition has exactly one.

    Raises:
        ValueError: The atlas has no elastic verdicts.
    """
    elastic = atlas.elastic
    if elastic is None:
        raise ValueError("atlas must be of a system with springs, got one without elastic verdicts")
    lost = ~atlas.possible & ~elastic.possible
    drifts = lost & elastic.unstable_major
    held = lost & ~elastic.unstable_major
    return [
        Verdict("rigid", "exact, with or without springs", BLUE, atlas.possible),
        Verdict(
            "springs",
            "exact because of the springs",
            SKY,
            elastic.possible & ~atlas.possible,
        ),
        Verdict("drifts", "payload drifts", VERMILION, drifts),
        Verdict(
            "one_direction", "one pointing direction left", YELLOW, held & (elastic.major_rank == 1)
        ),
        Verdict("none", "no pointing left", BLACK, held & (elastic.major_rank == 0)),
    ]
