"""Time the complete control loop of a robot, and its physics alone, without failures."""

from copy import copy
from typing import Any

import mujoco
import numpy as np

from benchmarks.candidate import Candidate
from fjh import Rig
from ftc import run_loop
from sim import MODELS, Bench

MAJOR = {"arm": (3, 4, 5), "hand": (3, 4), "arms": (3, 4, 5), "platform": (3, 4)}
"""Major rows of the bundled robots other than the hexapod."""
DURATION_S = 2.0  # the first 0.8 s are the learning phase of the supervisor


def loop(name: str, rng: np.random.Generator) -> dict[str, Candidate]:
    """Return candidates: a tick of the physics, of the loop, and of the loop with diagnosis.

    A tick of the loop includes sensors, posture estimate, compensators, mapping, drives, log and
    physics. Machine and path are made outside the timed part.
    """
    rig = Rig.hexapod()
    if name in MAJOR:
        rig = Rig.of_mjcf(MODELS / f"{name}.xml", site="payload", major=MAJOR[name])
    path, seed = rig.path("circle", duration_s=DURATION_S), int(rng.integers(2**32))
    demands, ticks = rig.feedforward_demands(path), len(path)

    def bench() -> Bench:
        return rig.bench(np.arange(ticks) * rig.period_s, (), seed)

    def loop_candidate(controller: Any) -> Candidate:
        return Candidate(run_loop, lambda: [(bench(), controller, path, demands)], ticks, rounds=1)

    plant = bench().plant
    model, steps = plant.model, ticks * round(rig.period_s / plant.model.opt.timestep)
    physics = Candidate(mujoco.mj_step, lambda: [(model, copy(plant.data), steps)], ticks, rounds=1)
    return {
        "physics": physics,
        "loop": loop_candidate(rig.controller()),
        "supervised": loop_candidate(rig.supervisor()),
    }
