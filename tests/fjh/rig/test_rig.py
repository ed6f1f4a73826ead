"""One rig for every robot: failures by name, events, mismatches, files."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from fjh.rig import Rig
from fjh.rig.dither import rig_dither
from fjh.rig.mismatch import Known, Mismatch
from fjh.study.errors import WrongInput
from ftc import OracleController
from ftc.fdi import LEARNING_S, Diagnosis, Fault
from sim import HEXAPOD_MJCF, Body, Failure, JacobianReader, Mechanism, Plant, load_model
from tests.robots import FINGER

FAILED_S = 0.5


@cache
def rig(name: str, mismatch: Known | Mismatch = "exact") -> Rig:
    if name == "hexapod":
        return Rig.hexapod(mismatch=mismatch, seed=3)
    major = {"arm": [0, 1], "fjh": [0, 1], "platform": [3, 4], "hand": [3, 4]}[name]
    axes = "base" if name == "fjh" else None
    file = HEXAPOD_MJCF.with_name(f"{name}.xml")
    return Rig.of_mjcf(file, major=major, axes=axes, mismatch=mismatch, seed=3)


def path_of(name: str, duration_s: float = 0.8) -> np.ndarray:
    return rig(name).path("circle", duration_s=duration_s, turn_s=0.8)


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_an_actuator_fails_by_its_name_or_its_number(name):
    one, path = rig(name), path_of(name, 0.6)
    joint = one.actuators[2]
    runs = [
        one.fly(one.controller(), path, failures=[Failure(which, "locked", FAILED_S)])
        for which in (2, joint, one.aliases[2][0])
    ]
    for run in runs[1:]:
        np.testing.assert_array_equal(run.true, runs[0].true)
    stands = runs[0].displacement[round(FAILED_S / one.period_s) :, 2]
    assert np.ptp(stands) < 0.02 * np.ptp(runs[0].displacement[:, 2])
    with pytest.raises(WrongInput, match=rf'no actuator or joint "{joint}x"; did you mean'):
        one.fly(one.controller(), path, failures=[Failure(f"{joint}x", "free", 0.1)])
    with pytest.raises(TypeError, match="failures must be a Failure"):
        one.predict(path, failures=[joint])  # type: ignore[list-item]


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_what_is_printed_calls_actuators_by_their_names(name):
    """An object has its own line for a prompt, and a status of its own knows the robot's names."""
    one = rig(name)
    pilot, called = one.supervisor(dither=None), one.actuators[2]
    state = one.fly(pilot, path_of(name, 0.02)).state
    broken = replace(state, confirmed=(Diagnosis.told(Fault(2, "locked")),))
    assert broken.status.startswith(f"{called} is locked; the other actuators")
    assert called in repr(broken) and called in repr(pilot) and called in repr(one)
    for each in (broken, pilot, one, one.classified([Fault(2, "locked")])):
        assert "\n" not in repr(each) and len(repr(each)) < 1000


@pytest.mark.parametrize(
    ("major", "rows"),
    [
        (["x", "y", "z"], (3, 4, 5)),
        (("z", "rx"), (5, 0)),
        (["ry", 5], (1, 5)),
        ("x,y", (3, 4)),
        (np.array([4, 3]), (4, 3)),
    ],
)
def test_rows_are_called_by_name_or_by_number(major, rows):
    arm = HEXAPOD_MJCF.with_name("arm.xml")
    assert Rig.of_mjcf(arm, major=major, crossover=0.7).major == rows


@pytest.mark.parametrize("major", [["x", "w"], ["x", 3], ["x", ""], "", "rot x"])
def test_rows_of_no_such_name_and_rows_named_twice_are_refused(major):
    with pytest.raises((WrongInput, ValueError), match=r"^major must be"):
        Rig.of_mjcf(HEXAPOD_MJCF.with_name("arm.xml"), major=major)


