"""What a rig refuses in a sentence, and that what the sentence advises works."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fjh.recording.record import record
from fjh.rig import Mismatch, Rig
from fjh.rig.events import Event
from fjh.rig.rig import LARGEST_DISPLACEMENT
from fjh.study.errors import WrongInput
from sim import HEXAPOD_MJCF, Failure, SimulationDiverged
from tests.fjh.rig.test_rig import rig as known_rig
from tests.hostile import Target, refusals

ARM = """<mujoco><option {option}/><statistic extent="1"/><worldbody><body>
  <joint name="a" axis="0 1 0"/><geom size="0.05" mass="1" pos="0 0 -0.4"/>
  <body pos="0 0 -0.4"><joint name="b" axis="0 1 0"/><geom size="0.05" mass="1" pos="0 0 -0.4"/>
    <site name="tool" pos="0 0 -0.4"/></body></body></worldbody>
  <actuator><position joint="a" kp="400" kv="{kv}"/><position joint="b" kp="400" kv="{kv}"/>
  </actuator></mujoco>"""


def rig(folder: Path, bend: float = 0.8, *, kv: float = 8, option: str = "", rows=(3, 5)) -> Rig:
    """Of two links in a plane, the second one bent."""
    file = folder / "arm.xml"
    file.write_text(ARM.format(kv=kv, option=option))
    return Rig.of_mjcf(file, site="tool", major=rows, start=[0.3, bend])


def holds(one: Rig) -> bool:
    """Whether a flight is as predicted."""
    path = one.path("circle", duration_s=0.3, turn_s=0.3)
    run = one.fly(one.controller(), path)
    predicted = one.predict(path, noise=run.measured - run.true).rms_before
    return bool(np.linalg.norm(run.rms()) == pytest.approx(np.linalg.norm(predicted), rel=0.1))


def test_servos_that_overshoot_in_a_physics_step_are_refused_with_steps_that_do_not(tmp_path):
    """Euler's step h takes h d of a speed that decays at the rate d: more than twice of it grows.

    In continuous time all is stable, so that no loop shows it.
    """
    with pytest.raises(WrongInput, match=r"overshoots in physics steps of 0\.002 s") as refused:
        rig(tmp_path, kv=300)
    found = re.search(r"steps of at most (\S+) s, or .*?\((\w+)\)", str(refused.value))
    assert found is not None
    assert holds(rig(tmp_path, kv=300, option=f'timestep="{found[1]}"'))
    assert holds(rig(tmp_path, kv=300, option=f'integrator="{found[2]}"'))


@pytest.mark.parametrize("bend", [1e-4, 5e-7])
def test_a_posture_that_is_nearly_singular_is_refused_with_the_row_to_leave_out(tmp_path, bend):
    """A straight arm moves its end across, and hardly along itself."""
    with pytest.raises(WrongInput, match="posture is nearly singular") as refused:
        rig(tmp_path, bend)
    found = re.search(r"row (\d)", str(refused.value))
    assert found is not None and found[1] == "5"
    assert holds(rig(tmp_path, bend, rows=(3,)))
    assert holds(rig(tmp_path, 0.8))


UNDAMPED = """<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast"/>
<worldbody><body pos="0 0 1"><joint name="j0" axis="0 0 1"/><geom size=".05" mass="1"/>
<body><joint name="j1" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
<body pos=".3 0 0"><joint name="j2" axis="0 1 0"/><geom size=".1" pos=".15 0 0"/>
<site name="tool" pos=".3 0 0"/></body></body></body></worldbody><actuator>
<position joint="j0" kp="500"/><position joint="j1" kp="500"/><position joint="j2" kp="500"/>
</actuator></mujoco>"""


@pytest.mark.parametrize("damped", ["servo", "joint"])
def test_an_undamped_servo_is_refused_with_the_damping_that_helps(tmp_path, damped):
    """Neither other rows nor another start do."""
    file, begin = tmp_path / "arm.xml", {"start": [0, -0.5, 0.9], "major": [3, 4, 5]}
    file.write_text(UNDAMPED)
    with pytest.raises(WrongInput, match=r"a motion of .*: damp its joints, or .* \(kv\)$"):
        Rig.of_mjcf(file, site="tool", **begin)
    old, new = {"servo": ("kp", 'kv="20" kp'), "joint": ("axis", 'damping="20" axis')}[damped]
    file.write_text(UNDAMPED.replace(old, new))
    assert Rig.of_mjcf(file, site="tool", **begin).margins


@pytest.mark.parametrize("size", [None, 2e-4, 5e-3])
def test_noise_does_not_grow_with_the_path(tmp_path, size):
    """A hundredth of the default path, which is a thousandth of the extent of 1 m."""
    file = tmp_path / "arm.xml"
    file.write_text(ARM.format(kv=8, option=""))
    one = Rig.of_mjcf(file, site="tool", major=(3, 5), start=[0.3, 0.8], size=size)
    assert one.noise == pytest.approx(1e-5)


def test_a_start_in_collision_says_so_before_it_flies(tmp_path):
    """The end of the second link, folded back, lies in a ball at the base."""
    file = tmp_path / "arm.xml"
    ball = '<body name="ball"><geom size="0.1"/></body><body>'
    file.write_text(ARM.format(kv=8, option="").replace("<body>", ball, 1))
    for bend, collides in ((2.9, True), (0.8, False)):
        said = Rig.of_mjcf(file, site="tool", major=(3,), start=[0.3, bend]).warnings
        assert (
            any(each.startswith("the start is in collision: ball and") for each in said) == collides
        )


def test_a_lost_task_is_the_first_sentence(tmp_path):
    """A link without force hangs down, far from a path of a millimetre."""
    one = rig(tmp_path)
    failures = [Failure("b", "free", 0.2)]
    run = one.fly(one.controller(), one.path("circle", duration_s=0.7), failures=failures)
    off_mm = 1e3 * np.abs(run.desired - run.true)[-100:].max()
    assert off_mm > 10 and run.lost is not None
    assert run.status.startswith("The major task is lost: it ends up to ")
    assert one.fly(one.controller(), one.path("circle", duration_s=0.3)).lost is None


def hexapod(method: str, **good: Any) -> list[Target]:
    """A method of the hexapod's rig, which is made when it is called."""
    return [Target(lambda **given: getattr(known_rig("hexapod"), method)(**given), good)]


