"""The closed loop of a robot as a whole, beside the physics alone; nothing fails."""

from copy import copy
from typing import Any

import mujoco
import numpy as np

from benchmarks.contender import Contender
from fjh import Rig
from ftc import run_loop
from sim import MODELS, Bench

MAJOR = {"arm": (3, 4, 5), "hand": (3, 4), "arms": (3, 4, 5), "platform": (3, 4)}
"""Bundled robots beside the hexapod, and their major rows."""
DURATION_S = 2.0  # after 0.8 s a supervisor has learnt what is normal and weighs evidence


def loop(name: str, rng: np.random.Generator) -> dict[str, Contender]:
    """Ticks of bare physics, of the loop, and of the loop that diagnoses.

    A tick of a loop reads the sensors, estimates the posture, maps, compensates, drives the motors,
    keeps a log, and contains the physics. Machine and path are made before.
    """
    rig = Rig.hexapod()
    if name in MAJOR:
        rig = Rig.of_mjcf(MODELS / f"{name}.xml", site="payload", major=MAJOR[name])
    path, seed = rig.path("circle", duration_s=DURATION_S), int(rng.integers(2**32))
    demands = rig.feedforward_demands(path)

    def bench() -> Bench:
        return rig.bench(np.arange(len(path)) * rig.period_s, (), seed)

    def looped(controller: Any) -> Contender:
        return Contender(
            run_loop, lambda: [(bench(), controller, path, demands)], len(path), rounds=1
        )

    plant = bench().plant
    model, steps = plant.model, len(path) * round(rig.period_s / plant.model.opt.timestep)
    return {
        "physics": Contender(
            mujoco.mj_step, lambda: [(model, copy(plant.data), steps)], len(path), rounds=1
        ),
        "loop": looped(rig.controller()),
        "supervised": looped(rig.supervisor()),
    }
