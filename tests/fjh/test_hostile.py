"""Hostile arguments of rigs, inverse kinematics and the hexapod's parts raise or are harmless."""

from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from fjh.ik import Ik, Limits
from fjh.rig import Mismatch, Rig
from fjh.rig.events import Event
from fjh.rig.hexapod import trajectory
from fjh.rig.hexapod.amplifier import Amplifier, displacement_limits
from fjh.rig.hexapod.closed_form import Hexapod, Posture, hexapod
from fjh.rig.hexapod.coil import Coils
from fjh.rig.hexapod.detector import Detector, pointing_angles, secondary_motion
from fjh.rig.hexapod.forward import UnreachableLengths, forward_kinematics
from fjh.rig.hexapod.strut_sensors import StrutSensors
from fjh.rig.options import RobotOptions
from fjh.study.errors import WrongInput
from ftc import Goal
from ftc.fdi import Fault
from sim import (
    MODELS,
    NOMINAL,
    Failure,
    FrameTask,
    ModelError,
    PostureTask,
    SimulationDiverged,
    load_model,
)
from tests.hostile import POSITIVE, Package, one_by_one, public

PARTS = public(
    *(Amplifier, Coils, Detector, Hexapod, Posture, StrutSensors, displacement_limits, hexapod),
    *(pointing_angles, secondary_motion, forward_kinematics, trajectory.spiral),
    *(Ik, Mismatch, Event, RobotOptions),
    trusted=("Ik.advance",),  # which is `sim.advance`
)
RIGS = public(
    Rig,
    trusted=(
        # Called with checked arguments.
        *("Rig", "Rig.bench", "Rig.feedforward_demands", "Rig.reached"),
        *("Rig.hexapod", "Rig.of_mjcf"),  # slow: `tests/fjh/rig/test_errors.py`
    ),
)