@pytest.mark.long
def test_a_flight_that_ends_while_the_diagnosis_learns_says_so():
    """What was taken for the robot without a failure has been compared with nothing."""
    one = rig("arm")
    pilot = one.supervisor(dither=None)
    short, longer = (one.fly(pilot, path_of("arm", LEARNING_S + more)) for more in (-0.1, 0.1))
    learning = f"it takes the first {LEARNING_S:g} s for the robot without a failure"
    assert short.undiagnosed == learning
    assert longer.undiagnosed == "the sensors read what the model without a failure predicts"


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "platform", "hexapod"])
def test_the_default_dither_moves_the_major_rows_by_less_than_half_of_a_samples_noise(name):
    design = rig_dither(rig(name), "default")
    assert design is not None and design.separations.isolable()
    assert design.dither.frequency_hz in (10.0, 20.0)
    assert design.task_motion.max() <= 0.5 * rig(name).noise * (1 + 1e-9)


@pytest.mark.long
def test_a_strut_without_force_is_the_same_to_both_rigs_of_the_hexapod():
    """Its spring holds it: it counts as locked, and the task as possible, whoever asks."""
    failures = [Failure("strut1", "free", 1.2)]  # the diagnosis learns until 0.8 s
    for name in ("hexapod", "fjh"):
        one = rig(name)
        assert one.unused == "locked"
        run = one.fly(one.supervisor("none"), path_of(name, 1.6), failures=failures)
        first = one.actuators[0]  # the file calls its coil1
        assert run.diagnoses[0].actuator == first and not run.task_lost
        assert f"{first} was named free at" in run.status


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_a_rig_reads_its_model_once(name, monkeypatch):
    """Counted: pilots, verdicts and flights share what was read; a flight has its own plant."""
    made = Counter[str]()
    for each in (Mechanism, JacobianReader, Plant):
        monkeypatch.setattr(each, "__init__", _counted(each.__init__, made, each.__name__))
    monkeypatch.setattr(Plant, "settle", _counted(Plant.settle, made, "settle"))
    one = rig.__wrapped__(name)
    assert made["JacobianReader"] == 1
    assert made["Mechanism"] == (name != "hexapod")
    one.fly(one.supervisor("none"), np.zeros((2, 2)))
    made.clear()
    one.fly(one.supervisor("none"), np.zeros((2, 2)))
    one.controller()
    one.classified([Fault(1, "loose")])
    assert made == {"Plant": 1}


def _counted(what: Callable[..., Any], made: Counter[str], name: str) -> Callable[..., Any]:
    def counted(*given: Any, **named: Any) -> Any:
        made[name] += 1
        return what(*given, **named)

    return counted


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_a_path_that_is_demanded_through_the_inverse_leaves_the_loops_little(name):
    """Feedforward is an argument of either rig, and the prediction knows it."""
    make = Rig.hexapod
    if name == "arm":
        make = partial(Rig.of_mjcf, HEXAPOD_MJCF.with_name("arm.xml"), major=[0, 1], crossover=0.7)
    rms = {}
    for feedforward in (True, False):
        one = make(feedforward=feedforward)
        path = one.path("circle", duration_s=1.0)
        run = one.fly(one.controller(), path)
        rms[feedforward] = np.linalg.norm(run.rms())
        predicted = one.predict(path, noise=run.measured - run.true)
        assert rms[feedforward] == pytest.approx(np.linalg.norm(predicted.rms_before), rel=0.05)
    assert rms[True] < 0.05 * rms[False]  # what is left is noise


def test_every_pilot_demands_the_path_through_the_inverse():
    """Until something fails one that diagnoses, or is told later, flies as one that does not."""
    one, path = rig("arm"), path_of("arm", 0.1)
    pilot = one.controller()
    pilots = pilot, one.supervisor("none"), OracleController(pilot, pilot, None)
    plain, *others = (one.fly(each, path).inputs for each in pilots)
    for each in others:
        np.testing.assert_array_equal(each, plain)
    assert one.feedforward_demands(path) is not None
    assert rig("hexapod").feedforward_demands(path) is None  # as in the paper


