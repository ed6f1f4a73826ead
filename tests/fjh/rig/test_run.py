"""Runs in which sensors fail, and the cost of a supervisor under any loss of force."""

from collections.abc import Callable
from functools import cache
from itertools import product
from typing import Any

import mujoco
import numpy as np
import pytest

from fjh.rig import Rig, Run
from ftc import GuardedController, OracleController
from sim import Failure
from sim.mjcf import drives
from tests.fjh.rigs import rig_of, shared_rig

ONSET, TICKS = 900, 1150
"""Ticks of the onset, after 800 for the diagnosis to learn the plant, and of a whole run."""
UNKNOWN = np.full(2, np.nan)

Change = Callable[[int, Any, Any], Any]


class Sensors:
    """Sensors whose readings change from a tick on, as a function of tick, reading and last one."""

    def __init__(self, change: Change) -> None:
        self.change, self.last = change, None

    def measured(self, tick: int, reading: Any) -> Any:
        changed = reading if tick < ONSET else self.change(tick - ONSET, reading, self.last)
        self.last = reading if changed is None else changed
        return changed


def output(value: Change) -> Change:
    return lambda tick, reading, last: reading._replace(output=value(tick, reading, last))


TENTH = np.random.default_rng(0).random(TICKS) < 0.1
CHANGES: dict[str, Change] = {
    "none": lambda tick, reading, last: reading,
    "one NaN": output(lambda tick, r, last: r.output if tick else UNKNOWN),
    "50 ms": output(lambda tick, r, last: r.output if tick >= 50 else UNKNOWN),
    "row stuck": output(lambda tick, r, last: np.array([last.output[0], r.output[1]])),
    "stuck": output(lambda tick, r, last: last.output),
    "silent": lambda tick, reading, last: None,
    "another shape": output(lambda tick, r, last: np.zeros(3)),
    "dropped": output(lambda tick, r, last: UNKNOWN if TENTH[tick] else r.output),
    "repeated": output(lambda tick, r, last: last.output if TENTH[tick] else r.output),
    "spike": output(lambda tick, r, last: r.output + 0.1 * (tick == 0)),
    "encoders": lambda tick, r, last: r._replace(displacement=np.nan * r.displacement),
    "encoder stuck": lambda tick, r, last: r._replace(
        displacement=np.where(np.arange(len(last[1])) == 1, last[1], r[1])
    ),
}


@cache
def simulated(name: str, what: str, sense: Any = "both", kind: str = "supervisor") -> Run:
    rig = shared_rig(name, "all") if name == "hexapod" else shared_rig(name, sense=sense)
    path = rig.path("circle", duration_s=TICKS * rig.period_s, turn_s=0.5)
    inner = rig.controller()
    controllers = {
        "supervisor": lambda: rig.supervisor("default" if name == "hexapod" else "none"),
        "guarded": lambda: GuardedController("my:own", lambda task: inner, rig.task),
    }
    return rig.fly(controllers[kind](), path, events=Sensors(CHANGES[what]), seed=1)


def error(run: Run) -> np.ndarray:
    return np.linalg.norm(run.desired - run.true, axis=1)


def rms(run: Run, since: int = ONSET) -> float:
    return float(np.sqrt((error(run)[since:] ** 2).mean()))


LOST = ("row stuck", "stuck", "silent", "another shape")
IN_SHORT = [(LOST[0], "supervisor"), (LOST[3], "guarded")]


@pytest.mark.parametrize(
    ("what", "kind"),
    [
        pytest.param(*each, marks=() if each in IN_SHORT else pytest.mark.long)
        for each in product(LOST, ("supervisor", "guarded"))
    ],
)
def test_without_readings_the_commands_are_held(what, kind):
    """Commands are constant from 50 ms after the last changed reading; so are the integrators."""
    run = simulated("hexapod", what, kind=kind)
    constant = run.inputs[ONSET + 50 :]
    assert (constant == constant[0]).all()
    assert error(run).max() < 2.1 * np.linalg.norm(run.desired, axis=1).max()
    assert not run.diagnoses
    assert "since t = 0.90" in run.status and "the commands are held" in run.status


@pytest.mark.parametrize(
    "what",
    [
        *("one NaN", "50 ms", "dropped"),
        *(pytest.param(each, marks=pytest.mark.long) for each in ("repeated", "spike")),
    ],
)
def test_occasional_missing_readings_cost_little_and_raise_no_alarm(what):
    run, healthy = simulated("hexapod", what), simulated("hexapod", "none")
    if what == "50 ms":
        np.testing.assert_allclose(error(run)[-50:], error(healthy)[-50:], atol=3e-6)
    elif what == "one NaN":
        assert (run.inputs[ONSET] == run.inputs[ONSET - 1]).all()
        assert abs(rms(run) - rms(healthy)) < shared_rig("hexapod").noise
    else:
        assert rms(run) < 1.2 * rms(healthy)
    assert not run.state.monitor_state.alarm_ticks and not run.diagnoses
    sensors = run.state.sensors.task
    assert sensors.missing + sensors.repeated > 0 and sensors.usable
    assert sensors.losses == (what == "50 ms")


