"""Tests of named events: each changes the machine as documented, from its time on."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from fjh.rig import Rig, Run
from fjh.rig.events import EVENTS, Event
from fjh.rig.events.hooks import events_of
from fjh.study.errors import WrongInput
from sim import Failure
from sim.plant import Reading
from tests.fjh.rigs import path_of, rig_of, shared_rig

ONSET = 30
SUPPLY = {name for name, kind in EVENTS.items() if kind.of == "supply"}
OF_ONE = {name for name, kind in EVENTS.items() if kind.of == "actuator"}
MASS_KG = np.array([6.0, 4.0, 3.0])
"""Mass that each slide of the gantry moves."""


def event(name: str, time_s: float = ONSET * 1e-3) -> Event:
    return Event(name, time_s, 2 if name in OF_ONE else None)


@dataclass(frozen=True)
class Blind:
    """A controller that sends a sinusoid to each actuator, constant at 0 Hz, and reads nothing."""

    inputs: np.ndarray
    peak: float
    hz: float
    tick: int = 0

    def start(self) -> "Blind":
        return self

    def step(self, state: "Blind", *_: Any) -> "Blind":
        phase = 2 * np.pi * self.hz * 1e-3 * state.tick + np.arange(len(self.inputs))
        return replace(state, inputs=self.peak * np.cos(phase), tick=state.tick + 1)


def run_blind(rig: Rig, events: object = None, ticks=160, hz=10.0, peak=None, **how: Any) -> Run:
    """Simulate a run at a thirtieth of the full input, without feedback."""
    if peak is None:
        peak = 3.0 if rig.title.startswith("University") else 0.7 * rig.size
    blind = Blind(np.zeros(len(rig.actuators)), peak, hz)
    return rig.fly(blind, np.zeros((ticks, len(rig.major))), events=events, **how)


@pytest.fixture(scope="module")
def gantry() -> Rig:
    return rig_of("load_on_slides", major=(3, 4, 5), size=1e-3, crossover=0.7)


@cache
def of_one_event(name: str | None) -> Run:
    return run_blind(shared_rig("hexapod"), None if name is None else [event(name)])


@pytest.fixture(scope="module", autouse=True)
def quiet() -> Run:
    """Create the hexapod before the first test, so that no test is charged for it."""
    return of_one_event(None)


def differ(run: Run, other: Run) -> np.ndarray:
    """Return the ticks at which any logged signal differs."""
    pairs = ((run.true, other.true), (run.measured, other.measured), (run.qpos, other.qpos))
    return np.flatnonzero(np.any([np.any(a != b, axis=1) for a, b in pairs], axis=0))


def forces(events: Sequence[str], ticks: int) -> np.ndarray:
    """Return the forces of all coils under constant inputs, (ticks - 1, 6)."""
    logged: list[np.ndarray] = []
    log = SimpleNamespace(plant=lambda tick, model, data: logged.append(data.actuator_force.copy()))
    run_blind(shared_rig("hexapod"), [*map(event, events), log], ticks=ticks, hz=0.0)
    return np.array(logged[1:])


@pytest.mark.parametrize("name", EVENTS)
def test_an_event_has_an_effect_from_its_time_on_and_not_before(name, quiet):
    """Causality: until the event both runs are equal to the bit."""
    ticks = differ(of_one_event(name), quiet)
    assert ONSET <= ticks[0] <= ONSET + 40, ticks[:3]


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "hand", "platform", "arms"])
def test_every_robot_supports_each_event_or_states_a_reason(name):
    rig = shared_rig(name, crossover=0.7)
    without = run_blind(rig, ticks=60)
    for each in EVENTS:
        try:
            run = run_blind(rig, [Event(each, 5e-3, 3 if each in OF_ONE else None)], ticks=60)
        except WrongInput as rejection:
            assert each == "spring_lost" and str(rejection).endswith("has no spring of its own")
            continue
        assert 5 <= differ(run, without)[0] < 50, each
        assert np.isfinite(run.true).all()


@pytest.mark.parametrize("name", ["locked", "free", "weak", "loose"])
def test_a_failure_is_the_same_as_an_event(name):
    as_failure = run_blind(shared_rig("hexapod"), failures=[Failure(2, name, ONSET * 1e-3)])
    assert not differ(of_one_event(name), as_failure).size
    assert of_one_event(name).failures == as_failure.failures


def test_events_change_one_input_as_documented_and_within_range():
    rig, k = shared_rig("hexapod"), 2
    tick, dip = np.arange(400), np.full(6, 3.0)

    def sent(name: str, inputs: np.ndarray) -> np.ndarray:
        hook: Any = events_of(rig, [event(name, 0.0)])[0]
        return np.array([hook.sent(at, one_of)[k] for at, one_of in zip(tick, inputs, strict=True)])

    wave = np.outer(np.cos(0.1 * tick), dip)
    np.testing.assert_array_equal(sent("stuck_input", wave), 3.0)
    np.testing.assert_array_equal(sent("reversed", wave), -wave[:, k])
    per_m = 100.0 / rig.travel[1][k]
    offset = sent("offset", 0 * wave)
    np.testing.assert_allclose(np.abs(offset), per_m * 50e-6, rtol=0.01)  # 50 um
    drift = np.diff(np.abs(sent("drift", 0 * wave))) / 1e-3 / per_m
    np.testing.assert_allclose(drift, 10e-6, rtol=0.01)  # 10 um/s
    step = sent("slow", np.vstack([np.zeros(6), np.tile(dip, (399, 1))]))
    np.testing.assert_allclose(step, 3.0 * -np.expm1(-tick / 30.0), atol=1e-12)
    full = np.full((400, 6), np.sign(offset[0]) * 99.0)
    for name, inputs, percent in (
        *(("hard_over", wave, 100.0), ("half_over", wave, 50.0), ("offset", full, 100.0)),
    ):
        np.testing.assert_allclose(np.abs(sent(name, inputs)), percent, atol=0.01)


def test_a_released_lock_is_fixed_until_it_opens(quiet):
    at = run_blind(shared_rig("hexapod"), [event("lock_released")], ticks=260).displacement[:, 2]
    moved = np.ptp(at[ONSET + 2 : ONSET + 100]), np.ptp(at[ONSET + 110 :])
    assert moved[0] < 0.02 * moved[1]
    assert moved[1] == pytest.approx(np.ptp(quiet.displacement[:, 2]), rel=0.3)


def test_a_coil_has_the_documented_fraction_of_its_force():
    """The force depends on the current alone, also before and after the event."""
    tick = np.arange(420)
    started, since = tick >= ONSET, np.maximum(tick - ONSET, 0)
    parts = {
        "intermittent": (420, 1.0 - (started & (tick < 130) | (tick >= 330))),
        "free_returns": (420, 1.0 - started),
        "fading": (300, np.exp(-1e-3 * np.maximum(tick - ONSET + 1, 0))),
        "strong": (60, np.where(started, 1.3, 1.0)),
        "blackout": (100, 1.0 - (started & (tick < 80))),
        "sag": (100, np.where(started, 0.8, 1.0)),
        "ripple": (130, np.where(started, 1 + 0.2 * np.sin(2 * np.pi * 0.1 * since), 1.0)),
        "spring_lost": (60, np.ones(420)),
    }
    full = forces([], 420)
    for name, (ticks, part) in parts.items():
        expected, struts = full[: ticks - 1].copy(), slice(None) if name in SUPPLY else slice(2, 3)
        expected[:, struts] *= part[: ticks - 1, None]
        measured = forces([name], ticks)
        if name == "spring_lost":  # the coils of the others bear the rest
            measured, expected = measured[:, struts], expected[:, struts]
        np.testing.assert_allclose(measured, expected, rtol=1e-12, err_msg=name)


def test_two_actuators_lock_at_once_and_a_lock_comes_after_a_bump():
    _, both = events_of(shared_rig("hexapod"), [Event("two_locked", 0.2)], seed=4)
    assert [(each.kind, each.time_s) for each in both] == 2 * [("locked", 0.2)]
    assert both[0].number != both[1].number
    _, [after] = events_of(shared_rig("hexapod"), [Event("bump_then_lock", 0.2, "strut3")])
    assert (after.number, after.kind, after.time_s) == (2, "locked", pytest.approx(0.6))


def test_a_bump_gives_the_load_its_impulse(gantry):
    """The impulse m v is force times time before a servo reacts: 5/54 of the weight for 5 ms."""
    run = run_blind(gantry, [Event("bump", 0.02)], ticks=26, peak=0.0)
    momentum = MASS_KG * np.diff(run.displacement, axis=0)[-1] / gantry.period_s
    assert np.linalg.norm(momentum) == pytest.approx(5 / 54 * 3.0 * 9.81 * 5e-3, rel=0.1)


def test_a_push_displaces_the_servos_by_their_stiffness(gantry):
    """Statics: stiffness times displacement is the force, 1/54 of the weight of 3 kg."""
    run = run_blind(gantry, [Event("push", 0.1)], ticks=900, peak=0.0)
    force = 2000.0 * np.linalg.norm(run.displacement[-1])
    assert force == pytest.approx(3.0 * 9.81 / 54, rel=1e-3)


def test_pushes_of_several_events_add(gantry):
    """The machine is linear, so its motions add; one of the events is a hook."""
    ticks: list[int] = []

    def pull(tick: int, model: Any, data: mujoco.MjData) -> None:
        ticks.append(tick)
        data.xfrc_applied[3, :3] = [0.0, 0.0, 1.0]

    def moved(*events: object) -> np.ndarray:
        return run_blind(gantry, events, ticks=100, peak=0.0).displacement

    several = Event("push", 0.0), Event("tilt", 0.0), SimpleNamespace(plant=pull)
    np.testing.assert_allclose(moved(*several), sum(map(moved, several)), rtol=1e-6, atol=1e-12)
    assert ticks == 2 * list(range(100))


def test_a_tilting_floor_adds_a_component_of_weight(gantry):
    """A slowly growing tilt is a ramp of force, which a servo follows with the lag kv/kp."""
    run = run_blind(gantry, [Event("tilt", 0.0)], ticks=800, peak=0.0)
    tilted = 1e-3 * (run.time_s[-1] - 40 / 2000)
    pulls = 2000.0 * run.displacement[-1] / MASS_KG
    assert np.linalg.norm(pulls) == pytest.approx(9.81 * tilted, rel=5e-3)
    assert pulls[2] == 0.0


def test_on_a_vibrating_floor_each_axis_responds_as_an_oscillator(gantry):
    """Relative to the floor |x| = a / |k/m - w^2 + i w c/m|, with a = w sqrt(2) 100 um/s."""
    run = run_blind(gantry, [Event("tone", 0.0)], ticks=1000, peak=0.0)
    omega = 2 * np.pi * 20.0
    phasor = 2 * np.mean(run.displacement[700:] * np.exp(-1j * omega * run.time_s[700:, None]), 0)
    amplitude = np.abs(phasor * (2000 / MASS_KG - omega**2 + 1j * omega * 40 / MASS_KG))
    assert np.linalg.norm(amplitude) == pytest.approx(omega * np.sqrt(2) * 1e-4, rel=0.03)


def test_a_heavier_load_accelerates_less(gantry):
    """The acceleration of z, which alone carries the load, at a step of the input is kp u / m."""
    without, *changed = (
        run_blind(gantry, [Event(name, 0.0)], ticks=4, hz=0.0, peak=1e-3).displacement[1, 2]
        for name in ("noisy", "heavier", "lighter")
    )
    assert without / np.array(changed) == pytest.approx([1.2, 0.8], rel=0.02)


def test_an_actuator_below_its_dry_friction_is_stationary(gantry):
    """Friction is half of the path's force: a third of it moves nothing but MuJoCo's creep."""
    with_friction, without = (
        run_blind(gantry, [event(name, 0.0)], ticks=100, hz=0.0, peak=gantry.size / 3)
        for name in ("rubbing", "noisy")
    )
    with_friction, without = with_friction.displacement[-1], without.displacement[-1]
    assert abs(with_friction[2]) < 0.1 * abs(without[2])
    np.testing.assert_allclose(with_friction[:2], without[:2], rtol=1e-6)


def test_ten_times_the_damping_needs_ten_times_the_force(gantry):
    """The servo's damper alone damps z: its force at a given speed."""
    changed = copy(gantry.model)
    hook: Any = events_of(gantry, [event("damped", 0.0)])[0]
    hook.plant(0, changed, mujoco.MjData(changed))
    drag = []
    for model in (gantry.model, changed):
        data = mujoco.MjData(model)
        data.qvel[2] = 0.1
        mujoco.mj_forward(model, data)
        drag.append(data.qfrc_actuator[2] + data.qfrc_passive[2])
    assert drag[1] == pytest.approx(10 * drag[0], rel=1e-12)


