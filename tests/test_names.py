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

from prioritized import ConstrainedSystem, Failures, Names, failure_atlas
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
        ({"locked": ["coupler"]}, "locked must name actuators or the joints that they drive, got"),
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
