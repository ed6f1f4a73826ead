"""Joints and actuators by name: in arguments, in errors, in sentences."""

import copy
import dataclasses
import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas
from prioritized._mechanism.failures import Failures
from prioritized._mechanism.names import Names
from tests.random_systems import SEEDS, motions, null, systems

NAMES = Names(
    velocities=("hip", "knee", "wrist", "wrist", "coupler", "ball", "ball", ""),
    actuators=(("hip_motor",), ("pull", "push"), ("roll",), ("pitch",)),
)
"""A muscle pair drives the knee, two motors the wrist; one passive joint has no name."""
RNG = np.random.default_rng(0)
J_T, J_C = RNG.normal(size=(3, 8)), RNG.normal(size=(3, 8))
ACTIVE = [0, 1, 2, 3]
SYSTEM = ConstrainedSystem(J_T, J_C, ACTIVE, names=NAMES)
UNNAMED = ConstrainedSystem(J_T, J_C, ACTIVE)


@dataclass
class Linearization:
    """What `sim` gives; names are of any class that has them, springs absent."""

    J_T: Any = dataclasses.field(default_factory=lambda: J_T)
    J_C: Any = dataclasses.field(default_factory=lambda: J_C)
    active: Any = dataclasses.field(default_factory=lambda: np.array(ACTIVE))
    names: Any = NAMES
    stiffness: Any = None
    geometry_accuracy: Any = None


@pytest.mark.parametrize(
    ("named", "numbered"),
    [
        ({"locked": ["knee"]}, {"locked": [1]}),
        ({"locked": ["push"], "free": ["hip_motor"]}, {"locked": [1], "free": [0]}),
        ({"locked": ["push", "knee", 1, "hip"]}, {"locked": [0, 1]}),
        ({"free": np.array(["roll", "hip"])}, {"free": np.array([0, 2])}),
        ({"locked_passive": ["ball"]}, {"locked_passive": [5, 6]}),
        ({"locked_passive": ["coupler", 7]}, {"locked_passive": [4, 7]}),
    ],
)
def test_a_name_means_the_number_it_stands_for(named, numbered):
    assert SYSTEM.with_failures(**named).failures == UNNAMED.with_failures(**numbered).failures


@pytest.mark.parametrize(
    ("failures", "message"),
    [
        ({"locked": ["kne"]}, "^locked must name actuators .*, got 'kne': the nearest is 'knee'$"),
        ({"free": ["xyz"]}, "^free must name .*: there are hip, hip_motor, knee, pull, push, roll"),
        ({"locked_passive": ["balls"]}, "locked_passive must name joints, .* nearest is 'ball'"),
        (
            {"locked": ["wrist"]},
            "locked must name one actuator, got 'wrist', which means roll, pit",
        ),
        (
            {"locked": ["coupler"]},
            "^locked must name actuators or the joints that they drive, got the passive joint "
            "'coupler': if it is stuck, put it in locked_passive$",
        ),
        ({"free": ["hip", "ball"]}, "^free must name .*, got the passive joint 'ball': if it is"),
        ({"locked": [""]}, "locked must name actuators or the joints that they drive, got ''"),
        ({"locked": "knee"}, r"locked must be a list, got 'knee': write \['knee'\]"),
        ({"locked": ["knee"], "free": ["pull"]}, "either locked or free, got both for knee$"),
        ({"locked_passive": ["hip", 1]}, "passive velocities, got the actuated hip, knee: put"),
        ({"locked": [4]}, r"locked must lie in 0\.\.3, got \[4\]"),
        ({"locked": ["knee", 0.5]}, r"locked must be a list of integers, got \[0\.5\]"),
    ],
)
def test_a_wrong_name_is_one_sentence_with_the_nearest_that_exists(failures, message):
    with pytest.raises(ValueError, match=message):
        SYSTEM.with_failures(**failures)


@pytest.mark.parametrize("argument", ["locked", "free", "locked_passive"])
def test_a_mechanism_without_names_says_how_it_gets_some(argument):
    with pytest.raises(ValueError, match=f"^{argument} must be numbers .*ConstrainedSystem.of$"):
        UNNAMED.with_failures(**{argument: ["knee"]})