class _Events:
    """Pushes the payload for a while, and reads and sends with an offset."""

    def __init__(self) -> None:
        self.ticks: dict[str, list[int]] = {"plant": [], "measured": [], "sent": []}

    def plant(self, tick: int, model: Any, data: Any) -> None:
        self.ticks["plant"].append(tick)
        data.xfrc_applied[-1, 2] = 0.5 if 100 <= tick < 200 else 0.0

    def measured(self, tick: int, reading: Any) -> Any:
        self.ticks["measured"].append(tick)
        return reading._replace(output=reading.output + 1e-6)

    def sent(self, tick: int, inputs: np.ndarray) -> np.ndarray:
        self.ticks["sent"].append(tick)
        return 1.01 * inputs


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_events_do_to_the_machine_what_they_are_asked_to(name):
    one, path = rig(name), np.zeros((300, 2))
    events, pilot = _Events(), one.controller()
    run, quiet = one.fly(pilot, path, events=events), one.fly(pilot, path)
    assert all(ticks == list(range(300)) for ticks in events.ticks.values())
    np.testing.assert_allclose(run.measured[0] - quiet.measured[0], 1e-6, atol=1e-15)
    before, during = np.abs(run.task - quiet.task)[90], np.abs(run.task - quiet.task)[150]
    assert np.linalg.norm(during[3:]) > 3.0 * np.linalg.norm(before[3:])
    with pytest.raises(TypeError, match="events must have plant, measured or sent"):
        one.fly(pilot, path, events=object())


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_inputs_that_are_changed_in_place_are_like_others_and_no_memory_of_the_pilot(name):
    class InPlace:
        def sent(self, tick: int, inputs: np.ndarray) -> np.ndarray:
            inputs *= 1.01
            return inputs

    class Anew:
        def sent(self, tick: int, inputs: np.ndarray) -> np.ndarray:
            return 1.01 * inputs

    one, path = rig(name), path_of(name, 0.1)
    runs = [one.fly(one.controller(), path, events=events()) for events in (InPlace, Anew)]
    np.testing.assert_array_equal(runs[0].true, runs[1].true)
    np.testing.assert_array_equal(runs[0].inputs, runs[1].inputs)


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_a_mismatch_is_of_the_plant_alone_and_a_seed_repeats_it(name):
    one, path = rig(name), path_of(name, 0.3)
    drawn = [one.drawn("all", seed) for seed in (3, 3, 4)]
    runs = [each.fly(each.controller(), path, seed=1).true for each in drawn]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
    np.testing.assert_array_equal(drawn[0].nominal.plant.A, one.nominal.plant.A)
    same = rig(name, "all")
    np.testing.assert_array_equal(same.fly(same.controller(), path, seed=1).true, runs[0])
    with pytest.raises(WrongInput, match='mismatch must be "exact", "all" or a Mismatch, got'):
        one.drawn("ALL", 0)  # type: ignore[arg-type]
    with pytest.raises(WrongInput, match="no mismatch of"):
        one.drawn(Mismatch(steps=2, floor_um_per_s=1.0), 0)


def test_a_robot_starts_where_it_is_told_to():
    start = np.array([0.1, 0.5, 0.2, -1.2, 0.1, 0.6, 0.0])
    file = HEXAPOD_MJCF.with_name("arm.xml")
    one = Rig.of_mjcf(file, major=[3, 4, 5], start=start)
    np.testing.assert_allclose(one.fly(one.controller(), np.zeros((2, 3))).qpos[0], start)
    with pytest.raises(ValueError, match="start"):
        Rig.of_mjcf(file, major=[3, 4, 5], start=start[:3])
    with pytest.raises(ValueError, match='pinned: the model has no site or body "foot"'):
        Rig.of_mjcf(file, major=[3, 4, 5], pinned=["foot"])


