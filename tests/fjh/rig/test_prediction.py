"""The linear prediction of a run at each tick, and its limits."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from fjh.rig.dither import rig_dither
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.machine import floor_acceleration
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import TestbedConfig
from sim import Failure
from tests.fjh.rigs import FAILED_S, path_of, rig_of, shared_rig

W_A, W_D = COLUMNS[0].goal, COLUMNS[3].goal
LOCK = (Failure(0, "locked"),)
BENCH = TestbedConfig(dac_bits=32)
"""Bench whose converters hardly quantize; 16 bits leave 0.02 urad RMS."""
LIMITED = replace(BENCH, demand_limit_urad=20.0)
OFF_M, SPREAD_M = -2e-5 * np.eye(6)[0], np.linspace(-1e-5, 2e-5, 6)
OFF_CENTRE = replace(W_D, locked_at={0: OFF_M[0]})
FLOOR = floor_acceleration(500, BENCH.control_period_s, 50e-6, [7])


SETTINGS: dict[str, dict[str, Any]] = {
    "healthy": {},
    "lock known": {"goal": W_D, "failures": LOCK},
    "lock unknown": {"failures": LOCK},
    "lock on the way": {"failures": (Failure(0, "locked", 0.25),)},
    "free on the way": {"failures": (Failure(0, "free", 0.25),)},
    "floor": {"floor": FLOOR},
    "floor and lock": {"floor": FLOOR, "failures": LOCK},
    "off centre": {"start": SPREAD_M},
    "lock off centre known": {"goal": OFF_CENTRE, "failures": LOCK, "start": OFF_M},
    "limit": {"bench": LIMITED},
    "limit and lock": {"bench": LIMITED, "failures": LOCK},
    "limit without windup": {"bench": replace(LIMITED, anti_windup=True), "failures": LOCK},
}
IN_SHORT = ("healthy", "lock known", "lock on the way", "floor", "off centre", "limit and lock")


@pytest.mark.parametrize(
    "name",
    [each if each in IN_SHORT else pytest.param(each, marks=pytest.mark.long) for each in SETTINGS],
)
def test_the_linear_model_predicts_every_tick_of_a_run(name):
    """The tolerance is 0.01 urad for errors up to 50 urad; 0.006 urad was the largest measured."""
    usual = {"bench": BENCH, "goal": W_A, "failures": (), "start": None, "floor": None}
    bench, goal, failures, start, floor = (usual | SETTINGS[name]).values()
    rig = hexapod_rig(nominal_testbed(bench), goal, start_m=start, floor_m_per_s2=floor)
    path = BENCH.spiral_rad(0.5 if bench is BENCH else 1.0, begin_s=8.0)
    run = rig.fly(rig.controller(), path, failures=failures, seed=2)
    how = {"failures": failures, "start": start, "floor_m_per_s2": floor}
    prediction = rig.predict(path, told=False, noise=run.measured - run.true, **how)
    assert np.abs(run.error - prediction.error).max() < 1e-8
    np.testing.assert_allclose(prediction.rms, run.rms(), rtol=1e-3)


@pytest.mark.parametrize("kind", ["locked", "free", "weak"])
def test_the_prediction_of_an_uninformed_controller_equals_its_run(kind):
    """MuJoCo and the linear model with that fault are independent computations."""
    rig, path = shared_rig("platform"), path_of("platform", 1.2)
    failures = [Failure(rig.actuators[1], kind, FAILED_S)]
    run = rig.fly(rig.controller(), path, failures=failures)
    predicted = rig.predict(path, failures=failures, noise=run.measured - run.true, told=False)
    cut = round(FAILED_S / rig.period_s)
    for part, rms in ((slice(cut), "rms_before"), (slice(cut, None), "rms_after")):
        expected = np.linalg.norm(getattr(predicted, rms))
        assert np.linalg.norm(run.rms(part)) == pytest.approx(expected, rel=0.1)


@pytest.mark.long
def test_errors_with_dry_friction_are_as_predicted_before_and_after_a_lock():
    """Friction is most of the error; without it the prediction is far off."""
    rig, cut = rig_of("rubbing_arm", major=(3, 5)), 500
    path, lock = rig.path("circle", duration_s=1.0, turn_s=1.0), [Failure("elbow", "locked", 0.5)]
    run = rig.fly(rig.controller(), path, failures=lock)
    predicted = rig.predict(path, failures=lock, told=False)
    np.testing.assert_allclose(run.rms(slice(cut)), predicted.rms_before, rtol=0.02)
    np.testing.assert_allclose(run.rms(slice(cut, None)), predicted.rms_after, rtol=0.05)


@pytest.mark.long
def test_late_information_is_predicted_between_onset_and_never():
    """Informed at onset and never are the limits, exactly; with a dither as well."""
    rig, path = shared_rig("platform"), path_of("platform", 1.2)
    failures = [Failure(1, "locked", FAILED_S), Failure(2, "weak", 0.3)]
    design = rig_dither(rig, "default")
    assert design is not None
    for dither in (None, design.dither):
        of = partial(rig.predict, path, failures=failures, dither=dither)
        errors = {known: np.linalg.norm(of(told=known).rms_after) for known in (True, False)}
        assert np.linalg.norm(of(told=[FAILED_S, 0.3]).rms_after) == errors[True]
        assert np.linalg.norm(of(told=[None, None]).rms_after) == errors[False]
        late = [np.linalg.norm(of(told=[t, None]).rms_after) for t in (0.55, 0.7, 0.9)]
        assert errors[True] < late[0] < late[1] < late[2] < errors[False]


@pytest.mark.long
def test_a_supervisor_that_identifies_a_free_actuator_continues_as_predicted():
    """Closed loops carry the free actuator from its diagnosis on, without a jump."""
    rig, path, failures = shared_rig("hand"), path_of("hand", 2.4), [Failure(0, "free", 1.2)]
    dither = rig_dither(rig, "default")
    assert dither is not None
    run = rig.fly(rig.supervisor(dither.dither), path, failures=failures)
    (diagnosis,) = run.diagnoses
    assert (diagnosis.actuator, diagnosis.kind) == (rig.actuators[0], "free")
    informed = rig.predict(path, failures=failures, told=[diagnosis.time_s], dither=dither.dither)
    after = np.linalg.norm(run.rms(slice(round(1.2 / rig.period_s), None)))
    assert after == pytest.approx(np.linalg.norm(informed.rms_after), rel=0.1)


def test_two_failures_of_one_tick_both_change_the_plant_in_either_order():
    rig, path = shared_rig("platform"), path_of("platform", 0.8)
    locks = [Failure(1, "locked", FAILED_S), Failure(2, "free", FAILED_S)]
    forward, other, single = (
        rig.predict(path, failures=f, told=False).rms_after for f in (locks, locks[::-1], locks[:1])
    )
    np.testing.assert_array_equal(forward, other)
    assert np.abs(forward - single).max() > 0.01 * np.abs(single).max()


def test_nothing_is_predicted_after_a_loose_strut_leaves_its_range():
    rig, path = shared_rig("hexapod"), path_of("hexapod", 0.6)
    failures = [Failure("strut1", "loose", 0.1)]
    run = rig.fly(rig.controller(), path, failures=failures)
    assert np.abs(run.displacement[:, 0]).max() > 0.99 * rig.travel[1][0]  # at its stop
    for known in (True, False):
        predicted = rig.predict(path, failures=failures, told=known)
        assert predicted.leaves == "strut1"
        assert np.isnan(predicted.rms_after).all() and np.isfinite(predicted.rms_before).all()


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "platform", "hexapod"])
def test_the_default_dither_moves_the_task_by_less_than_half_the_noise(name):
    design = rig_dither(shared_rig(name), "default")
    assert design is not None and design.separations.isolable()
    assert design.dither.frequency_hz in (10.0, 20.0)
    assert design.task_motion.max() <= 0.5 * shared_rig(name).noise * (1 + 1e-9)