@pytest.mark.long
@pytest.mark.parametrize("what", ["stuck", "another shape"])
def test_encoders_replace_a_failed_task_sensor(what):
    """Commands are held if there is only the task sensor."""
    healthy = rms(simulated("arm", "none"))
    assert rms(simulated("arm", what)) < 10 * healthy < 0.05 * rms(simulated("arm", what, "task"))
    text = "the task is estimated from the encoders"
    assert (
        text in simulated("arm", what).status and text not in simulated("arm", what, "task").status
    )


@pytest.mark.long
def test_failed_encoders_do_not_affect_a_controller_without_them():
    """A stuck encoder is not diagnosed as a locked actuator."""
    np.testing.assert_array_equal(
        simulated("arm", "encoders").inputs, simulated("arm", "none").inputs
    )
    run = simulated("arm", "encoder stuck")
    assert not run.diagnoses
    assert "the set of encoders repeats one value (since t = 0.90" in run.status


@pytest.mark.long
def test_a_healthy_robot_with_dry_friction_raises_no_alarm():
    """The residuals are tested from 0.8 s on."""
    rig = rig_of("rubbing_arm", major=(3, 5))
    run = rig.fly(rig.supervisor(None), rig.path("circle", duration_s=2.0, turn_s=1.0))
    assert not run.diagnoses
    assert any("dry friction of shoulder, elbow, belt" in each for each in rig.warnings)


@pytest.mark.long
@pytest.mark.parametrize("actuator", ["shoulder", "elbow"])
def test_a_weak_servo_under_load_costs_no_more_than_without_diagnosis(actuator):
    """The servo sags by its load, then follows its commands: doubling them would be wrong."""
    rig, onset_s = rig_of("three_links", major=(5,)), 1.1
    path, weak = rig.path("circle", duration_s=2.1), [Failure(actuator, "weak", onset_s, 0.5)]
    run, nothing_done = (
        rig.fly(each, path, failures=weak) for each in (rig.supervisor(), rig.controller())
    )
    assert [(each.actuator, each.kind) for each in run.diagnoses] == [(actuator, "weak")]
    since = round(onset_s / rig.period_s)
    assert rms(run, since) <= 1.1 * rms(nothing_done, since)


class Strength:
    """Event that sets one actuator's force to given fractions at given times [s]."""

    def __init__(self, rig: Rig, which: int, parts: dict[float, float]) -> None:
        among = None if rig.part is None else rig.part.actuators
        self.ids = list(drives(rig.model, among=among)[which].ids)
        self.parts = {round(at_s / rig.period_s): part for at_s, part in parts.items()}
        self.now = 1.0

    def plant(self, tick: int, model: Any, data: mujoco.MjData) -> None:
        part = self.parts.get(tick, self.now)
        for parameters in (model.actuator_gainprm, model.actuator_biasprm):
            parameters[self.ids, :3] *= part / self.now
        self.now = part


PARTS = [{1.2: 0.5, 2.3: 2.0}, {1.2: 0.5, 1.6: 2.0}, {1.2: 0.5, 2.2: 1.0}, {1.2: 0.7, 2.2: 1.4}]
"""Fractions of an actuator's force by the times [s] from which they hold."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "parts"),
    [
        *(("hexapod", parts) for parts in PARTS),
        ("arm", PARTS[0]),
        *(pytest.param("arm", parts, marks=pytest.mark.night) for parts in PARTS[1:]),
    ],
    ids=str,
)
def test_a_varying_loss_of_force_costs_no_more_than_without_diagnosis(name, parts):
    """The force recovers in part or beyond its value, before or after the diagnosis is certain."""
    rig = shared_rig(name, crossover=0.7) if name == "arm" else shared_rig(name)
    rig = rig.with_mismatch("all", 4)
    path = rig.path("circle", duration_s=3.2, turn_s=1.5)
    diagnosing, inner = rig.supervisor(), rig.controller()
    uninformed = OracleController(inner, inner, None, secondary=diagnosing.secondary)
    with_diagnosis, without_diagnosis = (
        rig.fly(each, path, events=Strength(rig, 1, parts)) for each in (diagnosing, uninformed)
    )
    for since_s in parts:
        error, bound = (
            rms(run, round(since_s / rig.period_s)) for run in (with_diagnosis, without_diagnosis)
        )
        assert error < max(1.05 * bound, bound + rig.noise)
