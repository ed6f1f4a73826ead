"""Wrong input that would pass for numbers raises and says what it must be.

All else that is hostile is in `test_hostile.py`.
"""

import copy
from typing import Any

import mujoco
import numpy as np
import pytest

from sim import (
    MODELS,
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

NO_ACTUATOR = (-1, 6, 0.0, True, [0])
STRANGE: Any = object()
WORDS: Any = np.array(["weak", "free"])
TABLE = [
    (Failure, "actuator", (-1, 0.5, True)),
    (Failure, "kind", ("broken",)),
    (Failure, "time_s", (-1.0,)),
    (Pose, "rotation", (np.eye(2),)),
    (Pose, "translation_m", (np.zeros(2), 0.0)),
    *((method, "actuator", NO_ACTUATOR) for method in ("lock", "release", "break_loose", "weaken")),
    # -1 turned its force about, 5 made it five times as strong.
    ("weaken", "effectiveness", (-1.0, 5.0, 1.0001)),
    ("step", "period_s", (1e9,)),
    ("settle", "seconds|period_s", (1e9,)),
]
GOOD = {
    Failure: {"actuator": 0, "kind": "weak"},
    Pose: {"rotation": np.eye(3), "translation_m": np.zeros(3)},
    "weaken": {"actuator": 0, "effectiveness": 0.5},
    "step": {"command_m": np.zeros(6)},
}


@pytest.mark.parametrize(("what", "name", "values"), TABLE)
def test_wrong_numbers_are_refused_by_name(model, what, name, values):
    for value in values:
        plant = Plant(model)
        call = getattr(plant, what) if isinstance(what, str) else what
        with pytest.raises(ValueError, match=f"^({name}) must") as refusal:
            call(**(GOOD.get(what, {}) | {name.split("|")[0]: value}))
        assert refusal.type is ValueError  # and no subclass
        np.testing.assert_array_equal(plant.model.actuator_gainprm, model.actuator_gainprm)


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("kind", lambda model: Failure(0, STRANGE)),
        ("kind", lambda model: Failure(0, WORDS)),
        ("kind", lambda model: element_id(model, STRANGE, "base")),
        ("model", lambda model: Plant(STRANGE)),
        ("data", lambda model: mass_matrix(model, STRANGE)),
        ("site", lambda model: jacobians(model, mujoco.MjData(model), STRANGE)),
        ("plant", lambda model: Failure(0, "free").strike(STRANGE)),
        ("failures", lambda model: failed_plant(model, STRANGE)),
        ("path", lambda model: load_model(STRANGE)),
    ],
)
def test_what_is_of_another_kind_is_a_type_error(model, name, call):
    with pytest.raises(TypeError, match=f"^{name} must be ") as refusal:
        call(model)
    assert refusal.type is TypeError


def test_data_of_another_model_are_refused(model):
    """MuJoCo would read past their end."""
    data = mujoco.MjData(load_model(MODELS / "arm.xml"))
    for ask in (mass_matrix, linearize, jacobians):
        site: dict[str, Any] = {"site": "payload"} if ask is jacobians else {}
        with pytest.raises(ValueError, match="data must be of this model"):
            ask(model, data, **site)


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
