"""Events by name: each does to the machine what its sentence says, from its time on, no earlier.

Inputs here are of a pilot that looks at nothing, so that what follows is the machine's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from experiments.recover.row import Holding
from fjh.rig import Rig, Run
from fjh.rig.events import EVENTS, Event, effects
from fjh.rig.events.hooks import events_of
from fjh.rig.run import tick_of
from fjh.study.errors import WrongInput
from sim import HEXAPOD_MJCF, Failure
from sim.mjcf import drives
from sim.plant import Reading

ONSET, TICKS = 30, 160
OF_ONE = {name for name, kind in EVENTS.items() if kind.of == "actuator"}
GANTRY = """
<mujoco model="gantry">
  <option timestep="2.5e-4" gravity="0 0 0"><flag contact="disable"/></option>
  <worldbody>
    <body><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1" mass="2"/>
      <body><joint name="y" type="slide" axis="0 1 0"/><geom size="0.1" mass="1"/>
        <body name="load"><joint name="z" type="slide" axis="0 0 1"/><geom size="0.1" mass="3"/>
          <site name="payload"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="px" joint="x" kp="2000" kv="40"/>
    <position name="py" joint="y" kp="2000" kv="40"/>
    <position name="pz" joint="z" kp="2000" kv="40"/>
  </actuator>
</mujoco>
"""
"""Three slides; the load is 3 kg, what y moves 4 kg, what x moves 6 kg."""
MAJOR = {"arm": [0, 1], "hand": [3, 4], "platform": [3, 4], "arms": [3, 4, 5]}


@cache
def rig(name: str) -> Rig:
    if name == "hexapod":
        return Rig.hexapod()
    return Rig.of_mjcf(HEXAPOD_MJCF.with_name(f"{name}.xml"), major=MAJOR[name], crossover=0.7)


@pytest.fixture(scope="module")
def gantry(tmp_path_factory) -> Rig:
    file = tmp_path_factory.mktemp("gantry") / "gantry.xml"
    file.write_text(GANTRY)
    return Rig.of_mjcf(file, major=[3, 4, 5], size=1e-3, crossover=0.7)


@dataclass(frozen=True)
class Sent:
    """State of a pilot: what it sends, and the tick."""

    inputs: np.ndarray
    tick: int = 0


@dataclass(frozen=True)
class Blind:
    """Sends a sinusoid to each actuator, or what else is to be sent, and reads nothing."""

    actuators: int
    peak: float
    hz: float = 10.0

    def start(self) -> Sent:
        """With no input."""
        return Sent(np.zeros(self.actuators))

    def step(self, state: Sent, *_: Any) -> Sent:
        """Whatever was measured."""
        phase = 2 * np.pi * self.hz * 1e-3 * state.tick + np.arange(self.actuators)
        return Sent(self.peak * np.cos(phase), state.tick + 1)


def flown(one: Rig, events: object, *, ticks: int = TICKS, hz: float = 10.0, **how: Any) -> Run:
    """A flight at a thirtieth of the full input; at 0 Hz the inputs are constant."""
    peak = 3.0 if one.title.startswith("University") else 0.7 * one.size
    pilot = Blind(len(one.actuators), how.pop("peak", peak), hz)
    return one.fly(pilot, np.zeros((ticks, len(one.major))), events=events, **how)


def event(name: str, time_s: float = ONSET * 1e-3, which: int | str = 2) -> Event:
    return Event(name, time_s, which if name in OF_ONE else None)


@cache
def quiet(name: str) -> Run:
    return flown(rig(name), None)


@pytest.fixture(scope="module", autouse=True)
def made_once() -> None:
    """No test's time has the making of the hexapod."""
    quiet("hexapod")


@cache
def one_event(name: str) -> Run:
    return flown(rig("hexapod"), [event(name)])


def differ(run: Run, other: Run) -> np.ndarray:
    """Ticks at which anything that is logged differs."""
    pairs = ((run.true, other.true), (run.measured, other.measured), (run.qpos, other.qpos))
    return np.flatnonzero(np.any([np.any(a != b, axis=1) for a, b in pairs], axis=0))


class Forces:
    """Logs the forces of all actuators."""

    def __init__(self) -> None:
        self.force: list[np.ndarray] = []

    def plant(self, tick: int, model: Any, data: mujoco.MjData) -> None:
        """At the end of the tick before."""
        self.force.append(data.actuator_force.copy())