@pytest.mark.parametrize(
    ("names", "error", "message"),
    [
        (["hip"], TypeError, r"names must have lists velocities and actuators, got \['hip'\]"),
        (Names(("hip",), ()), ValueError, "8 velocities and 4 actuators, got 1 and 0"),
        (Names((1,) * 8, NAMES.actuators), ValueError, "names must be strings"),  # type: ignore
        (Names(NAMES.velocities, ("hip",) * 4), ValueError, "a tuple of strings"),  # type: ignore
    ],
)
def test_names_that_do_not_fit_are_refused(names, error, message):
    with pytest.raises(error, match=message):
        ConstrainedSystem(J_T, J_C, ACTIVE, names=names)


def test_names_stay_whatever_becomes_of_the_system():
    changed = [
        SYSTEM.at(2 * J_T, J_C[:2]),
        SYSTEM.with_failures(locked=["hip"]),
        dataclasses.replace(SYSTEM, J_T=2 * J_T),
        pickle.loads(pickle.dumps(SYSTEM)),
        copy.copy(SYSTEM),
        copy.deepcopy(SYSTEM),
    ]
    for system in changed:
        assert system.names == NAMES
        assert system.with_failures(locked=["knee"]).failures.locked >= {1}
    lists = Linearization(names=Names(list(NAMES.velocities), [list(a) for a in NAMES.actuators]))  # type: ignore
    assert ConstrainedSystem.of(lists).names == NAMES


def test_a_system_says_what_it_is():
    assert str(SYSTEM) == "8 velocities, 3 constraints, 4 actuators: sound."
    failed = {"locked": ["knee"], "free": ["pitch", "hip"], "locked_passive": ["ball", 7]}
    assert str(SYSTEM.with_failures(**failed)).endswith(
        ": knee locked, hip free, pitch free, ball stuck, velocity 7 stuck."
    )
    unnamed = UNNAMED.with_failures(locked=[1], locked_passive=[5, 6])
    assert str(unnamed).endswith(": actuator 1 locked, velocity 5 stuck, velocity 6 stuck.")
    slide = ConstrainedSystem([[1.0]], [[0.0]], [0])
    assert str(slide) == "1 velocity, 1 constraint, 1 actuator: sound."


def test_the_atlas_speaks_and_understands_names():
    atlas, unnamed = failure_atlas(SYSTEM, [0]), failure_atlas(UNNAMED, [0])
    assert atlas.describe(0) == unnamed.describe(0) == "sound"
    row = atlas.row(locked=["knee"], free=["hip_motor"])
    assert atlas.describe(row) == "knee locked, hip free"
    assert unnamed.row(locked=[1], free=[0]) == row
    assert unnamed.describe(row) == "actuator 1 locked, actuator 0 free"
    for code, words in zip(atlas.codes, map(atlas.describe, range(81)), strict=True):
        pieces = [] if words == "sound" else words.split(", ")
        locked, free = (
            [piece.removesuffix(end) for piece in pieces if piece.endswith(end)]
            for end in (" locked", " free")
        )
        np.testing.assert_array_equal(atlas.codes[atlas.row(locked, free)], code)
    with pytest.raises(ValueError, match=r"row must lie in 0\.\.80, got 81"):
        atlas.describe(81)
    with pytest.raises(ValueError, match="the nearest is 'knee'"):
        atlas.row(free=["kneee"])


def test_sentences_name_the_joints_concerned():
    """Geared hip and knee forbid each other; a rod spins by its two ball joints; a slide is out."""
    J_C = np.array([[2.0, -1.0, 0, 0, 0], [0, 0, 0, 1.0, -1.0]])
    names = Names(("hip", "knee", "slide", "ball", "socket"), (("m",), (), ()))
    task = np.eye(2, 5)
    report = ConstrainedSystem(task, J_C, [0, 1, 2], names=names).kinematics().manipulability([0])
    sentences = {name: finding.sentence for name, finding in report.findings.items()}
    assert "in one direction (of hip, knee); torques" in sentences["constrained_active"]
    assert "in one direction (of ball, socket) without" in sentences["idle"]
    without = ConstrainedSystem(task, J_C, [0, 1, 2]).kinematics().manipulability([0])
    assert "(" not in str(without)
    assert report.gaps == without.gaps


def test_a_sentence_names_a_handful_of_joints_those_with_the_largest_share_first():
    shares = np.array([[3.0, 1, 8, 5, 4, 7, 6, 0.1]])
    names = Names(tuple("abcdefgh"), ((),) * 8)
    system = ConstrainedSystem(np.eye(1, 8), shares, range(8), names=names)
    assert "(of c, f, g, d, e and 2 more)" in str(system.kinematics().manipulability([0]))