DESK = """
<mujoco>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <body name="upper" pos="0 0 0.5">
      <joint name="shoulder" axis="0 1 0" damping="1" armature="0.05"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      <body name="lower" pos="0.3 0 0" euler="0 60 0">
        <joint name="elbow" axis="0 1 0" damping="1" armature="0.05"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="0.5"/>
        <site name="tool" pos="0.3 0 0"/>
        <body name="finger" pos="0.3 0 0">
          <joint name="finger" axis="1 0 0" stiffness="0.1" damping="0.01" springref="20"/>
          <geom size="0.01" mass="0.02" contype="0" conaffinity="0"/>
        </body>
      </body>
    </body>
    <body name="cup" pos="1 1 0.06">
      <freejoint/>
      <geom type="box" size=".05 .05 .05" mass="0.2"/>
    </body>
  </worldbody>
  <actuator>
    <position name="m1" joint="shoulder" kp="300" kv="30"/>
    <position name="m2" joint="elbow" kp="200" kv="20"/>
  </actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def at_a_desk(tmp_path_factory):
    """An arm with a finger on a spring, beside a cup."""
    file = tmp_path_factory.mktemp("desk") / "desk.xml"
    file.write_text(DESK)
    return file


def test_a_robot_among_other_things_flies_as_predicted_and_says_what_it_leaves_out(at_a_desk):
    """The finger follows on its spring, the cup stays: both are in the physics alone."""
    one = Rig.of_mjcf(at_a_desk, site="tool", major=[3, 5])
    assert one.actuators == ("m1", "m2")
    assert one.left_out == ("finger", "cup")
    assert "finger, cup" in one.warnings[0]
    path = one.path("circle", duration_s=1.0)
    run = one.fly(one.controller(), path)
    expected = one.predict(path, noise=run.measured - run.true).rms_before
    np.testing.assert_allclose(run.rms(), expected, rtol=0.05)
    cup = one.model.joint(one.model.body("cup").jntadr[0]).qposadr[0]
    assert np.ptp(run.qpos[:, cup : cup + 3], axis=0).max() < 1e-4


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"joint_weight": "1,2,3"}, "joint_weight must be one number or 2"),
        ({"size": -1.0}, "size must be a number from"),
        ({"start": "home"}, 'the model has no keyframe "home"; it has none'),
        ({"pinned": ["tool", ""]}, "pinned must be NAME or NAME:point"),
    ],
)
def test_python_refuses_by_the_names_of_its_arguments(at_a_desk, wrong, said):
    with pytest.raises((WrongInput, ValueError), match=f"^{said}"):
        Rig.of_mjcf(at_a_desk, **({"site": "tool", "major": [3, 5]} | wrong))


def test_a_rig_prints_itself_in_a_line_and_takes_a_body_as_jacobians_do(at_a_desk):
    """Its arrays and matrices would fill pages where somebody looks at it."""
    model = load_model(at_a_desk)
    body = int(model.site("tool").bodyid[0])
    one = Rig.of_mjcf(at_a_desk, site=Body(body), major=[1])
    assert one.actuators == Rig.of_mjcf(at_a_desk, site=body, major=[1]).actuators
    run = one.fly(one.controller(), np.zeros((3, 1)))
    for shown in (repr(one), repr(run)):
        assert len(shown) < 200 and "\n" not in shown
    assert one.actuators[0] in repr(one) and run.status in repr(run)


def test_weights_and_pins_are_numbers_and_names_in_python(at_a_desk):
    one = Rig.of_mjcf(at_a_desk, site="tool", major=[3, 5], joint_weight=[1.0, 4.0])
    assert one.goal.joint_weight == (1.0, 4.0)


def test_a_finger_on_one_cable_flies_as_its_springs_have_it(tmp_path):
    """One cable for two joints: their springs say how they share its way."""
    file = tmp_path / "finger.xml"
    file.write_text(FINGER)
    one = Rig.of_mjcf(file, site="tip", major=[5])
    path = one.path("circle", duration_s=2.0)
    run = one.fly(one.controller(), path)
    assert run.rms() < 2e-3 * one.size
