"""Test names of joints and actuators in arguments, errors, and sentences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas
from prioritized._mechanism.names import Names

NAMES = Names(
    velocities=("hip", "knee", "wrist", "wrist", "coupler", "ball", "ball", ""),
    actuators=(("hip_motor",), ("pull", "push"), ("roll",), ("pitch",)),
)
"""Names with a muscle pair on the knee, two motors on the wrist, and an unnamed passive joint."""


def arm(names: Names | None = NAMES) -> ConstrainedSystem:
    rng = np.random.default_rng(0)
    J_T, J_C = rng.normal(size=(3, 8)), rng.normal(size=(3, 8))
    return ConstrainedSystem(J_T, J_C, [0, 1, 2, 3], names=names)


def mechanism_of(joints, motors, J_C=None) -> ConstrainedSystem:
    """Return a mechanism of joints and motors with these names; its first joint is its task."""
    names, n = Names(tuple(joints), tuple(motors)), len(motors)
    return ConstrainedSystem(np.eye(1, len(joints)), J_C, range(n), names=names)


@pytest.mark.parametrize(
    ("listed", "numbered"),
    [
        ({"locked": ["knee"]}, {"locked": [1]}),
        ({"locked": ["push"], "free": ["hip_motor"]}, {"locked": [1], "free": [0]}),
        ({"locked": ["push", "knee", 1, "hip"]}, {"locked": [0, 1]}),
        ({"free": np.array(["roll", "hip"])}, {"free": np.array([0, 2])}),
        ({"locked_passive": ["ball"]}, {"locked_passive": [5, 6]}),
        ({"locked_passive": ["coupler", 7]}, {"locked_passive": [4, 7]}),
    ],
)
def test_a_name_is_equivalent_to_its_number(listed, numbered):
    assert arm().with_failures(**listed).failures == arm(None).with_failures(**numbered).failures


@pytest.mark.parametrize(
    ("failures", "message"),
    [
        ({"locked": ["kne"]}, "'kne': the nearest is 'knee'"),
        ({"free": ["xyz"]}, "there are hip, hip_motor, knee, pull, push, roll"),
        ({"locked": ["wrist"]}, "'wrist', which means roll, pitch"),
        ({"locked": ["coupler"]}, "passive joint 'coupler': .* put it in locked_passive"),
        ({"locked": "knee"}, r"'knee': write \['knee'\]"),
        ({"locked": ["knee"], "free": ["pull"]}, "locked or free, got both for knee"),
        ({"locked_passive": ["hip", 1]}, "got the actuated hip, knee: put"),
    ],
)
def test_a_wrong_name_raises_one_sentence_with_advice(failures, message):
    with pytest.raises(ValueError, match=f"^{next(iter(failures))} must|^an actuator") as error:
        arm().with_failures(**failures)
    assert error.match(message)
    with pytest.raises(ValueError, match=r"must be numbers .*ConstrainedSystem\.of"):
        arm(None).with_failures(locked_passive=["knee"])


def test_actuators_without_names_are_listed_by_number():
    for system, message in [
        (mechanism_of(["hip", ""], [(), ()]), "hip, 1"),
        (arm(None), r"\[0, 1\]"),
    ]:
        with pytest.raises(ValueError, match=f"got both for {message}"):
            system.with_failures(locked=[0, 1], free=[0, 1])


def test_a_wrong_number_of_names_raises():
    with pytest.raises(ValueError, match="8 velocities and 3 actuators, got 8 and 4"):
        ConstrainedSystem(np.ones((1, 8)), None, [0, 1, 2], names=NAMES)


def test_the_atlas_accepts_and_lists_names():
    atlas, unnamed = failure_atlas(arm(), [0]), failure_atlas(arm(None), [0])
    assert atlas.describe(0) == unnamed.describe(0) == "healthy"
    row = atlas.row(locked=["knee"], free=["hip_motor"])
    assert atlas.describe(row) == "knee locked, hip free"
    assert unnamed.row(locked=[1], free=[0]) == row
    assert unnamed.describe(row) == "actuator 1 locked, actuator 0 free"
    for code, labels in zip(atlas.codes, map(atlas.describe, range(81)), strict=True):
        pieces = [] if labels == "healthy" else labels.split(", ")
        locked, free = (
            [piece.removesuffix(end) for piece in pieces if piece.endswith(end)]
            for end in (" locked", " free")
        )
        np.testing.assert_array_equal(atlas.codes[atlas.row(locked, free)], code)
    with pytest.raises(ValueError, match="the nearest is 'knee'"):
        atlas.row(free=["kneee"])


def test_sentences_contain_the_names_of_the_joints():
    """Check geared hip and knee, a rod that spins in two ball joints, and an unreachable slide."""
    J_C = np.array([[2.0, -1.0, 0, 0, 0], [0, 0, 0, 1.0, -1.0]])
    joints = "hip", "knee", "slide", "ball", "socket"
    report = mechanism_of(joints, (("m",), (), ()), J_C).kinematics().manipulability([0])
    sentences = {name: finding.sentence for name, finding in report.findings.items()}
    assert "(of hip, knee)" in sentences["constrained_active"]
    assert "(of ball, socket)" in sentences["unobservable"]
    without = ConstrainedSystem(np.eye(1, 5), J_C, [0, 1, 2]).kinematics().manipulability([0])
    assert "(" not in str(without)
    assert report.gaps == without.gaps
    # The largest shares come first, at most five.
    shares = np.array([[3.0, 1, 8, 5, 4, 7, 6, 0.1]])
    eight = mechanism_of("abcdefgh", ((),) * 8, shares)
    assert "(of c, f, g, d, e and 2 more)" in str(eight.kinematics().manipulability([0]))
    # The name "hip" of both cable and joint refers to motor m1, also after a failure of the joint.
    meshed = mechanism_of(("hip", "hip", "rod"), (("m0",), ("m1",)), [[0.0, 1.0, -2.0]])
    failed = meshed.with_failures(locked=["m0"], free=["m1"])
    assert (
        "(of m1, rod)" in failed.kinematics().manipulability([0]).findings["unobservable"].sentence
    )


@given(st.data())
def test_each_actuator_has_a_unique_label(data):
    """Check any names of joints and actuators, including names like the generated labels."""
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
        equal = [(joint, tuple(filter(None, m))) for joint, m in zip(joints, motors, strict=True)]
        servo = {i for i in range(n) if equal[i] == equal[k]} if equal[k][1] else {k}
        assert meant.setdefault(word, frozenset(servo)) == servo
        assert system.with_failures(locked=[word]).failures.locked == servo
