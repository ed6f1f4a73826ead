"""The closed loop of a robot as a whole, beside the physics alone; nothing fails."""

from copy import copy
from functools import partial

import mujoco
import numpy as np

from benchmarks.contender import Contender, Question
from fjh.rig import Rig
from sim import MODELS

MAJOR = {"arm": (3, 4, 5), "hand": (3, 4), "arms": (3, 4, 5), "platform": (3, 4)}
"""Bundled robots beside the hexapod, and their major rows."""
DURATION_S = 2.0


def loop(name: str, rng: np.random.Generator) -> Question:
    """Times of a control tick: bare physics, the loop, and the loop that diagnoses."""
    seed = int(rng.integers(2**32))
    rig = Rig.hexapod()
    if name in MAJOR:
        rig = Rig.of_mjcf(MODELS / f"{name}.xml", site="payload", major=MAJOR[name])
    path = rig.path("circle", duration_s=DURATION_S)
    plant = rig.bench(np.zeros(1), (), seed).plant
    steps = len(path) * round(rig.period_s / plant.model.opt.timestep)

    def physics() -> None:
        mujoco.mj_step(plant.model, copy(plant.data), steps)

    calls = {"physics": physics} | {
        kind: partial(rig.fly, controller, path, seed=seed)
        for kind, controller in (("loop", rig.controller()), ("supervised", rig.supervisor()))
    }
    contenders = [
        Contender(f"{name}_{kind}", call, units=len(path), rounds=1) for kind, call in calls.items()
    ]
    return Question({each.name: each for each in contenders}, {})
