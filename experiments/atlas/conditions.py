"""The 3^6 failure conditions of the hexapod, and those of them that are not turned into another."""

import itertools

import numpy as np
import pyarrow as pa

from experiments.hexapod.failure_atlas import verdicts
from experiments.hexapod.goal import MAJOR
from experiments.hexapod.springs import elastic_system
from experiments.sweep.machine import machine
from prioritized import FailureAtlas, failure_atlas

LETTERS = "SLF"
"""By the atlas' codes: sound, locked, free."""

_TURN = (2, 3, 4, 5, 0, 1)
_MIRROR = (1, 0, 5, 4, 3, 2)


def conditions() -> tuple[str, ...]:
    """All of them, a letter for each strut, in the atlas' order."""
    return tuple(map("".join, itertools.product(LETTERS, repeat=6)))


def representatives() -> tuple[str, ...]:
    """One of each set that turning by 120 degrees and mirroring make of one another."""
    return tuple(each for each in conditions() if each == min(_alike(each), key=_code))


def verdict_columns(struts: pa.ChunkedArray) -> list[tuple[str, pa.Array]]:
    """What the library says of conditions, rigid and with the springs: further columns of a table.

    Args:
        struts: Conditions, by their letters.
    """
    atlas = classified()
    elastic = atlas.elastic
    assert elastic is not None  # the hexapod has springs
    row = {condition: k for k, condition in enumerate(conditions())}
    rows = np.array([row[each] for each in struts.to_pylist()])
    name = np.empty(len(atlas.codes), dtype=object)
    for verdict in verdicts(atlas):
        name[verdict.holds] = verdict.name
    columns = {
        "verdict": name,
        "failures": (atlas.codes != 0).sum(axis=1),
        "rigid_possible": atlas.possible,
        "rigid_unstable_major": atlas.unstable_major,
        "rigid_worst_gain_rad_per_m": atlas.worst_gain,
        "elastic_possible": elastic.possible,
        "elastic_major_rank": elastic.major_rank,
        "elastic_worst_gain_rad_per_m": elastic.worst_gain,
    }
    return [(name, pa.array(values[rows])) for name, values in columns.items()]


def classified() -> FailureAtlas:
    """All conditions, (alpha, beta) being the major task."""
    return failure_atlas(elastic_system(machine()), MAJOR)


def _alike(condition: str) -> set[str]:
    found = set()
    for seen in (condition, _moved(condition, _MIRROR)):
        for _ in range(3):
            seen = _moved(seen, _TURN)
            found.add(seen)
    return found


def _moved(condition: str, struts: tuple[int, ...]) -> str:
    return "".join(condition[k] for k in struts)


def _code(condition: str) -> list[int]:
    return [LETTERS.index(letter) for letter in condition]
