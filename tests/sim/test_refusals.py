"""Wrong input that would pass for numbers raises; all else that is hostile: `test_hostile.py`."""

from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest

from sim import MODELS, Failure, ModelError, Plant, jacobians, linearize, load_model
from sim.mjcf import mass_matrix, model_sha256


@pytest.mark.parametrize("actuator", [-1, 6, 0.0, True, [0]])
def test_what_is_no_actuator_fails_none(model, actuator):
    plant = Plant(model)
    weaken: Any = partial(plant.weaken, effectiveness=0.5)
    for fail in (plant.lock, plant.release, plant.break_loose, weaken):
        with pytest.raises(ValueError, match=r"^actuator must"):
            fail(actuator)
    np.testing.assert_array_equal(plant.model.actuator_gainprm, model.actuator_gainprm)


def test_what_is_no_failure_is_refused_by_name():
    wrongs: list[dict[str, Any]] = [{"actuator": -1}, {"time_s": -1.0}, {"kind": "broken"}]
    for wrong in wrongs:
        with pytest.raises(ValueError, match=f"^{next(iter(wrong))} must"):
            Failure(**{"actuator": 0, "kind": "weak"} | wrong)


def test_data_of_another_model_are_refused(model):
    """MuJoCo would read past their end."""
    data = mujoco.MjData(load_model(MODELS / "arm.xml"))
    for ask in (mass_matrix, linearize, jacobians):
        site: dict[str, Any] = {"site": "payload"} if ask is jacobians else {}
        with pytest.raises(ValueError, match="data must be of this model"):
            ask(model, data, **site)


@pytest.mark.parametrize("path", ["nowhere.xml", "x" * 5000, "a\0b", ""])
@pytest.mark.parametrize("read", [load_model, model_sha256])
def test_a_file_that_cannot_be_is_one_sentence_for_model_and_hash(read, path):
    with pytest.raises(ModelError, match="there is no MJCF or URDF file"):
        read(path)


def test_states_and_tasks_that_are_none_are_refused(model):
    data = mujoco.MjData(model)
    with pytest.raises(ValueError, match="site must not repeat a task"):
        jacobians(model, data, site=["payload", "payload"])
    data.qpos[0] = np.nan
    with pytest.raises(ValueError, match=r"data\.qpos must be finite"):
        jacobians(model, data, site="payload")