class Strength:
    """One actuator has these parts of its force from these times [s] on."""

    def __init__(self, one: Rig, which: int, parts: dict[float, float]) -> None:
        among = None if one.part is None else one.part.actuators
        self.ids = list(drives(one.model, among=among)[which].ids)
        self.parts = {round(at_s / one.period_s): part for at_s, part in parts.items()}
        self.now = 1.0

    def plant(self, tick: int, model: Any, data: mujoco.MjData) -> None:
        """Of the plant's model."""
        part = self.parts.get(tick, self.now)
        for parameters in (model.actuator_gainprm, model.actuator_biasprm):
            parameters[self.ids, :3] *= part / self.now
        self.now = part


def forces(events: Sequence[Event], ticks: int, hz: float = 0.0) -> np.ndarray:
    """Of each coil of the hexapod at the end of each tick but the last, (ticks - 1, 6)."""
    log = Forces()
    flown(rig("hexapod"), [*events, log], ticks=ticks, hz=hz)
    return np.array(log.force[1:])


def test_each_event_says_what_it_is_of():
    assert {kind.of for kind in EVENTS.values()} == {"actuator", "supply", "machine", "sensor"}
    for kind in EVENTS.values():
        assert kind.of != "sensor" or not kind.named_as + kind.failures


def test_the_page_has_a_row_for_each_event():
    rows = [
        f"| `{name}` | {kind.of} | {kind.sentence} "
        f"| {', '.join(kind.named_as) or kind.cause or 'none'} |"
        for name, kind in EVENTS.items()
    ]
    page = (Path(__file__).parents[3] / "docs" / "track.md").read_text()
    assert "| --- | --- | --- | --- |\n" + "\n".join(rows) + "\n\n" in page


@pytest.mark.parametrize("name", EVENTS)
def test_nothing_happens_before_its_time_and_something_from_then_on(name):
    """A cause comes before its effect: until then both flights are equal to the bit."""
    ticks = differ(one_event(name), quiet("hexapod"))
    assert ONSET <= ticks[0] <= ONSET + 40, ticks[:3]


@pytest.mark.long
@pytest.mark.parametrize("name", MAJOR)
def test_every_robot_has_each_event_or_says_why_not(name):
    one = rig(name)
    for each in EVENTS:
        try:
            run = flown(one, [event(each, 5e-3, 3)], ticks=60)
        except WrongInput as refusal:
            assert each == "spring_lost" and str(refusal).endswith("has no spring of its own")
            continue
        assert 5 <= differ(run, quiet_of(name))[0] < 50, each
        assert np.isfinite(run.true).all()


@cache
def quiet_of(name: str) -> Run:
    return flown(rig(name), None, ticks=60)


WITHOUT_SIZE = {
    "sag": partial(effects.supply, mean=1.0),
    "ripple": partial(effects.supply, ripple=0.0),
    "strong": partial(effects.scaled_force, gain=1.0),
    "rubbing": partial(effects.rubbing, part=0.0),
    "damped": partial(effects.damped, times=1.0),
    "push": partial(effects.pushed, parts=0.0),
    "tilt": partial(effects.tilting_floor, rad_per_s=0.0),
    "heavier": partial(effects.scaled_mass, factor=1.0),
    "noisy": partial(effects.noisy, times=1.0),
    "scale": partial(effects.scaled, factor=1.0),
    "late": partial(effects.late, ticks=0),
    "dropped": partial(effects.missing, part=0.0),
}


@pytest.mark.parametrize("name", WITHOUT_SIZE)
def test_an_event_of_no_size_changes_nothing(name, monkeypatch):
    kind = replace(EVENTS[name], effect=WITHOUT_SIZE[name])
    monkeypatch.setitem(EVENTS, name, kind)
    assert not differ(flown(rig("hexapod"), [event(name)]), quiet("hexapod")).size


@pytest.mark.parametrize("name", ["locked", "free", "weak", "loose"])
def test_a_failure_is_the_same_as_an_event(name):
    as_failure = flown(rig("hexapod"), None, failures=[Failure(2, name, ONSET * 1e-3)])
    assert not differ(one_event(name), as_failure).size
    assert one_event(name).failures == as_failure.failures