def flown(**given: Any) -> Any:
    """A flight of the hexapod with its plain controller, unless there is another."""
    one = known_rig("hexapod")
    return one.fly(**{"controller": one.controller(), "path": np.zeros((3, 2))} | given)


def hooked(**hooks: Any) -> SimpleNamespace:
    return SimpleNamespace(**hooks)


def reads(**parts: Any) -> SimpleNamespace:
    """A hook of what is read, with these parts in place of its own."""
    return hooked(measured=lambda tick, reading: reading._replace(**parts))


NAN, INF, HUGE = np.nan, np.inf, 1e300
NUMBERS = [NAN, INF, HUGE, "x", None, [1, 2], 1j, True]
NO_NUMBER = ["x", None, [1, 2], object()]
MADE, FLOWN = [Target(Rig.hexapod, {})], [Target(flown, {})]
ARM_FILE = HEXAPOD_MJCF.with_name("arm.xml")
LOADED = [Target(Rig.of_mjcf, {"file": ARM_FILE, "major": [0, 1]})]
PATH = hexapod("path", name="circle", duration_s=0.01)
PREDICTED = hexapod("predict", path=np.zeros((3, 2)), failures=[Failure(0, "locked", 0.001)])
HAPPENS, STRUCK = [Target(Event, {"name": "bump", "time_s": 0.1})], [Failure(0, "locked")]
LOCKS = [Target(Event, {"name": "locked", "time_s": 0.1, "actuator": 0})]
SHORT, MISSING = np.zeros(1), np.full(2, NAN)
VALUES = [
    (MADE + LOADED, "seed", [*NUMBERS, -1, 2.5], "^seed must"),
    (PATH, "duration_s", [*NUMBERS, 0.0, -1, 1e9], "^duration_s must"),
    (PATH, "turn_s", [*NUMBERS, 0.0, -1], "^turn_s must"),
    (FLOWN, "path", [np.zeros((0, 2))], "^path must have a row"),
    (FLOWN, "path", [np.full((3, 2), 1e20)], r"^path must be at most 10000 rad or m, got 1e\+20"),
    (FLOWN, "path", [NAN, None, "x", np.zeros(3), np.zeros((3, 3)), [[None, 1.0]]], "^path must"),
    (PREDICTED, "path", [np.zeros((0, 2)), np.full((3, 2), 1e20), None], "^path must"),
    (FLOWN, "seed", [*NUMBERS, -1, 2.5], "^seed must"),
    (FLOWN, "begin_s", [*NUMBERS, -1], "^begin_s must"),
    (FLOWN, "lead_in_s", [*NUMBERS, -1, 1e9], "^lead_in_s must"),
    (PREDICTED, "told", [[], [None, None], [NAN], ["x"], [-1.0]], "^told must"),
    (PREDICTED, "noise", [NAN, "x", np.zeros((2, 2))], "^noise must"),
    (PREDICTED, "start", [NAN, "x", np.zeros(5), np.zeros((3, 6))], "^start must"),
    (PREDICTED, "floor_m_per_s2", [NAN, "x", np.zeros(3), np.zeros((2, 3))], "^floor_m_per_s2 m"),
    (HAPPENS, "name", ["bmp", ""], "^there is no event"),
    (HAPPENS, "time_s", [*NUMBERS, -1.0], "^time_s must"),
    (LOCKS, "actuator", [NAN, -1, 2.5, [0], True], "^actuator must"),
    ([Target(Mismatch, {})], "gain", [*NUMBERS, -1, 10**400], "^gain must"),
    ([Target(Mismatch, {})], "delay_ticks", [*NUMBERS, -1, 2.5, 2**70], "^delay_ticks must"),
    ([Target(Mismatch, {})], "family", ["normal"], "^family must"),
    # Hooks: which one, and when.
    (
        FLOWN,
        "events",
        [hooked(sent=lambda *_: SHORT)],
        r"^what events\.sent returns at tick 0 must",
    ),
    (
        FLOWN,
        "events",
        [[hooked(sent=lambda *_: "x")]],
        r"^what events\.sent returns at tick 0 must",
    ),
    (FLOWN, "events", [hooked(sent=lambda _, u: NAN * u)], r"events\.sent returns .* finite"),
    (FLOWN, "events", [reads(output=SHORT)], r"^output of what events\.measured returns at tick 0"),
    (FLOWN, "events", [reads(output=MISSING), [Event("nan", 0.0)]], "^pilot must go on without"),
]
KINDS = [
    (MADE, "feedforward", NO_NUMBER, "^feedforward must"),
    (LOADED, "file", [None, 5, NAN], "^file must"),
    (LOADED, "site", [None, NAN, []], "^site must"),
    (LOADED, "feedforward", NO_NUMBER, "^feedforward must"),
    (LOADED, "pinned", [5, [5]], "^pinned must"),
    (LOADED, "cross_over", [5.0], "^there is no argument cross_over; did you mean .crossover"),
    (PATH, "name", [None, 5, ["circle"]], "^name must"),
    (FLOWN, "controller", [None, 5, "supervisor"], "^controller must"),
    (FLOWN, "failures", [None, 5, "strut1", STRUCK[0], [None], ["strut1"]], "^failures must"),
    (FLOWN, "on_tick", [3, "x"], "^on_tick must"),
    (FLOWN, "events", ["bump", ["bump"]], r'^events must .*fjh\.Event\("bump", 1\.5\)'),
    (FLOWN, "events", ["locked"], r'^events must .*fjh\.Event\("locked", 1\.5, "ACTUATOR"\)'),
    (FLOWN, "events", [Event("bump", 0.1), [None], [5], object(), [object()], 5], "^events must"),
    (FLOWN, "events", [hooked(sent=5), [hooked(sent=5)]], r"^events\.sent must be a function"),
    (FLOWN, "events", [hooked(plant=lambda tick: None)], r"^events\.plant must be .*model"),
    (FLOWN, "events", [hooked(measured=lambda *_: 5)], r"^what events\.measured returns at tick 0"),
    (PREDICTED, "told", [5, "x", None], "^told must"),
    (PREDICTED, "failures", [None, 5, [5]], "^failures must"),
    (PREDICTED, "dither", [5, "default"], "^dither must"),
    (hexapod("supervisor"), "goal", [0, [], "x"], "^goal must"),
    (hexapod("supervisor"), "dither", [[], object()], "^dither must"),
    (hexapod("controller"), "goal", [0, [], "x"], "^goal must"),
    (hexapod("mapping"), "goal", [0, "x"], "^goal must"),
    (hexapod("classified"), "faults", [None, 5, ["x"]], "faults must"),
    (hexapod("reached"), "pose", [None, 5], "^pose must"),
    (HAPPENS, "name", [None, 5, ["bump"]], "^name must"),
    ([Target(Mismatch, {})], "family", [None, 5], "^family must"),
    ([Target(record, {"path": "x.rrd", "rig": None, "run": None})], "path", [None], "^path must"),
    ([Target(record, {"path": "x.rrd", "run": None})], "rig", [None, 5], "^rig must"),
]
BY_COMMANDS = [
    (LOADED, "limits", ["some", None], "^limits must be one of stated, none"),
    (LOADED, "sense", ["some", None], "^sense must be one of"),
    (
        MADE + LOADED,
        "size",
        [*(each for each in NUMBERS if each is not None), 0.0, -1, 10**400],
        "^size must",
    ),
    (LOADED, "noise", [NAN, "x", [1, 2], True], "^noise must"),
    (LOADED, "joint_weight", ["x", [-1.0], object(), [None], NAN, True], "^joint_weight must"),
    (LOADED, "major", ["x,w", [], [0, 6], ["x", 3], 0.5, None, [[0]]], "^major must be different"),
    (LOADED, "servo_hz", ["x", NAN, -1.0], "^servo_hz must"),
    (LOADED, "pinned", ["", ["a", " "], ":point"], "^pinned must"),
    (LOADED, "start", ["home", "9", -1], r'^the model has no keyframe ".*; it has none'),
    (LOADED, "period", [None, NAN, "x"], "^period must"),
    (PATH, "name", ["cirle"], "^path must be spiral, circle, steps .* did you mean .circle"),
    (FLOWN, "failures", [[Failure("strut9", "locked")]], "strut9"),
]
"""What the words of a command refuse, too."""