def read(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the readings from an event on and without it, in standard deviations."""
    run, quiet, noise = of_one_event(name), of_one_event(None), shared_rig("hexapod").noise
    np.testing.assert_array_equal(run.qpos, quiet.qpos)  # a sensor has no effect
    return run.measured[ONSET:] / noise, quiet.measured[ONSET:] / noise


def test_sensor_events_have_the_documented_errors():
    seen, without = read("bias")
    np.testing.assert_allclose(
        seen - without, np.tile((seen - without)[0], (len(seen), 1)), atol=1e-9
    )
    assert np.linalg.norm((seen - without)[0]) == pytest.approx(20.0)
    seen, without = read("spike")
    assert np.linalg.norm(seen[0] - without[0]) == pytest.approx(1e6)
    np.testing.assert_array_equal(seen[1:], without[1:])
    seen, without = read("scale")
    np.testing.assert_allclose(seen, 1.2 * without)
    np.testing.assert_array_equal(read("silent")[0], 0.0)
    seen, without = read("hum")
    wave = np.outer(np.sin(2 * np.pi * 0.02 * np.arange(len(seen))), (seen - without)[12])
    np.testing.assert_allclose(seen - without, wave / np.sin(2 * np.pi * 0.24), atol=1e-9)
    assert np.abs(np.linalg.norm(seen - without, axis=1)).max() == pytest.approx(5.0, rel=0.01)
    seen, without = read("noisy")
    assert np.std(seen - without) == pytest.approx(np.sqrt(24.0), rel=0.15)


def test_samples_are_frozen_late_repeated_or_missing():
    seen, without = read("stuck")
    stands = np.ptp(seen, axis=0) == 0.0
    assert stands.sum() == 1
    np.testing.assert_array_equal(seen[:, ~stands], without[:, ~stands])
    seen, without = read("all_stuck")
    np.testing.assert_array_equal(seen, np.broadcast_to(without[0], seen.shape))
    seen, without = read("late")
    np.testing.assert_array_equal(seen[5:], without[:-5])
    for name, count in (("nan", 1), ("nan_for_50ms", 50)):
        seen, _ = read(name)
        np.testing.assert_array_equal(np.isnan(seen).all(axis=1), np.arange(len(seen)) < count)
    missing = np.isnan(read("dropped")[0]).all(axis=1).mean()
    seen, without = read("repeated")
    repeats = (seen != without).any(axis=1)
    np.testing.assert_array_equal(seen[1:][repeats[1:]], seen[:-1][repeats[1:]])
    for part in (missing, repeats.mean()):
        assert 0.03 < part < 0.2


def test_times_count_from_the_first_tick_of_the_path():
    rig, reading = shared_rig("hexapod"), Reading(np.ones(2), np.ones(6))
    for time_s, first in ((5.03, 70), (5.0301, 71), (5.0, 0), (3.0, 0)):
        hook: Any = events_of(rig, [Event("silent", time_s)], begin_s=5.0, lead_in_s=0.04)[0]
        read = [hook.measured(tick, reading).output[0] for tick in range(80)]
        assert np.flatnonzero(np.array(read) == 0.0)[0] == first


def test_random_sizes_depend_on_the_seed_and_not_on_other_events():
    rig, push, hum = shared_rig("hexapod"), Event("push", 0.03), Event("hum", 0.03)
    cases = [(None, 0), ([push], 0), ([hum, push], 0), ([push, push], 0), ([push], 1)]
    none, alone, both, twice, other = (
        run_blind(rig, events, ticks=60, seed=seed) for events, seed in cases
    )
    np.testing.assert_array_equal(alone.qpos, both.qpos)
    assert not np.array_equal(alone.qpos, other.qpos)
    first, two = (run.true[-1] - none.true[-1] for run in (alone, twice))
    # The second push has its own direction.
    assert np.linalg.norm(two - 2 * first) > 0.1 * np.linalg.norm(two)


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_inputs_changed_in_place_do_not_affect_the_controller(name):
    def inputs_with(sent: Callable[[int, np.ndarray], np.ndarray]) -> np.ndarray:
        rig = shared_rig(name)
        return rig.fly(
            rig.controller(), path_of(name, 0.1), events=SimpleNamespace(sent=sent)
        ).inputs

    in_place = inputs_with(lambda tick, inputs: np.multiply(inputs, 1.01, out=inputs))
    np.testing.assert_array_equal(in_place, inputs_with(lambda tick, inputs: 1.01 * inputs))