@pytest.mark.parametrize(
    ("time_s", "tick"), [(0.0, 0), (0.07, 70), (0.07 + 1e-12, 70), (0.0701, 71), (-0.0015, -1)]
)
def test_a_time_is_at_the_first_tick_after_it(time_s, tick):
    """Rounded, seven times 0.01 is 0.07, and 70.00000000000001 ticks of a millisecond are 70."""
    assert tick_of(time_s, 1e-3) == tick


def test_times_count_from_the_first_tick_of_the_path_and_what_was_is_before_the_lead_in():
    one, reading = rig("hexapod"), Reading(np.ones(2), np.ones(6))
    for time_s, first in ((5.03, 70), (5.0, 0), (3.0, 0)):
        hook: Any = events_of(one, [Event("silent", time_s)], begin_s=5.0, lead_in_s=0.04)[0]
        read = [hook.measured(tick, reading).output[0] for tick in range(80)]
        assert np.flatnonzero(np.array(read) == 0.0)[0] == first


def test_what_is_drawn_is_of_the_seed_and_of_no_other_event():
    one, pushed = rig("hexapod"), [event("push"), event("hum")]
    alone, both = flown(one, pushed[:1], ticks=60), flown(one, pushed[::-1], ticks=60)
    np.testing.assert_array_equal(alone.qpos, both.qpos)
    assert differ(alone, flown(one, pushed[:1], ticks=60, seed=1)).size
    twice = flown(one, 2 * pushed[:1], ticks=60).true - flown(one, None, ticks=60).true
    first = alone.true - flown(one, None, ticks=60).true
    off_line = np.linalg.norm(twice[-1] - 2 * first[-1])
    assert off_line > 0.1 * np.linalg.norm(twice[-1])  # the second push has its own direction


def test_full_input_is_the_end_of_the_converter_and_the_strut_goes_to_its_stop():
    one = rig("hexapod")
    hook: Any = events_of(one, [event("hard_over", 0.0)])[0]
    sent = hook.sent(0, np.full(6, 3.0))
    assert abs(sent[2]) == pytest.approx(100.0, abs=100 / 2**15)
    np.testing.assert_array_equal(np.delete(sent, 2), 3.0)
    reached = abs(one_event("hard_over").displacement[-1, 2])
    assert 0.5 * one.travel[1][2] < reached < 1.2 * one.travel[1][2]
    half: Any = events_of(one, [event("half_over", 0.0)])[0]
    assert abs(half.sent(0, np.zeros(6))[2]) == pytest.approx(50.0, abs=0.01)


def test_inputs_of_one_actuator_change_as_said_and_stay_in_range():
    one, k = rig("hexapod"), 2
    tick, dip = np.arange(400), np.full(6, 3.0)

    def sent(name: str, inputs: np.ndarray) -> np.ndarray:
        hook: Any = events_of(one, [event(name, 0.0)])[0]
        return np.array([hook.sent(at, one_of)[k] for at, one_of in zip(tick, inputs, strict=True)])

    wave = np.outer(np.cos(0.1 * tick), dip)
    np.testing.assert_array_equal(sent("stuck_input", wave), 3.0)
    np.testing.assert_array_equal(sent("reversed", wave), -wave[:, k])
    per_m = 100.0 / one.travel[1][k]
    offset = sent("offset", 0 * wave)
    np.testing.assert_allclose(np.abs(offset), per_m * 50e-6, rtol=0.01)  # 50 um
    drift = np.diff(np.abs(sent("drift", 0 * wave))) / 1e-3 / per_m
    np.testing.assert_allclose(drift, 10e-6, rtol=0.01)  # 10 um/s
    step = sent("slow", np.vstack([np.zeros(6), np.tile(dip, (399, 1))]))
    np.testing.assert_allclose(step, 3.0 * -np.expm1(-tick / 30.0), atol=1e-12)
    full = sent("offset", np.full((400, 6), np.sign(offset[0]) * 99.0))
    np.testing.assert_allclose(np.abs(full), 100.0, atol=0.01)


def test_a_lock_that_opens_again_stands_in_between():
    at = flown(rig("hexapod"), [event("lock_released")], ticks=260).displacement[:, 2]
    moved = np.ptp(at[ONSET + 2 : ONSET + 100]), np.ptp(at[ONSET + 110 :])
    assert moved[0] < 0.02 * moved[1]
    assert moved[1] == pytest.approx(np.ptp(quiet("hexapod").displacement[:, 2]), rel=0.3)


