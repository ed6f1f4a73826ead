"""Rigs for many tests, each made once per process, since rigs are frozen."""

from functools import cache
from typing import Any

import numpy as np

from fjh.rig import Mismatch, Rig
from fjh.rig.mismatch import Known
from sim import MODELS, Array, Bench
from tests.robots import TEST_MODELS

FAILED_S = 0.5
ARM = MODELS / "arm.xml"
ROWS = {"arm": (0, 1), "fjh": (0, 1), "platform": (3, 4), "hand": (3, 4), "arms": (3, 4, 5)}


@cache
def shared_rig(name: str, mismatch: Known | Mismatch = "exact", **options: Any) -> Rig:
    """Return the rig of the hexapod, or of a file in models."""
    if name == "hexapod":
        return Rig.hexapod(mismatch=mismatch, seed=3, **options)
    given: dict[str, Any] = {"major": ROWS[name], "axes": "base" if name == "fjh" else None}
    return Rig.of_mjcf(MODELS / f"{name}.xml", mismatch=mismatch, seed=3, **(given | options))


@cache
def rig_of(name: str, **options: Any) -> Rig:
    """Return the rig of a file in tests/models."""
    return Rig.of_mjcf(TEST_MODELS / f"{name}.xml", **options)


def path_of(name: str, duration_s: float = 0.8) -> Array:
    return shared_rig(name).path("circle", duration_s=duration_s, turn_s=0.8)


def readings(bench: Bench, inputs: Array) -> Array:
    """Return the sensor readings at each tick, after which these inputs are applied."""
    read = []
    for each in inputs:
        read.append(np.concatenate(bench.measure()))
        bench.apply(each)
    return np.array(read)