def test_a_mechanism_from_a_model_brings_its_springs_on_request():
    soft = Linearization(stiffness=np.ones(8))
    assert ConstrainedSystem.of(soft).stiffness is None
    np.testing.assert_array_equal(ConstrainedSystem.of(soft, springs=True).stiffness, np.eye(8))
    with pytest.raises(ValueError, match=r"^springs must be False for a mechanism without stiff"):
        ConstrainedSystem.of(Linearization(), springs=True)
    with pytest.raises(TypeError, match=r"^springs must be True or False, got 'x'$"):
        ConstrainedSystem.of(soft, springs="x")  # type: ignore
    with pytest.raises(TypeError, match=r"^mechanism must have J_T, J_C and active, got 3$"):
        ConstrainedSystem.of(3)  # type: ignore
    made = ConstrainedSystem.of(Linearization(geometry_accuracy=1e-7))
    assert made.geometry_accuracy == 1e-7
    given = ConstrainedSystem.of(Linearization(geometry_accuracy=1e-7), geometry_accuracy=1e-4)
    assert given.rank_tolerance == 10 * 1e-4
    for name in ("J_T", "J_C", "active"):
        np.testing.assert_array_equal(getattr(made, name), getattr(SYSTEM, name))
    assert made.failures == Failures()


@given(st.data(), systems(), SEEDS)
def test_all_velocities_come_in_the_order_of_the_columns(data, drawn, seed):
    """They close the loops, move the task by J rates, and leave stuck joints exactly at rest."""
    n, N = len(drawn.system.active), drawn.system.J_T.shape[1]
    passive = sorted(set(range(N)) - set(drawn.system.active.tolist()))
    locked = data.draw(st.sets(st.integers(0, n - 1)))
    stuck = data.draw(st.sets(st.sampled_from(passive), max_size=1)) if passive else set()
    system = drawn.system.with_failures(locked=locked, locked_passive=stuck)
    kin = system.kinematics()
    Z = null(kin.active_constraint)
    rates = (Z @ np.random.default_rng(seed).normal(size=(Z.shape[1], 4))).T.reshape(2, 2, -1)
    velocities = kin.velocities(rates)
    assert velocities.shape == (2, 2, N)
    np.testing.assert_array_equal(velocities[..., kin.active], rates)
    np.testing.assert_array_equal(velocities[..., system.stuck], 0.0)
    allowed = motions(system)
    np.testing.assert_allclose(velocities @ allowed @ allowed.T, velocities, atol=1e-7)
    np.testing.assert_allclose(velocities @ system.J_T.T, rates @ kin.J.T, atol=1e-7)
    np.testing.assert_allclose(kin.velocities(rates[0, 0]), velocities[0, 0], atol=1e-12)
    with pytest.raises(ValueError, match=r"^rates must have shape"):
        kin.velocities(np.ones(len(kin.active) + 1))


def test_an_actuator_with_several_velocities_fails_in_all_of_them():
    """An orientation servo moves a ball joint about three axes, which lock together."""
    J = np.eye(3, 4)
    names = Names(("x", "servo", "servo", "servo"), (("m",), *[("servo",)] * 3))
    system = ConstrainedSystem(J, None, [0, 1, 2, 3], names=names)
    assert system.with_failures(locked=["servo"]).failures.locked == {1, 2, 3}
    assert str(system.with_failures(locked=["servo"])).endswith("servo locked.")


CROSSED = Names(("knee", "hip", "hip", ""), (("hip",), ("knee",), ("m1",), ()))
"""The motors of knee and hip have each other's name; a tendon is called "hip" like the joint."""


def test_no_two_actuators_are_described_by_the_same_word():
    system = ConstrainedSystem(np.eye(4), None, range(4), names=CROSSED)
    failed = system.with_failures(locked=[0, 1, 2, 3])
    words = "knee (0) locked, hip (1) locked, m1 locked, actuator 3 locked"
    assert str(failed) == f"4 velocities, 0 constraints, 4 actuators: {words}."
    with pytest.raises(ValueError, match=r"got 'knee', which means knee \(0\), hip \(1\)$"):
        system.with_failures(locked=["knee"])
    assert system.with_failures(locked=["hip (1)", "m1"]).failures.locked == {1, 2}
    atlas = failure_atlas(system, [0], codes=[[2, 1, 0, 0]])
    assert atlas.describe(0) == "hip (1) locked, knee (0) free"


