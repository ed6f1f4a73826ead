"""Errors of a rig: each message is one sentence, and its advice works."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace as Hook
from typing import Any

import numpy as np
import pytest

from fjh.recording.record import record
from fjh.rig import Rig
from fjh.rig.events import Event
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.coil import Coils
from fjh.rig.hexapod.detector import Detector, secondary_motion
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.study.errors import WrongInput
from fjh.survey.survey import survey
from sim import MODELS, Failure, Pose, SimulationDiverged, load_model
from tests.arms import ARMS

ARM = """<mujoco><option {option}/><statistic extent="1"/><worldbody><body>
  <joint name="a" axis="0 1 0"/><geom size="0.05" mass="1" pos="0 0 -0.4"/>
  <body pos="0 0 -0.4"><joint name="b" axis="0 1 0"/><geom size="0.05" mass="1" pos="0 0 -0.4"/>
    <site name="tool" pos="0 0 -0.4"/></body></body></worldbody>
  <actuator><position joint="a" kp="400" kv="{kv}"/><position joint="b" kp="400" kv="{kv}"/>
  </actuator></mujoco>"""


@cache
def known_rig(name: str) -> Rig:
    return Rig.hexapod() if name == "hexapod" else Rig.of_mjcf(MODELS / "arm.xml", major=[0, 1])


def planar_rig(folder: Path, bend=0.8, *, kv=8, option="", rows=(3, 5), text=ARM, size=None) -> Rig:
    """Return the rig of two links in a plane, the second one bent."""
    file = folder / "arm.xml"
    file.write_text(text.format(kv=kv, option=option))
    return Rig.of_mjcf(file, site="tool", major=rows, start=[0.3, bend], size=size)


def is_as_predicted(rig: Rig) -> bool:
    """Return True if the error of a run is as predicted."""
    path = rig.path("circle", duration_s=0.3, turn_s=0.3)
    run = rig.fly(rig.controller(), path)
    predicted = rig.predict(path, noise=run.measured - run.true).rms_before
    return bool(np.linalg.norm(run.rms()) == pytest.approx(np.linalg.norm(predicted), rel=0.1))


@pytest.mark.long
def test_servos_that_overshoot_in_a_physics_step_are_rejected_with_advice(tmp_path):
    """Euler's step h removes h d of a speed that decays at the rate d: above 2 it diverges."""
    with pytest.raises(WrongInput, match=r"overshoots in physics steps of 0\.002 s") as rejection:
        planar_rig(tmp_path, kv=300)
    advised = re.search(r"steps of at most (\S+) s, or .*?\((\w+)\)", str(rejection.value))
    assert advised is not None
    assert is_as_predicted(planar_rig(tmp_path, kv=300, option=f'timestep="{advised[1]}"'))
    assert is_as_predicted(planar_rig(tmp_path, kv=300, option=f'integrator="{advised[2]}"'))


@pytest.mark.long
@pytest.mark.parametrize("bend", [1e-4, 5e-7])
def test_a_nearly_singular_posture_is_rejected_with_the_row_to_omit(tmp_path, bend):
    """A straight arm hardly moves its end along itself."""
    with pytest.raises(WrongInput, match="posture is nearly singular") as rejection:
        planar_rig(tmp_path, bend)
    assert "row 5" in str(rejection.value)
    assert is_as_predicted(planar_rig(tmp_path, bend, rows=(3,)))
    assert is_as_predicted(planar_rig(tmp_path, 0.8))


@pytest.mark.long
def test_an_undamped_servo_is_rejected_with_advice(tmp_path):
    """Damping of joints helps; damping of the arm's own servos is tested in `test_rig.py`."""
    arm = replace(ARMS["ur5e"], servos=[(2000, 0, 150)] * 6)
    bare, damped = arm.write(tmp_path / "a.xml"), arm.write(tmp_path / "b.xml", 'damping="20"')
    with pytest.raises(WrongInput, match=r"a motion of .*: damp its joints, or .* \(kv\)$"):
        Rig.of_mjcf(bare, site="tool", major=[3, 4, 5])
    assert Rig.of_mjcf(damped, site="tool", major=[3, 4, 5]).margins


@pytest.mark.long
@pytest.mark.parametrize("size", [None, 2e-4, 5e-3])
def test_noise_does_not_grow_with_the_path(tmp_path, size):
    """The noise is a hundredth of the default path, a thousandth of the extent of 1 m."""
    assert planar_rig(tmp_path, size=size).noise == pytest.approx(1e-5)


BALL = '<body name="ball"><geom size="0.1"/></body><body>'


