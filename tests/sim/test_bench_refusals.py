"""What no bench is, is refused by name: numbers that were once accepted, or came back as NaN."""

import copy
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import (
    HEXAPOD_MJCF,
    NOMINAL,
    Amplifier,
    Coils,
    Detector,
    Failure,
    Hexapod,
    Jacobians,
    ModelError,
    Plant,
    Pose,
    StrutSensors,
    element_id,
    failed_plant,
    hexapod,
    jacobians,
    linearize,
    load_model,
    mass_matrix,
    model_sha256,
    pointing_angles,
    secondary_motion,
    spiral,
)

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
    Jacobians: {"J_T": np.ones((6, 2)), "J_C": np.zeros((0, 2)), "active": [1], "gear": [1.0]},
    spiral: {"time_s": np.arange(3.0), "radius_rad": 1e-4, "turns": 8, "duration_s": 16.0},
}


@pytest.mark.parametrize(
    ("what", "name", "values"),
    [
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
        (Failure, "kind", ["broken", None, ["weak"], np.array(["weak", "free"])]),
        (Failure, "time_s", [-1.0, NAN, INF, "soon"]),
        (Failure, "effectiveness", [-0.1, 1.1, NAN, None]),
        (Pose, "rotation", [np.eye(2), np.full((3, 3), NAN), None]),
        (Pose, "translation_m", [np.zeros(2), np.full(3, INF), 0.0]),
        (Hexapod, "bottom_m", [np.ones((5, 3)), np.full((6, 3), NAN), np.ones((2, 6, 3))]),
        (Hexapod, "top_m", [np.ones((6, 2)), None]),
        (Jacobians, "J_C", [np.zeros((1, 3)), [[NAN, 0.0]]]),
        (Jacobians, "active", [[2], [-1], [0.5]]),
        (Jacobians, "gear", [[0.0], [1.0, 1.0], [NAN]]),
        (spiral, "time_s", [0.0, [NAN], [[0.0]], [-1.0]]),
        (spiral, "exponent", [0.0, -0.5, 2.0, NAN, None]),
        (spiral, "turns", [NAN, "8"]),
        (spiral, "duration_s", [0.0, -16.0, NAN, INF]),
    ],
)
def test_a_part_that_none_has_is_refused_when_it_is_made(what, name, values):
    what(**GOOD[what])
    for value in values:
        with pytest.raises((ValueError, TypeError), match=rf"^{name} must "):
            what(**(GOOD[what] | {name: value}))


@pytest.mark.parametrize("effectiveness", [-1.0, 5.0, 1.0001, NAN, INF, None, [0.5]])
def test_a_coil_is_neither_reversed_nor_made_stronger(model, effectiveness):
    """-1 turned its force about, 5 made it five times as strong."""
    plant = Plant(model)
    with pytest.raises(ValueError, match=r"^effectiveness must"):
        plant.weaken(1, effectiveness)
    np.testing.assert_array_equal(plant.model.actuator_gainprm, model.actuator_gainprm)


@pytest.mark.parametrize("strut", [-1, 6, 0.0, True, None, "0", [0]])
def test_a_strut_is_one_of_the_six_by_its_number(model, strut):
    plant = Plant(model)
    for fail in (plant.lock, plant.release, plant.break_loose, lambda k: plant.weaken(k, 0.5)):
        with pytest.raises(ValueError, match=r"^actuator must"):
            fail(strut)


@pytest.mark.parametrize("bad", [INF, -INF, NAN])
def test_a_rotation_that_is_not_finite_is_refused_at_once(bad):
    """`secondary_motion` of infinity did not return, and all others gave NaN."""
    rotation = np.eye(3)
    rotation[1, 2] = bad
    detector = Detector(**GOOD[Detector])
    for read in (
        lambda: secondary_motion(rotation, np.zeros(3)),
        lambda: pointing_angles(rotation),
        lambda: detector.read(rotation, np.random.default_rng(0)),
    ):
        with pytest.raises(ValueError, match="rotation must be finite"):
            read()


@pytest.mark.parametrize("strange", [np.zeros((3, 3)), 2 * np.eye(3), -np.eye(3)])
def test_an_angle_about_z_b_is_that_of_a_rotation(strange):
    with pytest.raises(ValueError, match="rotation must hold orthonormal axes"):
        secondary_motion(strange, np.zeros(3))


