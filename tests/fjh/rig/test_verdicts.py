"""What is left of a major task: one verdict for each condition, the same as one by one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig.conditions import (
    FREE,
    LETTERS,
    LOCKED,
    codes_of,
    every_condition,
    failed,
    failures_of,
    few_failures,
    with_failures,
)
from fjh.rig.verdicts import KEPT, names_of, verdicts
from prioritized import ConstrainedSystem, failure_atlas
from tests.random_systems import SEEDS


@given(SEEDS, st.integers(1, 3), st.booleans())
def test_a_verdict_says_what_the_failed_mechanism_says_of_itself(seed, directions, springs):
    """Random loops of four actuators, two of them alike, and two passive joints."""
    rng = np.random.default_rng(seed)
    J_T, J_C = rng.normal(size=(4, 6)), rng.normal(size=(1, 6))
    J_T[:, 1], J_C[:, 1] = J_T[:, 0], J_C[:, 0]
    stiffness = np.diag(rng.uniform(0, 1, 6).round()) if springs else None
    system = ConstrainedSystem(J_T, J_C, range(4), stiffness=stiffness)
    major = list(range(directions))
    found = verdicts(failure_atlas(system, major))
    assert np.sum([each.holds for each in found], axis=0).tolist() == [1] * 81
    assert np.sum([each.by_failures for each in found], axis=0).tolist() == [1, 8, 24, 32, 16]
    rigid = ConstrainedSystem(J_T, J_C, range(4))
    for row in rng.choice(81, 5, replace=False):
        codes, name = codes_of(every_condition(4)[row]), names_of(found)[row]
        kinds = {"locked": failed(codes, range(4), LOCKED), "free": failed(codes, range(4), FREE)}
        alone = rigid.with_failures(**kinds).kinematics().manipulability(major)
        held = system.with_failures(**kinds).kinematics().manipulability(major)
        possible = [not (one.unmanipulable or one.unstable_major) for one in (alone, held)]
        left = directions - held.bases["unmanipulable"].shape[1]
        assert (name in KEPT) == any(possible)
        if springs:
            assert (name == "rigid") == possible[0]
        if not any(possible):
            directions_left = {0: "none", 1: "one_direction", 2: "two_directions"}
            assert name == ("drifts" if held.unstable_major else directions_left[left])


def test_failures_are_what_a_condition_says():
    found = [(each.actuator, each.kind, each.time_s) for each in failures_of("SLFSB", 0.5)]
    assert found == [(1, "locked", 0.5), (2, "free", 0.5), (4, "loose", 0.5)]


def test_conditions_are_in_the_order_of_an_atlas():
    atlas = failure_atlas(ConstrainedSystem(np.ones((1, 3)), None, range(3)), [0])
    assert every_condition(3) == tuple("".join(LETTERS[c] for c in row) for row in atlas.codes)
    expected = [[0, 0], [1, 0], [2, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 1], [2, 2]]
    assert few_failures(2).tolist() == expected
    assert with_failures(3, 2)[[0, 4, 8]].tolist() == [[1, 1, 0], [1, 0, 1], [0, 1, 1]]