@pytest.mark.long
@pytest.mark.parametrize(("bend", "collides"), [(2.9, True), (0.8, False)])
def test_a_start_in_collision_gives_a_warning(tmp_path, bend, collides):
    """The folded second link ends inside a ball at the base."""
    pattern = planar_rig(tmp_path, bend, text=ARM.replace("<body>", BALL, 1), rows=(3,)).warnings
    assert (
        any(each.startswith("the start is in collision: ball and") for each in pattern) == collides
    )


@pytest.mark.long
def test_a_lost_task_is_reported(tmp_path):
    """A link without force hangs down, far from a path of a millimeter."""
    rig = planar_rig(tmp_path)
    path, failures = rig.path("circle", duration_s=0.7), [Failure("b", "free", 0.2)]
    run, healthy = (rig.fly(rig.controller(), path, failures=each) for each in (failures, []))
    assert np.abs(run.desired - run.true)[-100:].max() > 0.01
    assert run.lost is not None and healthy.lost is None


def reads(**parts: Any) -> Hook:
    """Return a hook that replaces parts of a reading."""
    return Hook(measured=lambda tick, reading: reading._replace(**parts))


def simulated(**given: Any) -> Any:
    """Simulate the hexapod with its plain controller, unless another is given."""
    rig = known_rig("hexapod")
    return rig.fly(**{"controller": rig.controller(), "path": np.zeros((3, 2))} | given)


SENT = r"what events\.sent returns at tick 0 must"
READ = r"what events\.measured returns at tick 0"
FAILURES = [Failure(0, "locked", 0.001)]
NAN, ARM_FILE = np.nan, MODELS / "arm.xml"
PATH_OPTIONS, ZEROS = {"name": "circle", "duration_s": 0.01}, np.zeros((3, 2))
CALLS: dict[str, Callable[..., Any]] = {
    "made": Rig.hexapod,
    "loaded": lambda **given: Rig.of_mjcf(**{"file": ARM_FILE, "major": [0, 1]} | given),
    "simulated": simulated,
    "path": lambda **given: known_rig("hexapod").path(**PATH_OPTIONS | given),
    "predicted": lambda **given: known_rig("hexapod").predict(ZEROS, failures=FAILURES, **given),
    "event": lambda name: Event(name, 0.1),
    "recorded": lambda **given: record(**{"path": "x.rrd", "run": None, "rig": None} | given),
}
MADE = "made", "loaded"
NUMBERS = [NAN, np.inf, 1e300, "x", [1, 2], 1j, True]
LOST = [Event("nan", 0.0)]
SHORT, MISSING = np.zeros(1), np.full(2, NAN)
TABLE: list[tuple[type[Exception], str, str, list[Any], str]] = [
    *((ValueError, made, "seed", [*NUMBERS, None, -1], "^seed must") for made in MADE),
    (
        ValueError,
        "simulated",
        "path",
        [np.full((3, 2), 1e20)],
        r"^path must be at most 10000 rad or m",
    ),
    (ValueError, "simulated", "path", [np.zeros((0, 2))], "^path must have a row"),
    (ValueError, "predicted", "told", [[], [None, None], [-1.0], [0.0]], "^told must"),
    (ValueError, "event", "name", ["bmp", ""], "^there is no event"),
    # Hooks are reported with their name and tick.
    (ValueError, "simulated", "events", [Hook(sent=lambda *_: SHORT)], f"^{SENT}"),
    (ValueError, "simulated", "events", [Hook(sent=lambda _, u: NAN * u)], f"{SENT} .*finite"),
    (ValueError, "simulated", "events", [reads(output=SHORT)], f"^output of {READ}"),
    (
        ValueError,
        "simulated",
        "events",
        [reads(output=MISSING), LOST],
        "unless the controller runs",
    ),
    (TypeError, "simulated", "events", [Hook(sent=5)], r"^events\.sent must be a function"),
    (TypeError, "simulated", "events", [Hook(plant=lambda tick: None)], r"^events\.plant .*model"),
    (TypeError, "simulated", "events", [Hook(measured=lambda *_: 5)], f"^{READ}"),
    (TypeError, "simulated", "events", ["bump", ["bump"]], r'must .*fjh\.Event\("bump", 1\.5\)'),
    (TypeError, "simulated", "events", ["locked"], r'fjh\.Event\("locked", 1\.5, "ACTUATOR"\)'),
    (TypeError, "simulated", "events", [Event("bump", 0.1), [None], object(), 5], "^events must"),
    (TypeError, "loaded", "cross_over", [5.0], "no argument cross_over; did you mean .crossover"),
    (TypeError, "loaded", "file", [None, 5], "^file must"),
    (TypeError, "loaded", "site", [None, NAN, []], "^site must"),
    (TypeError, "loaded", "pinned", [5, [5]], "^pinned must"),
    *((TypeError, made, "feedforward", ["x", [1, 2]], "^feedforward must") for made in MADE),
    (TypeError, "event", "name", [None, 5, ["bump"]], "^name must"),
    (TypeError, "recorded", "path", [None], "^path must"),
    (TypeError, "recorded", "rig", [None, 5], "^rig must"),
    # Commands reject these values, too.
    (WrongInput, "loaded", "limits", ["some"], "^limits must be one of stated, none"),
    (WrongInput, "loaded", "major", ["x,w", [], [0, 6]], "^major must be different"),
    (WrongInput, "loaded", "servo_hz", [-1.0], "^servo_hz must"),
    (WrongInput, "loaded", "joint_weight", [[1, 2]], "one number or 7, got 2"),
    (WrongInput, "loaded", "pinned", ["", ["a", " "], ":point"], "^pinned must"),
    (WrongInput, "loaded", "start", ["home", "9", -1], "^the model has no keyframe .*it has none"),
    (WrongInput, "made", "size", [*NUMBERS, 0.0, -1], "^size must"),
    (WrongInput, "path", "name", ["cirle"], "^path must be spiral, .* did you mean .circle"),
    (WrongInput, "simulated", "failures", [[Failure("strut9", "locked")]], "strut9"),
]
"""Error, function, argument, values of it, and pattern of the message."""


