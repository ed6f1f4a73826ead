"""The one linear prediction of a run: what it says tick by tick, and what it cannot be asked."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from fjh.rig import Rig
from fjh.rig.dither import rig_dither
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.machine import floor_acceleration
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import TestbedConfig
from sim import Failure
from tests.fjh.rigs import FAILED_S, path_of, rig, rig_of

W_A, W_D = COLUMNS[0].goal, COLUMNS[3].goal
LOCK = (Failure(0, "locked"),)
BENCH = TestbedConfig(dac_bits=32)
"""Its converters hardly quantize; 16 bits leave 0.02 urad RMS."""
LIMITED = replace(BENCH, demand_limit_urad=20.0)
HELD = replace(LIMITED, anti_windup=True)
OFF_M, SPREAD_M = -2e-5 * np.eye(6)[0], np.linspace(-1e-5, 2e-5, 6)
FLOOR = floor_acceleration(500, BENCH.control_period_s, 50e-6, [7])


def hexapod(bench=BENCH, goal=W_A, start=None, floor=None, **_: Any) -> Rig:
    """The machine of a setting, and what its controller knows."""
    return hexapod_rig(nominal_testbed(bench), goal, start_m=start, floor_m_per_s2=floor)


def predicted(path, noise, failures=(), start=None, floor=None, **setting: Any) -> Any:
    """The prediction of a controller that learns of nothing in the run."""
    one = hexapod(start=start, floor=floor, **setting)
    how = {"failures": failures, "start": start, "floor_m_per_s2": floor}
    return one.predict(path, told=False, noise=noise, **how)


SETTINGS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "healthy": ({}, {"failures": LOCK}),
    "lock known": ({"goal": W_D, "failures": LOCK}, {"goal": W_A}),
    "lock unknown": ({"failures": LOCK}, {"failures": ()}),
    "lock on the way": ({"failures": (Failure(0, "locked", 0.25),)}, {"failures": LOCK}),
    "free on the way": ({"failures": (Failure(0, "free", 0.25),)}, {"failures": ()}),
    "floor": ({"floor": FLOOR}, {"floor": None}),
    "floor and lock": ({"floor": FLOOR, "failures": LOCK}, {"failures": ()}),
    "off centre": ({"start": SPREAD_M}, {"start": None}),
    "lock off centre known": (
        {"goal": replace(W_D, locked_at={0: OFF_M[0]}), "failures": LOCK, "start": OFF_M},
        {"goal": W_D},
    ),
    "limit": ({"bench": LIMITED}, {"bench": BENCH}),
    "limit and lock": ({"bench": LIMITED, "failures": LOCK}, {"bench": HELD}),
    "limit without windup": ({"bench": HELD, "failures": LOCK}, {"bench": LIMITED}),
}
"""Each with a difference that the prediction must notice."""
IN_SHORT = ("healthy", "lock known", "lock on the way", "floor", "off centre", "limit and lock")


@pytest.mark.parametrize(
    "name",
    [each if each in IN_SHORT else pytest.param(each, marks=pytest.mark.long) for each in SETTINGS],
)
def test_the_linear_model_predicts_every_tick_of_a_run(name):
    """Within 0.01 urad of MuJoCo, of errors up to 50 urad: 0.006 urad was measured at the most."""
    setting, other = SETTINGS[name]
    one, duration_s = hexapod(**setting), 1.0 if "bench" in setting else 0.5
    path = BENCH.spiral_rad(duration_s, begin_s=8.0)
    run = one.fly(one.controller(), path, failures=setting.get("failures", ()), seed=2)
    noise = run.measured - run.true
    found = predicted(path, noise, **setting)
    assert np.abs(run.error - found.error).max() < 1e-8
    np.testing.assert_allclose(found.rms, run.rms(), rtol=1e-3)
    wrong = predicted(path, noise, **setting | other)
    assert np.abs(run.error - wrong.error).max() > 1e-7


@pytest.mark.parametrize("kind", ["locked", "free", "weak"])
def test_the_prediction_of_a_controller_that_is_never_told_is_what_happens(kind):
    """Two independent computations: MuJoCo, and the linear model with that fault."""
    one, path = rig("platform"), path_of("platform", 1.2)
    failures = [Failure(one.actuators[1], kind, FAILED_S)]
    run = one.fly(one.controller(), path, failures=failures)
    predicted = one.predict(path, failures=failures, noise=run.measured - run.true, told=False)
    cut = round(FAILED_S / one.period_s)
    for part, rms in ((slice(cut), "rms_before"), (slice(cut, None), "rms_after")):
        expected = np.linalg.norm(getattr(predicted, rms))
        assert np.linalg.norm(run.rms(part)) == pytest.approx(expected, rel=0.1)


@pytest.mark.long
def test_where_joints_rub_errors_are_as_predicted_before_and_after_a_lock():
    """Friction is most of the error; without it the prediction is far off."""
    one, cut = rig_of("rubbing_arm", major=(3, 5)), 500
    path, lock = one.path("circle", duration_s=1.0, turn_s=1.0), [Failure("elbow", "locked", 0.5)]
    run = one.fly(one.controller(), path, failures=lock)
    predicted = one.predict(path, failures=lock, told=False)
    np.testing.assert_allclose(run.rms(slice(cut)), predicted.rms_before, rtol=0.02)
    np.testing.assert_allclose(run.rms(slice(cut, None)), predicted.rms_after, rtol=0.05)


@pytest.mark.long
def test_learning_late_is_predicted_between_at_once_and_never():
    """At once and never are its limits, exactly; with a dither, too, which then costs more."""
    one, path = rig("platform"), path_of("platform", 1.2)
    failures = [Failure(1, "locked", FAILED_S), Failure(2, "weak", 0.3)]
    design = rig_dither(one, "default")
    assert design is not None
    for dither in (None, design.dither):
        of = partial(one.predict, path, failures=failures, dither=dither)
        whole = {told: np.linalg.norm(of(told=told).rms_after) for told in (True, False)}
        assert np.linalg.norm(of(told=[FAILED_S, 0.3]).rms_after) == whole[True]
        assert np.linalg.norm(of(told=[None, None]).rms_after) == whole[False]
        late = [np.linalg.norm(of(told=[t, None]).rms_after) for t in (0.55, 0.7, 0.9)]
        assert whole[True] < late[0] < late[1] < late[2] < whole[False]


@pytest.mark.long
@pytest.mark.parametrize(("name", "kind"), [("hand", "free"), ("platform", "locked")])
def test_a_supervisor_that_names_a_failure_goes_on_as_predicted(name, kind):
    """From the tick at which it named it: closed loops carry what is free, and nothing jumps."""
    one, path = rig(name), path_of(name, 2.4)
    dither = rig_dither(one, "default")
    assert dither is not None
    failures = [Failure(0, kind, 1.2)]
    run = one.fly(one.supervisor(dither.dither), path, failures=failures)
    (named,) = run.diagnoses
    assert (named.actuator, named.kind) == (one.actuators[0], kind)
    told = one.predict(path, failures=failures, told=[named.time_s], dither=dither.dither)
    after = np.linalg.norm(run.rms(slice(round(1.2 / one.period_s), None)))
    assert after == pytest.approx(np.linalg.norm(told.rms_after), rel=0.1)


def test_two_failures_of_one_tick_both_change_the_plant_in_either_order():
    one, path = rig("platform"), path_of("platform", 0.8)
    locks = [Failure(1, "locked", FAILED_S), Failure(2, "free", FAILED_S)]
    one_way, other, single = (
        one.predict(path, failures=f, told=False).rms_after for f in (locks, locks[::-1], locks[:1])
    )
    np.testing.assert_array_equal(one_way, other)
    assert np.abs(one_way - single).max() > 0.01 * np.abs(single).max()


def test_a_loose_strut_leaves_its_range_and_nothing_is_predicted():
    one, path = rig("hexapod"), path_of("hexapod", 0.6)
    failures = [Failure("strut1", "loose", 0.1)]
    run = one.fly(one.controller(), path, failures=failures)
    assert np.abs(run.displacement[:, 0]).max() > 0.99 * one.travel[1][0]  # on its stop
    for told in (True, False):
        predicted = one.predict(path, failures=failures, told=told)
        assert predicted.leaves == "strut1"
        assert np.isnan(predicted.rms_after).all() and np.isfinite(predicted.rms_before).all()


def test_a_controller_cannot_learn_of_a_failure_before_it():
    failures = [Failure(1, "locked", 0.001), Failure(2, "weak", 0.001)]
    with pytest.raises(ValueError, match="told must be no times before the failures"):
        rig("arm").predict(np.zeros((3, 2)), failures=failures, told=[0.0, None])


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "platform", "hexapod"])
def test_the_default_dither_moves_the_task_by_less_than_half_the_noise(name):
    design = rig_dither(rig(name), "default")
    assert design is not None and design.separations.isolable()
    assert design.dither.frequency_hz in (10.0, 20.0)
    assert design.task_motion.max() <= 0.5 * rig(name).noise * (1 + 1e-9)