def test_a_coil_gives_no_force_exactly_when_it_does_not_work():
    """And all of it before and after, since its force is that of its current alone."""
    ticks, full = 420, forces([], 420)
    for name, off in (
        ("intermittent", [*range(30, 130), *range(330, ticks - 1)]),
        ("blackout", range(30, 80)),
        ("free_returns", range(30, ticks - 1)),
    ):
        works = np.ones(ticks - 1)
        works[list(off)] = 0.0
        expected = full * works[:, None] if name == "blackout" else full.copy()
        expected[:, 2] = full[:, 2] * works
        np.testing.assert_array_equal(forces([event(name)], ticks), expected, err_msg=name)


def test_a_coil_fades_exponentially_and_a_strong_one_gives_more():
    full = forces([], 300)[:, 2]
    since = np.maximum(np.arange(299) - ONSET + 1, 0) * 1e-3
    np.testing.assert_allclose(forces([event("fading")], 300)[:, 2], full * np.exp(-since))
    gain = np.where(since > 0, 1.3, 1.0)
    np.testing.assert_allclose(forces([event("strong")], 300)[:, 2], full * gain)


def test_all_that_one_supply_feeds_sags_and_ripples():
    full = forces([], 100)
    np.testing.assert_allclose(forces([event("sag")], 100)[ONSET:], 0.8 * full[ONSET:], rtol=1e-12)
    ripple = forces([event("ripple")], 130)[ONSET:] / forces([], 130)[ONSET:]
    since = np.arange(len(ripple))[:, None]
    expected = np.broadcast_to(1 + 0.2 * np.sin(2 * np.pi * 0.1 * since), ripple.shape)
    np.testing.assert_allclose(ripple, expected, rtol=1e-12)


def test_two_actuators_lock_at_once_and_a_lock_comes_after_a_bump():
    one = rig("hexapod")
    _, both = events_of(one, [Event("two_locked", 0.2)], seed=4)
    assert [each.kind for each in both] == ["locked", "locked"]
    assert both[0].number != both[1].number and {each.time_s for each in both} == {0.2}
    _, after = events_of(one, [Event("bump_then_lock", 0.2, "strut3")])
    assert [(each.number, each.kind) for each in after] == [(2, "locked")]
    assert after[0].time_s == pytest.approx(0.6)


def test_without_its_spring_a_strut_sags_as_far_as_flexures_and_other_struts_let_it():
    """Its coil goes on, so it is not the same as a loose one; its preload is gone, as there."""
    moved = {name: one_event(name).displacement[:, 2] for name in ("spring_lost", "loose")}
    assert all(np.ptp(each[ONSET:]) > 20e-6 for each in moved.values())
    assert np.abs(moved["spring_lost"] - moved["loose"]).max() > 1e-6
    np.testing.assert_allclose(forces([event("spring_lost")], 60)[:, 2], forces([], 60)[:, 2])


def test_a_bump_gives_the_load_its_impulse(gantry):
    """Before a soft servo answers, m v is force times time: 5/54 of the weight for 5 ms."""
    run = flown(gantry, [Event("bump", 0.02)], ticks=26, peak=0.0)
    speed = np.diff(run.displacement, axis=0)[-1] / gantry.period_s
    momentum = np.linalg.norm(speed * [6.0, 4.0, 3.0])
    assert momentum == pytest.approx(5 / 54 * 3.0 * 9.81 * 5e-3, rel=0.1)


def test_a_push_stretches_the_servos_as_far_as_their_stiffness_says(gantry):
    """Statics: stiffness times displacement is the force, 1/54 of the weight of 3 kg."""
    run = flown(gantry, [Event("push", 0.1)], ticks=900, peak=0.0)
    force = 2000.0 * np.linalg.norm(run.displacement[-1])
    assert force == pytest.approx(3.0 * 9.81 / 54, rel=1e-3)


def test_pushes_of_several_events_add(gantry):
    """The machine is linear: so do its motions. A hook may be one of the events."""

    class Pulls:
        def plant(self, tick: int, model: Any, data: mujoco.MjData) -> None:
            data.xfrc_applied[3, :3] = [0.0, 0.0, 1.0]

    def moved(*events: object) -> np.ndarray:
        return flown(gantry, events, ticks=100, peak=0.0).displacement

    push, tilt, pulls = Event("push", 0.0), Event("tilt", 0.0), Pulls()
    apart = moved(push) + moved(tilt) + moved(pulls)
    np.testing.assert_allclose(moved(push, tilt, pulls), apart, rtol=1e-6, atol=1e-12)