def test_findings_use_the_words_of_the_system():
    """A cable called "hip" like the joint is its motor m1, also after a failure of the joint."""
    names = Names(("hip", "hip", "rod"), (("m0",), ("m1",)))
    geared = ConstrainedSystem(np.eye(1, 3), [[2.0, -1.0, 0.0]], [0, 1], names=names)
    findings = geared.kinematics().manipulability([0]).findings
    assert "(of m0, m1); torques" in findings["constrained_active"].sentence
    meshed = ConstrainedSystem(np.eye(1, 3), [[0.0, 1.0, -2.0]], [0, 1], names=names)
    released = meshed.with_failures(locked=["m0"], free=["m1"])
    idle = released.kinematics().manipulability([0]).findings["idle"]
    assert "(of m1, rod) without" in idle.sentence


@given(st.data())
def test_each_actuator_has_a_word_of_its_own_that_means_it_alone(data):
    """Whatever joints and actuators are called, even like the words made for others."""
    name = st.sampled_from(["", "a", "b", "c", "a (0)", "b (1)", "a (0) (0)"])
    driving = st.lists(name, max_size=2).map(tuple)
    n = data.draw(st.integers(1, 5))
    joints = data.draw(st.lists(name, min_size=n, max_size=n))
    motors = data.draw(st.lists(driving, min_size=n, max_size=n))
    system = ConstrainedSystem(np.eye(n), None, range(n), names=Names(tuple(joints), tuple(motors)))
    atlas = failure_atlas(system, [0], codes=np.eye(n))
    meant: dict[str, frozenset[int]] = {}
    for k in range(n):
        word = atlas.describe(k).removesuffix(" locked")
        if word == f"actuator {k}":
            assert not joints[k] and not any(motors[k])
            continue
        alike = [(joint, tuple(filter(None, m))) for joint, m in zip(joints, motors, strict=True)]
        servo = {i for i in range(n) if alike[i] == alike[k]} if alike[k][1] else {k}
        assert meant.setdefault(word, frozenset(servo)) == servo
        assert system.with_failures(locked=[word]).failures.locked == servo


def test_a_joint_and_its_motor_are_not_the_two_motors_of_a_joint_without_a_name():
    names = Names(("a", ""), (("b",), ("a", "b")))
    system = ConstrainedSystem(np.eye(2), None, range(2), names=names)
    for actuator, word in enumerate(("a (0)", "a (1)")):
        assert system.with_failures(locked=[word]).failures.locked == {actuator}
        assert word in str(system.with_failures(locked=[actuator]))


def test_a_servo_that_shares_a_name_with_a_joint_is_described_once():
    names = Names(("hip", "hip", "hip", "hip"), (("m",), *[("hip",)] * 3))
    system = ConstrainedSystem(np.eye(4), None, range(4), names=names)
    assert str(system.with_failures(locked=range(4))).endswith(": m locked, hip (1) locked.")
    assert system.with_failures(locked=["hip (1)"]).failures.locked == {1, 2, 3}
    with pytest.raises(ValueError, match=r"got 'hip', which means m, hip \(1\)$"):
        system.with_failures(locked=["hip"])


def test_motors_without_names_on_one_ball_joint_are_not_one_servo():
    system = ConstrainedSystem(np.eye(2), None, range(2), names=Names(("ball",) * 2, ((), ())))
    assert str(system.with_failures(locked=[1])).endswith("ball (1) locked.")
    with pytest.raises(ValueError, match=r"which means ball \(0\), ball \(1\)$"):
        system.with_failures(locked=["ball"])


def test_a_proxy_of_a_mechanism_is_one():
    """It lists no attributes of its own, and has them all the same."""

    class Proxy:
        def __getattr__(self, name: str) -> object:
            return getattr(whole, name)

    whole = ConstrainedSystem(np.eye(2), None, [0, 1])
    proxy: Any = Proxy()
    np.testing.assert_array_equal(ConstrainedSystem.of(proxy).J_T, whole.J_T)
    absent: Any = object()
    with pytest.raises(TypeError, match=r"^mechanism must have J_T, J_C and active"):
        ConstrainedSystem.of(absent)