@cache
def parts() -> Package:
    """Return parts of the hexapod's bench, and inverse kinematics of the arm, with good values."""
    model, arm = load_model(), load_model(MODELS / "arm.xml")
    machine, data = hexapod(model), mujoco.MjData(arm)
    posture, rng = machine.posture(NOMINAL), np.random.default_rng(0)
    tasks = [FrameTask("payload", target=np.ones(3)), PostureTask(target=np.ones(arm.nq))]
    ik = Ik(arm, tasks, Limits(velocity=1.0))
    driven = {"bits": 16, "full_input_a": 4.0, "limit_a": 3.0, "newton_per_a": 20.0}
    driven |= {"newton_per_m": 1e5}
    heated = {"thermal_resistance_k_per_w": np.full(2, 1.5), "resistance_ohm": 5.0}
    heated |= {"heat_capacity_j_per_k": 4.0, "ambient_c": 20.0}
    optics = {"focal_length_m": 1.0, "half_width_m": 5e-3, "noise_m": 3e-7}
    rotations = {"rotation": np.stack([np.eye(3)] * 2), "translation_m": np.ones((2, 3))}
    good = {
        **{**driven, **heated, **optics, "displacement_m": np.full(6, 1e-5), "model": model},
        **{"input_percent": np.ones(6), "current_a": np.ones(2), "temperature_c": np.full(2, 30.0)},
        **{"period_s": 1e-3, "rotation": np.eye(3), "translation_m": np.zeros(3), "rng": rng},
        **{"bottom_m": machine.bottom_m, "top_m": machine.top_m, "pose": NOMINAL, "T": np.eye(4)},
        **{"inverse_jacobian": posture.inverse_jacobian, "twist": np.full(6, 1e-3), "dt": 0.01},
        **{"amplifier": Amplifier(**driven), "geometry": machine, "current_limit_a": np.ones(6)},
        **{"displacements_m": np.full(6, 1e-5), "time_s": np.arange(3.0), "radius_rad": 1e-4},
        **{"turns": 8.0, "duration_s": 16.0, "tasks": tasks, "limits": Limits(velocity=1.0)},
        **{"data": data, "locked": [0], "free": [1], "factor": 0.5, "noise_m": 1e-9},
        **{"name": "bump", "text": "locked:strut1@1.3", "timestep_s": None, "start_rad": 1.0},
    }
    special = {
        "Coils.temperatures_c": {"current_a": np.ones((3, 2))},
        "Detector": optics,
        "pointing_angles": rotations,
        "secondary_motion": rotations,
        "Ik": {"model": arm},
        "Event": {"time_s": 0.1},
        "Event of an actuator": {"name": "locked", "time_s": 0.1, "actuator": 0},
        "RobotOptions": {"limits": "stated", "size": 1e-3, "noise": 1e-5, "crossover": 5.0}
        | {"joint_weight": (1.0,), "secondary_weight": (1.0,), "servo": 5.0},
    }
    objects = {
        **{"Amplifier": Amplifier(**driven), "Coils": Coils(**heated), "Ik": ik},
        **{"Detector": lambda: Detector(**optics), "StrutSensors": StrutSensors(1e-9)},
        **{"Hexapod": machine, "Posture": posture, "Mismatch": Mismatch(gain=0.1)},
    }
    inputs = np.array([1e-4, -1.0])
    uses = {
        "Amplifier": lambda made: made.displacements(made.inputs(inputs)),
        "Coils": lambda made: made.step(made.cold(), np.ones(made.cold().shape), 1e-3),
        "Detector": lambda made: made.read(np.eye(3), np.random.default_rng(0)),
        "StrutSensors": lambda made: made.read(np.zeros(6), np.random.default_rng(0)),
        "Hexapod": lambda made: (made.nominal_length_m, made.posture(NOMINAL)),
        "Pose": lambda pose: machine.posture(pose),
        "Posture": lambda made: made.twist(np.ones(6)),
        "Hexapod.moved": lambda posture: posture,
        **{"MjData": lambda data: data.qpos, "IkSolution": lambda result: result.qvel},
        "Ik": lambda made: made.step(data, 0.01),
    }
    return Package(
        callables=PARTS,
        good=good,
        special=special,
        objects=objects,
        uses=uses,
        errors=(ValueError, TypeError, ModelError, UnreachableLengths, WrongInput),
        ranges=dict.fromkeys((*driven, *heated, *optics), POSITIVE)
        | {"bits": (1, 53), "noise_m": (0, np.inf), "ambient_c": (-np.inf, np.inf)},
        excluded={
            **{"Event": ("name", "actuator"), "Event of an actuator": ("name",)},  # names in a list
            "RobotOptions": ("site", "axes", "keyframe", "pinned"),  # names in a model
        },
        unsolvable=(ModelError, UnreachableLengths),
    )


test_a_hostile_argument_is_reported_or_harmless = one_by_one(parts, PARTS)


@cache
def rigs() -> Package:
    """Return the hexapod's rig, which is slow to make, with good values."""
    rig = Rig.hexapod()
    good = {
        **{"faults": [Fault(0, "weak", 0.5)], "goal": Goal(), "mismatch": "exact", "seed": 0},
        **{"controller": rig.controller(), "path": np.zeros((3, 2)), "events": (), "actuator": 0},
        **{"failures": [Failure(0, "locked", 0.001)], "on_tick": lambda *_: None, "turn_s": 0.01},
        **{"name": "circle", "duration_s": 0.01, "dither": None, "noise": None, "start": None},
        **{"floor_m_per_s2": None, "before": Goal(), "after": Goal(locked_at={0: 0.0})},
        "time_s": 0.005,
    }

    def simulated(controller: Any) -> Any:
        run = rig.fly(controller, np.zeros((3, 2)))
        return run.true, run.status

    uses = {
        **dict.fromkeys(("Supervisor", "PrioritizedController", "OracleController"), simulated),
        "Manipulability": lambda result: result.worst_gain,
        "Prediction": lambda result: result.rms_before,  # without a failure there is none after
        "Run": lambda run: (run.true, run.measured),
        "PrioritizedMapping": lambda mapping: mapping.major_gain(),
    }
    return Package(
        callables=RIGS,
        good=good,
        objects={"Rig": rig},
        uses=uses,
        errors=(ValueError, TypeError, WrongInput),
        unsolvable=(ModelError, SimulationDiverged, WrongInput),
    )


@pytest.mark.long
@pytest.mark.parametrize("name", RIGS)
def test_hostile_argument_of_a_rig_is_reported_or_harmless(name):
    rigs().attack(name)