def test_on_a_floor_that_tilts_every_mass_pulls_with_its_weight(gantry):
    """A tilt that grows slowly is a ramp of force, which a servo follows with the lag kv/kp."""
    run = flown(gantry, [Event("tilt", 0.0)], ticks=800, peak=0.0)
    tilted = 1e-3 * (run.time_s[-1] - 40 / 2000)
    pulls = 2000.0 * run.displacement[-1] / np.array([6.0, 4.0, 3.0])
    assert np.linalg.norm(pulls) == pytest.approx(9.81 * tilted, rel=5e-3)
    assert pulls[2] == 0.0


def test_on_a_floor_that_swings_each_axis_answers_as_an_oscillator(gantry):
    """Relative to the floor: |x| = a / |k/m - w^2 + i w c/m|, with a = w sqrt(2) 100 um/s."""
    run = flown(gantry, [Event("tone", 0.0)], ticks=1000, peak=0.0)
    omega, mass = 2 * np.pi * 20.0, np.array([6.0, 4.0, 3.0])
    phasor = 2 * np.mean(run.displacement[700:] * np.exp(-1j * omega * run.time_s[700:, None]), 0)
    found = np.abs(phasor * (2000 / mass - omega**2 + 1j * omega * 40 / mass))
    assert np.linalg.norm(found) == pytest.approx(omega * np.sqrt(2) * 1e-4, rel=0.03)


def test_a_heavier_load_answers_more_slowly(gantry):
    """Z alone carries the load: its acceleration at a step of the input is kp u / m."""
    z = {}
    for name in ("heavier", "lighter", "noisy"):
        run = flown(gantry, [Event(name, 0.0)], ticks=4, hz=0.0, peak=1e-3)
        z[name] = run.displacement[1, 2]
    assert z["noisy"] / z["heavier"] == pytest.approx(1.2, rel=0.02)
    assert z["noisy"] / z["lighter"] == pytest.approx(0.8, rel=0.02)


def test_an_actuator_that_rubs_stands_while_it_is_pushed_less_than_its_friction(gantry):
    """Friction is half of what moves the path; a third does not break away, but MuJoCo's creeps."""
    moved = {}
    for name in ("rubbing", "noisy"):
        which = event(name, 0.0)
        moved[name] = flown(gantry, [which], ticks=100, hz=0.0, peak=gantry.size / 3).displacement
    assert abs(moved["rubbing"][-1, 2]) < 0.1 * abs(moved["noisy"][-1, 2])
    np.testing.assert_allclose(moved["rubbing"][-1, :2], moved["noisy"][-1, :2], rtol=1e-6)


def test_ten_times_the_damping_takes_ten_times_the_force_to_move(gantry):
    """Of the servo's damper, as nothing else damps z: its force at a speed."""
    changed = mujoco.MjModel.from_xml_string(GANTRY)
    hook: Any = events_of(gantry, [event("damped", 0.0)])[0]
    hook.plant(0, changed, mujoco.MjData(changed))
    drag = []
    for one in (gantry.model, changed):
        data = mujoco.MjData(one)
        data.qvel[2] = 0.1
        mujoco.mj_forward(one, data)
        drag.append(data.qfrc_actuator[2] + data.qfrc_passive[2])
    assert drag[1] == pytest.approx(10 * drag[0], rel=1e-12)


def read(name: str) -> tuple[np.ndarray, np.ndarray]:
    """What is read from the event on, in standard deviations, and what would have been."""
    one = rig("hexapod")
    run = one_event(name)
    np.testing.assert_array_equal(run.qpos, quiet("hexapod").qpos)  # a sensor moves nothing
    return run.measured[ONSET:] / one.noise, quiet("hexapod").measured[ONSET:] / one.noise