@pytest.mark.parametrize(
    ("target", "name", "value", "error", "said"),
    [
        *refusals(ValueError, VALUES),
        *refusals(TypeError, KINDS),
        *refusals(WrongInput, BY_COMMANDS),
    ],
)
def test_what_a_rig_cannot_take_is_refused_by_name(target, name, value, error, said):
    with pytest.raises(error, match=said) as refusal:
        target.call(**(target.good | {name: value}))
    assert refusal.type is error  # and no subclass
    assert "\n" not in str(refusal.value) and len(str(refusal.value)) < 300


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_the_largest_path_that_is_named_is_flown_or_said_to_diverge(name):
    """MuJoCo clears controls beyond its largest number: zeros were flown, without a word."""
    one = known_rig(name)
    path = np.full((20, 2), LARGEST_DISPLACEMENT)
    try:
        run = one.fly(one.controller(), path)
    except SimulationDiverged:
        return
    assert np.abs(run.displacement[-1]).max() > 0.0


def test_controls_that_mujoco_would_clear_end_a_flight():
    one = known_rig("arm")
    huge = hooked(sent=lambda tick, inputs: np.full_like(inputs, 1e20))
    with pytest.raises(SimulationDiverged, match="controls beyond"):
        one.fly(one.controller(), np.zeros((3, 2)), events=huge)
