"""Records of `sim` have read-only arrays."""

import copy
import dataclasses
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

import sim
from fjh.rig.hexapod import closed_form
from fjh.rig.hexapod.coil import Coils
from sim import NOMINAL, Mechanism, Plant
from sim.plant import MaxwellSlip
from tests.frozen import writable

POSE = {"rotation": np.eye(3), "translation_m": np.zeros(3)}
MADE: dict[type, dict[str, Any]] = {
    sim.Pose: POSE,
    closed_form.Posture: POSE | {"displacement_m": np.zeros(6), "inverse_jacobian": np.eye(6)},
    closed_form.Hexapod: {"bottom_m": np.eye(6)[:, :3], "top_m": np.eye(6)[:, :3] + 1.0},
    Coils: {"resistance_ohm": 5.0, "heat_capacity_j_per_k": 4.0, "ambient_c": 20.0}
    | {"thermal_resistance_k_per_w": np.full(2, 1.5)},
    MaxwellSlip: {"stiffness": np.ones((2, 3)), "slip": np.ones((2, 3))},
}
"""Public record classes, with their arguments."""


@cache
def given() -> list[Any]:
    """Create the records that the package returns."""
    model = sim.load_model()
    machine = closed_form.hexapod(model)
    return [
        Plant(model).pose(),
        NOMINAL.moved(np.ones(6)),
        machine.posture(NOMINAL),
        machine.moved(NOMINAL, np.full(6, 1e-5)),
        sim.jacobians(model, mujoco.MjData(model), "payload", "base"),
        Mechanism(model, site="payload").nominal,
        Plant(model).linear(),
        sim.ranges(model),
    ]


def test_every_record_with_arrays_is_listed_and_cannot_be_written_to():
    for record in given():
        assert list(writable(sim, type(record).__name__, record)) == []
    frozen = {
        record
        for record in vars(sim).values()
        if isinstance(record, type)
        and dataclasses.is_dataclass(record)
        and not issubclass(record, sim.TaskFunction)  # its target may be set
        and any("Array" in str(field.type) for field in dataclasses.fields(record))
    }
    assert frozen - {*MADE, *map(type, given())} == set()


@pytest.mark.parametrize("kind", MADE)
def test_a_record_does_not_change_with_its_arguments(kind):
    mine = copy.deepcopy(MADE[kind])
    record = kind(**mine)
    assert list(writable(sim, kind.__name__, record)) == []
    for name, value in mine.items():
        if isinstance(value, np.ndarray):
            before = getattr(record, name).copy()
            value[...] = 7  # it can be, as the caller owns it
            np.testing.assert_array_equal(getattr(record, name), before)
