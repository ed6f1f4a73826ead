"""What no bench is, is refused by name: numbers that were once accepted, or came back as NaN."""

import copy
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod.amplifier import Amplifier
from fjh.rig.hexapod.closed_form import Hexapod, hexapod
from fjh.rig.hexapod.coil import Coils
from fjh.rig.hexapod.detector import Detector, pointing_angles, secondary_motion
from fjh.rig.hexapod.strut_sensors import StrutSensors
from fjh.rig.hexapod.trajectory import spiral
from sim import (
    HEXAPOD_MJCF,
    NOMINAL,
    Failure,
    ModelError,
    Plant,
    Pose,
    jacobians,
    linearize,
    load_model,
)
from sim.mjcf import element_id, mass_matrix, model_sha256
from sim.plant import failed_plant
from tests.hostile import Target, refusals

NAN, INF = np.nan, np.inf
GOOD: dict[Any, dict[str, Any]] = {
    Amplifier: {"bits": 16, "full_input_a": 4.0, "limit_a": 3.0, "newton_per_a": 20.0}
    | {"newton_per_m": 1e5},
    Coils: {"resistance_ohm": 5.0, "heat_capacity_j_per_k": 4.0, "ambient_c": 20.0}
    | {"thermal_resistance_k_per_w": [1.5, 2.2]},
    Detector: {"focal_length_m": 1.0, "half_width_m": 5e-3, "noise_m": 3e-7},
    StrutSensors: {"noise_m": 1e-9},
    Failure: {"actuator": 0, "kind": "weak", "time_s": 0.0, "effectiveness": 0.5},
    Pose: {"rotation": np.eye(3), "translation_m": np.zeros(3)},
    Hexapod: {"bottom_m": np.ones((6, 3)), "top_m": np.zeros((6, 3))},
    spiral: {"time_s": np.arange(3.0), "radius_rad": 1e-4, "turns": 8, "duration_s": 16.0},
}
"""Good arguments of each part of a bench."""
NO_PART = [
    (Amplifier, "bits", [0, 1, 54, 99999, 16.0, True, -16, None]),
    (Amplifier, "full_input_a", [0.0, -4.0, NAN, INF, "4"]),
    (Amplifier, "limit_a", [0.0, -3.0, NAN]),
    (Amplifier, "newton_per_a", [0.0, -20.0, 1e-310]),
    (Amplifier, "newton_per_m", [0.0, -1e5, INF]),
    (Coils, "resistance_ohm", [0.0, -5.0, NAN]),
    (Coils, "heat_capacity_j_per_k", [0.0, -4.0]),
    (Coils, "thermal_resistance_k_per_w", [[1.5, 0.0], [-1.5], [NAN], 1.5, [[1.5]], None]),
    (Coils, "ambient_c", [NAN, INF, None, [20.0]]),
    (Detector, "focal_length_m", [0.0, -1.0, NAN]),
    (Detector, "half_width_m", [NAN, 0.0, -5e-3, INF]),
    (Detector, "noise_m", [-3e-7, NAN]),
    (StrutSensors, "noise_m", [-1e-9, NAN, INF]),
    (Failure, "actuator", [-1, 0.5, True, None]),
    (Failure, "kind", ["broken"]),
    (Failure, "time_s", [-1.0, NAN, INF, "soon"]),
    (Failure, "effectiveness", [-0.1, 1.1, NAN, None]),
    (Pose, "rotation", [np.eye(2), np.full((3, 3), NAN), None]),
    (Pose, "translation_m", [np.zeros(2), np.full(3, INF), 0.0]),
    (Hexapod, "bottom_m", [np.ones((5, 3)), np.full((6, 3), NAN), np.ones((2, 6, 3))]),
    (Hexapod, "top_m", [np.ones((6, 2)), None]),
    (spiral, "time_s", [0.0, [NAN], [[0.0]], [-1.0]]),
    (spiral, "exponent", [0.0, -0.5, 2.0, NAN, None]),
    (spiral, "turns", [NAN, "8"]),
    (spiral, "duration_s", [0.0, -16.0, NAN, INF]),
]
"""A part, the name of an argument, and values that none has."""

MODEL = load_model()
MACHINE = hexapod(MODEL)


def fresh(method: str, **good: Any) -> Target:
    """A method of a plant, a new one for each call."""
    return Target(lambda **given: getattr(Plant(MODEL), method)(**given), good)


def read(rotation: np.ndarray) -> np.ndarray:
    """What a detector sees of a payload."""
    return Detector(**GOOD[Detector]).read(rotation, np.random.default_rng(0))