def test_sensors_are_off_by_what_is_said():
    seen, sound = read("bias")
    np.testing.assert_allclose(np.linalg.norm(seen - sound, axis=1), 20.0, rtol=1e-9)
    assert np.ptp(seen - sound, axis=0).max() < 1e-9
    seen, sound = read("spike")
    assert np.linalg.norm(seen[0] - sound[0]) == pytest.approx(1e6)
    np.testing.assert_array_equal(seen[1:], sound[1:])
    seen, sound = read("scale")
    np.testing.assert_allclose(seen, 1.2 * sound)
    np.testing.assert_array_equal(read("silent")[0], 0.0)
    seen, sound = read("hum")
    wave = np.outer(np.sin(2 * np.pi * 0.02 * np.arange(len(seen))), (seen - sound)[12])
    np.testing.assert_allclose(seen - sound, wave / np.sin(2 * np.pi * 0.24), atol=1e-9)
    assert np.abs(np.linalg.norm(seen - sound, axis=1)).max() == pytest.approx(5.0, rel=0.01)


def test_a_stuck_sensor_repeats_its_reading_without_noise():
    seen, sound = read("stuck")
    stands = np.ptp(seen, axis=0) == 0.0
    assert stands.sum() == 1
    np.testing.assert_array_equal(seen[:, ~stands], sound[:, ~stands])
    seen, sound = read("all_stuck")
    np.testing.assert_array_equal(seen, np.broadcast_to(sound[0], seen.shape))


def test_samples_come_late_repeat_or_are_missing():
    seen, sound = read("late")
    np.testing.assert_array_equal(seen[5:], sound[:-5])
    for name, count in (("nan", 1), ("nan_for_50ms", 50)):
        seen, _ = read(name)
        np.testing.assert_array_equal(np.isnan(seen).all(axis=1), np.arange(len(seen)) < count)
    missing = np.isnan(read("dropped")[0]).all(axis=1).mean()
    seen, sound = read("repeated")
    repeats = (seen != sound).any(axis=1)
    np.testing.assert_array_equal(seen[1:][repeats[1:]], seen[:-1][repeats[1:]])
    for part in (missing, repeats.mean()):
        assert 0.03 < part < 0.2


def test_a_noisy_sensor_has_five_times_the_noise():
    seen, sound = read("noisy")
    assert np.std(seen - sound) == pytest.approx(np.sqrt(24.0), rel=0.15)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (
            lambda: Event("hardover", 1.0, 0),
            'there is no event "hardover"; did you mean "hard_over"',
        ),
        (lambda: Event("slow", 1.0), "slow is of an actuator, which must be named"),
        (lambda: Event("bump", 1.0, 3), "bump is of no single actuator, got 3"),
        (lambda: Event("bump", -1.0), "time_s must be a time from zero on, got -1"),
        (lambda: Event("bump", np.nan), "time_s must be a time from zero on, got nan"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(made, said):
    with pytest.raises(ValueError, match=said):
        made()


def test_an_actuator_that_a_robot_does_not_have_is_refused_with_the_nearest():
    with pytest.raises(WrongInput, match='no actuator or joint "strut33"; did you mean "strut3"'):
        flown(rig("hexapod"), [event("slow", 0.0, "strut33")])


CHANGES = [{1.2: 0.5, 2.3: 2.0}, {1.2: 0.5, 1.6: 2.0}, {1.2: 0.5, 2.2: 1.0}, {1.2: 0.7, 2.2: 1.4}]
"""Of an actuator's force: from which times on it is multiplied by which parts."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "parts"),
    [
        *(("hexapod", parts) for parts in CHANGES),
        ("arm", CHANGES[0]),
        *(pytest.param("arm", parts, marks=pytest.mark.night) for parts in CHANGES[1:]),
    ],
    ids=lambda value: (
        value
        if isinstance(value, str)
        else " ".join(f"{part:g} at {at_s:g} s" for at_s, part in value.items())
    ),
)
def test_a_weakness_that_changes_costs_at_most_what_doing_nothing_does(name, parts):
    """Whether the force comes back to what it was, or beyond, before its loss is sure or after."""
    one = rig(name).drawn("all", 4)
    pilot, path = one.supervisor(), one.path("circle", duration_s=3.2, turn_s=1.5)
    inner = one.controller()
    nothing = Holding(inner, inner, None, secondary=pilot.secondary)
    ours, theirs = (
        one.fly(each, path, events=Strength(one, 1, parts)) for each in (pilot, nothing)
    )
    for since_s in parts:
        error, bound = (
            float(np.sqrt(((run.desired - run.true)[round(since_s / one.period_s) :] ** 2).mean()))
            for run in (ours, theirs)
        )
        assert error < max(1.05 * bound, bound + one.noise)