@pytest.mark.parametrize(("error", "call", "name", "values", "pattern"), TABLE)
def test_invalid_arguments_of_a_rig_are_rejected_by_name(error, call, name, values, pattern):
    for value in values:
        with pytest.raises(error, match=pattern) as refusal:
            CALLS[call](**{name: value})
        assert refusal.type is error  # and no subclass
        assert "\n" not in str(refusal.value) and len(str(refusal.value)) < 300


def test_invalid_arguments_of_the_hexapod_are_rejected_by_name():
    """The payload is edge on or mirrored, coils would melt, or a strut has zero length."""
    edge_on = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    with pytest.raises(ValueError, match="rotation must not put the payload at right angles"):
        Detector(1.0, 5e-3, 3e-7).read(edge_on, np.random.default_rng(0))
    for rotation in (np.zeros((3, 3)), 2 * np.eye(3), -np.eye(3)):
        with pytest.raises(ValueError, match="rotation must hold right-handed orthonormal axes"):
            secondary_motion(rotation, np.zeros(3))
    coils, machine = Coils(5.0, 4.0, np.array([1.5, 2.2]), 20.0), hexapod(load_model())
    with pytest.raises(ValueError, match="current_a must leave temperatures finite"):
        coils.step(coils.cold(), np.full(2, 1e4), 1e3)
    on_its_node = Pose(np.eye(3), machine.bottom_m[0] - machine.top_m[0])
    for ask in (machine.posture, machine.inverse_jacobian):
        with pytest.raises(ValueError, match="pose must give every strut a nonzero length"):
            ask(on_its_node)


def test_controls_that_mujoco_would_clear_end_a_run():
    rig = known_rig("arm")
    huge = Hook(sent=lambda tick, inputs: np.full_like(inputs, 1e20))
    with pytest.raises(SimulationDiverged, match="controls beyond"):
        rig.fly(rig.controller(), np.zeros((3, 2)), events=huge)


PATH = np.zeros((3, 2))
MANY: Any = np.ones(99)
ADVICE: list[tuple[Callable[[], object], str]] = [
    (lambda: TestbedConfig(spiral_direction=0), "spiral_direction must be 1 or -1"),
    (
        lambda: TestbedConfig(spiral_direction=MANY),
        "spiral_direction must be one number, got shape",
    ),
    (lambda: TestbedConfig(anti_windup=MANY), "^anti_windup must be True or False, .{,90}$"),
    (lambda: known_rig("arm").predict(PATH, floor_m_per_s2=np.zeros((3, 3))), "no floor input"),
    (lambda: survey(hold="1,2", on_progress=lambda *_: None), "--hold .*give one with --matrix"),
]


@pytest.mark.parametrize(("ask", "pattern"), ADVICE, ids=[pattern for _, pattern in ADVICE])
def test_invalid_combinations_are_rejected_with_advice(ask, pattern):
    with pytest.raises((TypeError, ValueError, WrongInput), match=pattern):
        ask()


def test_public_objects_have_a_one_line_representation():
    rig = known_rig("arm")
    diagnosing, run = rig.supervisor(), rig.fly(rig.controller(), PATH)
    report = rig.control.system.kinematics().manipulability([0, 1])
    for thing in (rig, run, diagnosing, diagnosing.start(), report):
        assert re.match("<[A-Z].*>$", repr(thing))