NOT_FINITE = [np.where(np.arange(9).reshape(3, 3) == 5, x, np.eye(3)) for x in (INF, -INF, NAN)]
NO_ROTATION = [np.zeros((3, 3)), 2 * np.eye(3), -np.eye(3)]
EDGE_ON = Rotation.from_rotvec([np.pi / 2, 0, 0]).as_matrix().round()
TURNED = [
    Target(secondary_motion, {"rotation": np.eye(3), "translation_m": np.zeros(3)}),
    Target(pointing_angles, {"rotation": np.eye(3)}),
    Target(read, {"rotation": np.eye(3)}),
]
COILS = Coils(**GOOD[Coils])
WARMED = [Target(COILS.step, {"temperature_c": COILS.cold(), "period_s": 1e3})]
POSED = [Target(ask, {"pose": NOMINAL}) for ask in (MACHINE.posture, MACHINE.inverse_jacobian)]
ON_ITS_NODE = Pose(np.eye(3), MACHINE.bottom_m[0] - MACHINE.top_m[0])
FAILED = [fresh("lock"), fresh("release"), fresh("break_loose"), fresh("weaken", effectiveness=0.5)]
OTHER_DATA = mujoco.MjData(load_model(HEXAPOD_MJCF.with_name("arm.xml")))
LINEAR = [
    Target(ask, {"model": MODEL, "data": mujoco.MjData(MODEL)} | more)
    for ask, more in ((mass_matrix, {}), (jacobians, {"site": "payload"}), (linearize, {}))
]
NAMED = [Target(element_id, {"model": MODEL, "kind": "site", "name": "base"})]
SENSED = [Target(StrutSensors(0.0).read, {"displacement_m": np.zeros(6)})]
NO_PERIOD = [0.0, -1e-3, NAN, INF, 1e160, 1e9, None, "1"]
STRANGE: Any = object()
TABLE = [
    *(([Target(what, GOOD[what])], name, bad, f"^{name} must ") for what, name, bad in NO_PART),
    (FAILED, "actuator", [-1, 6, 0.0, True, None, "0", [0]], "^actuator must"),
    # `secondary_motion` of infinity did not return, and all others gave NaN.
    (TURNED, "rotation", NOT_FINITE, "rotation must be finite"),
    (TURNED[:1], "rotation", NO_ROTATION, "rotation must hold orthonormal axes"),
    (TURNED[2:], "rotation", [EDGE_ON], "rotation must not put the payload at right angles"),
    (WARMED, "current_a", [np.full(2, 1e4)], "current_a must leave temperatures finite"),
    (POSED, "pose", [ON_ITS_NODE], "pose must leave every strut a length"),
    ([fresh("step", command_m=np.zeros(6))], "period_s", NO_PERIOD, "^period_s must"),
    ([fresh("settle")], "seconds", NO_PERIOD, "^(period_s|seconds) must"),
    # MuJoCo would read past its end.
    (LINEAR, "data", [OTHER_DATA], "data must be of this model"),
    (NAMED, "kind", ["opt"], "^kind must be "),
]
"""What is called, with which arguments in place of good ones, and what the sentence says."""
NO_WORDS = [None, ["weak"], np.array(["weak", "free"])]
OF_ANOTHER_KIND = [
    ([Target(Failure, GOOD[Failure])], "kind", NO_WORDS, "^kind must "),
    ([Target(Plant, {})], "model", [STRANGE], "^model must be "),
    (NAMED, "model", [STRANGE], "^model must be "),
    (NAMED, "kind", [STRANGE], "^kind must be "),
    (LINEAR[:1], "data", [STRANGE], "^data must be "),
    (LINEAR[1:2], "site", [STRANGE], "^site must be "),
    (POSED[:1], "pose", [STRANGE], "^pose must be "),
    ([Target(Failure(0, "free").strike, {})], "plant", [STRANGE], "^plant must be "),
    ([Target(failed_plant, {"model": MODEL})], "failures", [STRANGE], "^failures must be "),
    (SENSED, "rng", [STRANGE], "^rng must be "),
    ([Target(load_model, {})], "path", [STRANGE], "^path must be "),
]
"""The same, with things that are not even of the kind of a good one."""


@pytest.mark.parametrize(
    ("target", "name", "value", "error", "said"),
    [*refusals(ValueError, TABLE), *refusals(TypeError, OF_ANOTHER_KIND)],
)
def test_what_no_bench_is_is_refused_by_name(target, name, value, error, said):
    with pytest.raises(error, match=said) as refusal:
        target.call(**(target.good | {name: value}))
    assert refusal.type is error  # and no subclass


@pytest.mark.parametrize("part", GOOD)
def test_a_part_of_good_numbers_is_made(part):
    part(**GOOD[part])


@pytest.mark.parametrize("effectiveness", [-1.0, 5.0, 1.0001, NAN, INF, None, [0.5]])
def test_a_coil_is_neither_reversed_nor_made_stronger(model, effectiveness):
    """-1 turned its force about, 5 made it five times as strong."""
    plant = Plant(model)
    with pytest.raises(ValueError, match=r"^effectiveness must"):
        plant.weaken(1, effectiveness)
    np.testing.assert_array_equal(plant.model.actuator_gainprm, model.actuator_gainprm)


def test_one_twist_moves_a_batch_of_poses_as_it_moves_each():
    """It turned the batch inside out, (3, B, 3) for (B, 3, 3)."""
    many = NOMINAL.moved(np.random.default_rng(0).normal(size=(4, 6)))
    twist = np.array([0.1, -0.2, 0.3, 1.0, 2.0, 3.0])
    moved = many.moved(twist)
    for k in range(4):
        alone = Pose(many.rotation[k], many.translation_m[k]).moved(twist)
        np.testing.assert_allclose(moved.rotation[k], alone.rotation, atol=1e-15)
        np.testing.assert_allclose(moved.translation_m[k], alone.translation_m)


def test_a_geared_coil_moves_its_strut_as_far_as_commanded(model):
    """With gear 2 the strut would move twice as far if the control were the displacement."""
    geared = copy.copy(model)
    geared.actuator_gear[2, 0] = 2.0
    plant, command = Plant(geared), np.full(6, 1e-5)
    plant.settle(1.0, command)
    np.testing.assert_allclose(plant.displacements(), command, rtol=5e-3)
    assert jacobians(geared, mujoco.MjData(geared), "payload").gear[2] == 2.0


@pytest.mark.parametrize("path", ["nowhere.xml", "x" * 5000, "a\0b", ""])
@pytest.mark.parametrize("read", [load_model, model_sha256])
def test_a_file_that_cannot_be_is_one_sentence_for_model_and_hash(read, path):
    with pytest.raises(ModelError, match="there is no MJCF or URDF file"):
        read(path)
