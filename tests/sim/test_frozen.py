"""What is frozen in `sim` is frozen: no array can be written to, by whoever made or got it."""

import dataclasses

import mujoco
import numpy as np
import pytest

import sim
from fjh.rig.hexapod import closed_form
from fjh.rig.hexapod.coil import Coils
from sim import NOMINAL, Bench, Plant, Pose
from sim.plant import MaxwellSlip, Reading, TaskSensor
from tests.frozen import writable

MODEL = sim.load_model()
DATA, MACHINE = mujoco.MjData(MODEL), closed_form.hexapod(MODEL)
POSTURE, POSE = MACHINE.posture(NOMINAL), {"rotation": np.eye(3), "translation_m": np.zeros(3)}
COILS = {"resistance_ohm": 5.0, "heat_capacity_j_per_k": 4.0, "ambient_c": 20.0}
COILS |= {"thermal_resistance_k_per_w": np.full(2, 1.5)}
MADE = {
    sim.Pose: POSE,
    closed_form.Posture: POSE | {"displacement_m": np.zeros(6), "inverse_jacobian": np.eye(6)},
    closed_form.Hexapod: {"bottom_m": MACHINE.bottom_m, "top_m": MACHINE.top_m},
    Coils: COILS,
    MaxwellSlip: {"stiffness": np.ones((2, 3)), "slip": np.ones((2, 3))},
}
"""Records that anybody can make, and of what."""
GIVEN = {
    "pose": Plant(MODEL).pose(),
    "pose moved": NOMINAL.moved(np.ones(6)),
    "posture": POSTURE,
    "posture moved": MACHINE.moved(NOMINAL, np.full(6, 1e-5)),
    "jacobians": sim.jacobians(MODEL, DATA, "payload", "base"),
    "joint posture": sim.Mechanism(sim.load_model(sim.MODELS / "arm.xml")).nominal,
    "linear plant": Plant(MODEL).linear(),
    "ranges": sim.ranges(MODEL),
}
"""Records that the package makes."""
TICKS = 3


def test_every_record_with_arrays_is_made_or_given():
    """A new one is added above."""
    known = {*MADE, *map(type, GIVEN.values())}
    frozen = [
        each
        for each in vars(sim).values()
        if isinstance(each, type)
        and dataclasses.is_dataclass(each)
        and not issubclass(each, sim.TaskFunction)  # its target may be set
        and any("Array" in str(field.type) for field in dataclasses.fields(each))
    ]
    assert set(frozen) - known == set()


@pytest.mark.parametrize("kind", MADE)
def test_a_record_does_not_change_with_what_it_was_made_of(kind):
    given = {
        name: value.copy() if isinstance(value, np.ndarray) else value
        for name, value in MADE[kind].items()
    }
    record = kind(**given)
    assert list(writable(sim, kind.__name__, record)) == []
    for name, value in given.items():
        if isinstance(value, np.ndarray):
            before = getattr(record, name).copy()
            value[...] = 7  # and it can be: it is the caller's own
            np.testing.assert_array_equal(getattr(record, name), before)


@pytest.mark.parametrize("record", GIVEN)
def test_a_record_that_is_given_cannot_be_written_to(record):
    assert list(writable(sim, record, GIVEN[record])) == []


def test_a_bench_does_not_change_with_what_it_was_made_of():
    """Times that were moved made a failure strike at once."""
    time_s, floor = 2e-3 * np.arange(float(TICKS)), np.zeros((TICKS, 3))
    bench = Bench(
        Plant(MODEL),
        TaskSensor([0, 1], 0.0, 0.0, 0),
        time_s=time_s,
        period_s=2e-3,
        failures=[sim.Failure(0, "loose", 1.0)],
        floor_m_per_s2=floor,
    )
    time_s[:], floor[:] = 9.0, 9.0
    for _ in range(TICKS):
        bench.measure()
        bench.apply(np.zeros(6))
    undisturbed = Plant(MODEL)
    undisturbed.step(np.zeros(6), (TICKS - 1) * 2e-3)
    np.testing.assert_allclose(bench.displacement[-1], undisturbed.displacements(), atol=1e-12)


def test_a_sensor_cannot_change_the_log():
    class Greedy:
        def read(self, pose: Pose, displacements: np.ndarray) -> Reading:
            pose.rotation[:] = 0.0
            return Reading(displacements, displacements)

    bench = Bench(Plant(MODEL), Greedy(), time_s=np.zeros(1), period_s=2e-3)
    with pytest.raises(ValueError, match="read-only"):
        bench.measure()
