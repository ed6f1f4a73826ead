"""Flights whose sensors fail: nothing is raised, commands stand, encoders stand in."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from experiments.recover.row import Holding
from fjh.rig import Rig
from fjh.rig.run import Run
from ftc import GuardedController
from sim import HEXAPOD_MJCF

STRUCK, TICKS = 900, 1200
"""The diagnosis has learned what the plant is like after 800 ticks."""
UNKNOWN = np.full(2, np.nan)


@cache
def rig(name: str, sense: Any = "both") -> Rig:
    if name == "hexapod":
        return Rig.hexapod(mismatch="all", seed=3)
    return Rig.of_mjcf(HEXAPOD_MJCF.with_name(f"{name}.xml"), major=[0, 1], sense=sense)


class Sensors:
    """From a tick on the readings are others, made of the tick, what is read, and the last one."""

    def __init__(self, change: Callable[[int, Any, Any], Any]) -> None:
        self.change, self.last = change, None

    def measured(self, tick: int, reading: Any) -> Any:
        """As `events` of a rig."""
        if tick < STRUCK:
            self.last = reading
            return reading
        changed = self.change(tick - STRUCK, reading, self.last)
        self.last = reading if changed is None else changed
        return changed


def output(value: Callable[[int, Any, Any], Any]) -> Callable[[int, Any, Any], Any]:
    return lambda tick, reading, last: reading._replace(output=value(tick, reading, last))


@cache
def flown(name: str, what: str, sense: Any = "both", pilot: str = "supervisor") -> Run:
    tenth = np.random.default_rng(0).random(TICKS) < 0.1
    changes = {
        "none": lambda tick, reading, last: reading,
        "one NaN": output(lambda tick, r, last: r.output if tick else UNKNOWN),
        "50 ms": output(lambda tick, r, last: r.output if tick >= 50 else UNKNOWN),
        "150 ms": output(lambda tick, r, last: r.output if tick >= 150 else UNKNOWN),
        "bursts": output(lambda tick, r, last: last.output if tick % 70 < 20 else r.output),
        "row stuck": output(lambda tick, r, last: np.array([last.output[0], r.output[1]])),
        "stuck": output(lambda tick, r, last: last.output),
        "silent": lambda tick, reading, last: None,
        "another shape": output(lambda tick, r, last: np.zeros(3)),
        "dropped": output(lambda tick, r, last: UNKNOWN if tenth[tick] else r.output),
        "repeated": output(lambda tick, r, last: last.output if tenth[tick] else r.output),
        "spike": output(lambda tick, r, last: r.output + 0.1 * (tick == 0)),
        "encoders": lambda tick, r, last: r._replace(displacement=np.nan * r.displacement),
        "encoder stuck": lambda tick, r, last: r._replace(
            displacement=np.where(np.arange(len(last[1])) == 1, last[1], r[1])
        ),
    }
    one = rig(name, sense)
    path = one.path("circle", duration_s=TICKS * one.period_s, turn_s=0.5)
    flies = one.supervisor("none" if name != "hexapod" else "default")
    if pilot == "nothing":
        inner = one.controller()
        flies = Holding(inner, inner, None, secondary=flies.secondary)
    if pilot == "guarded":
        inner = one.controller()
        flies = GuardedController("my:own", lambda task: inner, one.task)
    return one.fly(flies, path, events=Sensors(changes[what]), seed=1)


def error(run: Run) -> np.ndarray:
    return np.linalg.norm(run.desired - run.true, axis=1)


def rms(run: Run) -> float:
    return float(np.sqrt((error(run)[STRUCK:] ** 2).mean()))


LOST = ["row stuck", "stuck", "silent", "another shape"]


@pytest.mark.parametrize("what", LOST)
@pytest.mark.parametrize("pilot", ["supervisor", "guarded"])
def test_without_a_reading_the_commands_stand_and_the_error_stays_that_of_the_path(what, pilot):
    """Bit by bit, from 50 ms after the last reading that changed; the integrators stand still."""
    run = flown("hexapod", what, pilot=pilot)
    held = run.inputs[STRUCK + 50 :]
    assert (held == held[0]).all()
    assert error(run).max() < 2.1 * np.linalg.norm(run.desired, axis=1).max()
    assert not run.diagnoses
    assert "since 0.90" in run.status and "the commands are held" in run.status
    assert run.state.sensors.task.lost and run.state.sensors.task.losses == 1


@pytest.mark.parametrize("pilot", ["supervisor", "guarded"])
def test_after_one_missing_reading_the_flight_goes_on_as_if_there_had_been_one(pilot):
    sound, run = (flown("hexapod", what, pilot=pilot) for what in ("none", "one NaN"))
    assert (run.inputs[STRUCK] == run.inputs[STRUCK - 1]).all()
    assert abs(rms(run) - rms(sound)) < rig("hexapod").noise
    step = np.linalg.norm(np.diff(run.desired, axis=0), axis=1).max()
    assert np.abs(run.true - sound.true).max() < 2 * step  # of the path, in the tick lost
    assert np.isnan(run.measured[STRUCK]).all()
    assert "the sensor of the task is usable (1 missing)" in run.status
    assert not run.diagnoses and "sensor" in run.status


@pytest.mark.parametrize("what", ["one NaN", "dropped", "repeated", "spike"])
def test_a_reading_that_is_missing_now_and_then_costs_little_and_raises_no_alarm(what):
    run, sound = flown("hexapod", what), flown("hexapod", "none")
    assert rms(run) < 1.2 * rms(sound)
    assert not run.state.watch.alarm_ticks and not run.diagnoses
    sensors = run.state.sensors.task
    assert sensors.missing + sensors.repeated > 0 and sensors.usable and not sensors.losses


def test_after_a_gap_control_goes_on_and_the_gap_raises_no_alarm():
    run, sound = flown("hexapod", "50 ms"), flown("hexapod", "none")
    held = run.inputs[STRUCK - 1 : STRUCK + 50]
    assert (held == held[0]).all() and not (run.inputs[-1] == held[0]).all()
    np.testing.assert_allclose(error(run)[-50:], error(sound)[-50:], atol=3e-6)
    assert not run.state.watch.alarm_ticks
    assert "usable again (50 missing; lost 1 times)" in run.status


@pytest.mark.parametrize("what", ["150 ms", "bursts"])
def test_a_sensor_that_comes_back_costs_no_more_than_with_a_controller_that_checks_nothing(what):
    """It is used at once; and bursts of 20 ms, in every 70, are no sensor that is stuck."""
    run, nothing = flown("hexapod", what), flown("hexapod", what, pilot="nothing")
    assert rms(run) < 1.01 * rms(nothing)
    assert not run.diagnoses and "repeats one value" not in run.status
    assert run.state.sensors.task.losses == (what == "150 ms")


@pytest.mark.long
@pytest.mark.parametrize("what", ["stuck", "another shape"])
def test_encoders_stand_in_for_the_sensor_of_the_task(what):
    """With a task's sensor alone the commands are held."""
    sound = rms(flown("arm", "none"))
    assert rms(flown("arm", what)) < 10 * sound < 0.05 * rms(flown("arm", what, "task"))
    said = "the task is estimated from the encoders"
    assert said in flown("arm", what).status and said not in flown("arm", what, "task").status


@pytest.mark.long
@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_encoders_that_fail_do_not_hurt_a_controller_that_does_not_use_them(name):
    sound, run = flown(name, "none"), flown(name, "encoders")
    np.testing.assert_array_equal(run.inputs, sound.inputs)
    assert ("encoders" in run.status) == (name == "arm")  # the hexapod does not look at them


@pytest.mark.long
def test_an_encoder_that_is_stuck_is_no_actuator_that_is_locked():
    run = flown("arm", "encoder stuck")
    assert not run.diagnoses
    assert "the set of encoders repeats one value since 0.90" in run.status