def test_a_payload_at_right_angles_to_the_beam_has_no_spot():
    edge_on = Rotation.from_rotvec([np.pi / 2, 0, 0]).as_matrix().round()
    with pytest.raises(ValueError, match="rotation must not put the payload at right angles"):
        Detector(**GOOD[Detector]).read(edge_on, np.random.default_rng(0))


def test_a_coil_that_runs_away_is_refused_before_its_temperature_is_infinite():
    coils = Coils(**GOOD[Coils])
    with pytest.raises(ValueError, match="current_a must leave temperatures finite"):
        coils.step(coils.cold(), np.full(2, 1e4), 1e3)


def test_one_twist_moves_a_batch_of_poses_as_it_moves_each():
    """It turned the batch inside out, (3, B, 3) for (B, 3, 3)."""
    many = NOMINAL.moved(np.random.default_rng(0).normal(size=(4, 6)))
    twist = np.array([0.1, -0.2, 0.3, 1.0, 2.0, 3.0])
    moved = many.moved(twist)
    for k in range(4):
        alone = Pose(many.rotation[k], many.translation_m[k]).moved(twist)
        np.testing.assert_allclose(moved.rotation[k], alone.rotation, atol=1e-15)
        np.testing.assert_allclose(moved.translation_m[k], alone.translation_m)


def test_a_pose_where_a_strut_has_no_length_has_no_jacobian(model):
    machine = hexapod(model)
    on_its_node = Pose(np.eye(3), machine.bottom_m[0] - machine.top_m[0])
    for ask in (machine.posture, machine.inverse_jacobian):
        with pytest.raises(ValueError, match="pose must leave every strut a length"):
            ask(on_its_node)


@pytest.mark.parametrize("period_s", [0.0, -1e-3, NAN, INF, 1e160, 1e9, None, "1"])
def test_a_period_is_positive_and_one_that_can_end(model, period_s):
    plant = Plant(model)
    for go in (lambda: plant.step(np.zeros(6), period_s), lambda: plant.settle(period_s)):
        with pytest.raises(ValueError, match=r"^(period_s|seconds) must"):
            go()


def test_a_geared_coil_moves_its_strut_as_far_as_commanded(model):
    """With gear 2 the strut would move twice as far if the control were the displacement."""
    geared = copy.copy(model)
    geared.actuator_gear[2, 0] = 2.0
    plant, command = Plant(geared), np.full(6, 1e-5)
    plant.settle(1.0, command)
    np.testing.assert_allclose(plant.displacements(), command, rtol=5e-3)
    assert jacobians(geared, mujoco.MjData(geared), "payload").gear[2] == 2.0


def test_a_state_of_another_model_is_refused_before_mujoco_reads_past_its_end(model):
    arm = load_model(HEXAPOD_MJCF.with_name("arm.xml"))
    for ask in (mass_matrix, lambda m, d: jacobians(m, d, "payload"), linearize):
        with pytest.raises(ValueError, match="data must be of this model"):
            ask(model, mujoco.MjData(arm))


def test_things_of_another_kind_are_refused_by_name(model):
    strange: Any = object()
    for name, call in (
        ("model", lambda: Plant(strange)),
        ("model", lambda: element_id(strange, "site", "base")),
        ("kind", lambda: element_id(model, strange, "base")),
        ("kind", lambda: element_id(model, "opt", "base")),
        ("data", lambda: mass_matrix(model, strange)),
        ("pose", lambda: hexapod(model).posture(strange)),
        ("plant", lambda: Failure(0, "free").strike(strange)),
        ("failures", lambda: failed_plant(model, strange)),
        ("rng", lambda: StrutSensors(0.0).read(np.zeros(6), strange)),
        ("path", lambda: load_model(strange)),
        ("site", lambda: jacobians(model, mujoco.MjData(model), strange)),
    ):
        with pytest.raises((ValueError, TypeError), match=f"^{name} must be "):
            call()


@pytest.mark.parametrize("path", ["nowhere.xml", "x" * 5000, "a\0b", ""])
def test_a_file_that_cannot_be_is_one_sentence_for_model_and_hash(path):
    for read in (load_model, model_sha256):
        with pytest.raises(ModelError, match="there is no MJCF file"):
            read(path)
