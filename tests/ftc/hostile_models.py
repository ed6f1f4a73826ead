"""What is attacked of the loop: what a controller is made of."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import control
import numpy as np

from ftc import (
    ControlTask,
    Goal,
    GuardedController,
    LocalGeometry,
    LoopShape,
    compensator,
    goal_after,
    inverse_feedforward,
    margins,
    tracking,
)
from ftc.control.geometry import MechanismGeometry
from ftc.fdi import DEFAULT_CONFIG, Fault, NominalModel, fault_model
from tests.ftc.hostile_loop import FAULTY, SWING, TOLD
from tests.ftc.hostile_machine import (
    CHANNEL,
    DRIVE,
    GOAL,
    LIMITS,
    LINEAR,
    LOOP,
    LOWER,
    M1,
    MODEL,
    NOMINAL,
    PERIOD_S,
    PILOT,
    SHAPE,
    STILL,
    SYSTEM,
    TASK,
    TRACK,
    TRACKED,
    C,
    N,
    Stage,
    flown,
    mapping,
    pilot,
    told,
)
from tests.hostile import Target

LOADED = {"feedback": np.eye(N, 2 * N), "holding": np.ones(N), "spring": np.eye(N, 2 * N)}
LOADED |= {"preload": np.ones(N), "implicit_damping": False, "floor": np.ones((N, 3))}
RUBS = np.eye(N), np.eye(N), np.ones(N), np.ones(N), np.ones(N)
ENCODED = {"limits": LIMITS, "springs": False, "sense": "joints", "noise": np.ones(N)}
ENCODED |= {"unused": "free", "feedforward": True}


def model(**given: Any) -> Any:
    """What a model does after each failure."""
    nominal = NominalModel(**given)
    faulty = fault_model(nominal, [Fault(0, "locked"), Fault(1, "free")])
    return fault_model(nominal), replace(faulty, rubbing=None), nominal.noise, nominal.displacement


def model_of(lower: Any, drive: Any, C: Any) -> Any:
    """The same of a plant in numbers; what python-control refuses itself is not ours."""
    try:
        rows = [np.eye(N, 2 * N, N), np.asarray(lower)]
        plant = control.ss(np.vstack(rows), np.vstack([np.zeros((N, N)), drive]), C, 0)
    except Exception:
        raise ValueError("lower, drive and C must be of a plant") from None
    try:
        return model(**(MODEL | {"plant": plant}))
    except ValueError as error:
        raise ValueError(f"lower, drive and C: {error}") from None


def rubbing(**given: Any) -> Any:
    return model(**MODEL, friction=tuple(given.values()))


def weighed(**given: Any) -> Any:
    """A goal is used by a mapping and by a controller."""
    goal = Goal(**given)
    return mapping(goal).major_gain(), flown(pilot(goal))


def tracked(**given: Any) -> Any:
    found = tracking(**({**TRACKED, "crossover_hz": 5.0} | given))
    return found.loops, found.nominal.noise, flown(found.controller(GOAL))


def tracked_plant(**given: Any) -> Any:
    return tracked(linear=SimpleNamespace(**given))


def on_three(geometry: Any) -> Any:
    """Where three displacements lead."""
    return geometry.moved(geometry.nominal, STILL), geometry.system.J_T


TARGETS = {
    "LoopShape": Target(
        lambda **a: compensator(CHANNEL, LoopShape(**a), PERIOD_S), dict(vars(SHAPE))
    ),
    "compensator": Target(compensator, {"plant": CHANNEL, "shape": SHAPE, "period_s": PERIOD_S}),
    "margins": Target(
        lambda L: margins(L).phase_margin_deg, {"L": control.c2d(CHANNEL, PERIOD_S) * LOOP.discrete}
    ),
    "LocalGeometry": Target(lambda system: on_three(LocalGeometry(system)), {"system": SYSTEM}),
    "MechanismGeometry": Target(
        lambda **a: on_three(MechanismGeometry(**a)),
        {"model": Stage(), "free": (0,), "springs": False},
    ),
    "ControlTask": Target(
        lambda **a: flown(GuardedController("own", lambda _: PILOT, ControlTask(**a))),
        dict(vars(TASK)),
    ),
    "Fault": Target(
        lambda **a: fault_model(NOMINAL, [Fault(**a)]),
        {"actuator": 0, "kind": "weak", "effectiveness": 0.5},
    ),
    "NominalModel": Target(model, MODEL),
    "NominalModel with loads": Target(lambda **a: model(**MODEL, **a), LOADED),
    "NominalModel with names": Target(
        lambda names: model(**MODEL, names=names), {"names": [f"motor{k}" for k in range(N)]}
    ),
    "NominalModel with friction": Target(
        lambda friction: model(**MODEL, friction=friction), {"friction": RUBS}
    ),
    "NominalModel with friction in numbers": Target(
        rubbing, dict(zip(("push", "rows", "limit", "softness", "rate"), RUBS, strict=True))
    ),
    "NominalModel of a plant": Target(
        model_of,
        {"lower": LOWER, "drive": DRIVE, "C": C},
        gaps=("lower", "drive", "C"),  # numpy and python-control take masks off, not we
    ),
    "NominalModel.measured": Target(NOMINAL.measured, {"C": C, "noise": NOMINAL.noise}),
    "fault_model": Target(fault_model, {"nominal": NOMINAL, "faults": FAULTY}),
    "inverse_feedforward": Target(
        inverse_feedforward,
        {"nominal": NOMINAL, "gain": PILOT.mapping.major_gain(), "path": np.ones((4, M1))},
    ),
    "Goal": Target(
        weighed,
        {"joint_weight": (1.0,) * N, "secondary_weight": (1.0,), "locked_at": {0: 1e-3}}
        | {"free": (), "spring_lost": (), "effectiveness": {1: 0.5}},
    ),
    "Goal in numbers": Target(
        lambda joint_weight, secondary_weight, locked_at, effectiveness: weighed(
            joint_weight=joint_weight,
            secondary_weight=secondary_weight,
            locked_at={0: locked_at},
            effectiveness={1: effectiveness},
        ),
        {"joint_weight": np.ones(N), "secondary_weight": np.ones(1)}
        | {"locked_at": 1e-3, "effectiveness": 0.5},
    ),
    "Goal.of": Target(lambda actuators: vars(Goal(free=(1,)).of(actuators)), {"actuators": N}),
    "goal_after": Target(
        goal_after, {"goal": GOAL, "diagnoses": TOLD, "nominal": NOMINAL, "unused": "free"}
    ),
    "tracking": Target(tracked, TRACKED | {"crossover_hz": 5.0, "sense": "task"}),
    "tracking with options": Target(tracked, ENCODED),
    "tracking of a plant": Target(tracked_plant, LINEAR),
    "Tracking.mapping": Target(lambda goal: TRACK.mapping(goal).major_gain(), {"goal": GOAL}),
    "Tracking.controller": Target(told(TRACK.controller), {"goal": GOAL}),
    "Tracking.supervisor": Target(
        told(TRACK.supervisor), {"config": DEFAULT_CONFIG, "dither": SWING}
    ),
    "Tracking.classified": Target(
        lambda faults: TRACK.classified(faults).worst_gain, {"faults": FAULTY}
    ),
}
