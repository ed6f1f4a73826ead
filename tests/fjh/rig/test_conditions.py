"""Analysis of failure conditions: each result equals that of the condition alone."""

from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig.classification import POSSIBLE, classifications, names_of
from fjh.rig.condition_analysis import LEAST_LEFT, analyze_conditions
from fjh.rig.conditions import (
    CODE_LETTERS,
    FREE,
    LOCKED,
    codes_of,
    every_condition,
    failed,
    failures_of,
    few_failures,
    with_failures,
)
from prioritized import ConstrainedSystem, failure_atlas
from tests.random_systems import SEEDS, systems


@given(SEEDS, st.integers(1, 3), st.booleans())
def test_a_classification_equals_that_of_the_failed_mechanism(seed, directions, springs):
    """Systems are random loops of four actuators, two of them equal, and two passive joints."""
    rng = np.random.default_rng(seed)
    J_T, J_C = rng.normal(size=(4, 6)), rng.normal(size=(1, 6))
    J_T[:, 1], J_C[:, 1] = J_T[:, 0], J_C[:, 0]
    stiffness = np.diag(rng.uniform(0, 1, 6).round()) if springs else None
    system = ConstrainedSystem(J_T, J_C, range(4), stiffness=stiffness)
    major = list(range(directions))
    classes = classifications(failure_atlas(system, major))
    assert np.sum([each.holds for each in classes], axis=0).tolist() == [1] * 81
    assert np.sum([each.by_failures for each in classes], axis=0).tolist() == [1, 8, 24, 32, 16]
    rigid = ConstrainedSystem(J_T, J_C, range(4))
    for row in rng.choice(81, 5, replace=False):
        codes, name = codes_of(every_condition(4)[row]), names_of(classes)[row]
        kinds = {"locked": failed(codes, range(4), LOCKED), "free": failed(codes, range(4), FREE)}
        alone = rigid.with_failures(**kinds).kinematics().manipulability(major)
        elastic = system.with_failures(**kinds).kinematics().manipulability(major)
        possible = [not (one.unmanipulable or one.unstable_major) for one in (alone, elastic)]
        left = directions - elastic.bases["unmanipulable"].shape[1]
        assert (name in POSSIBLE) == any(possible)
        if springs:
            assert (name == "rigid") == possible[0]
        if not any(possible):
            directions_left = {0: "none", 1: "one_direction", 2: "two_directions"}
            assert name == ("drifts" if elastic.unstable_major else directions_left[left])


def test_code_letters_give_failures():
    failures = [(each.actuator, each.kind, each.time_s) for each in failures_of("SLFSB", 0.5)]
    assert failures == [(1, "locked", 0.5), (2, "free", 0.5), (4, "loose", 0.5)]


def test_conditions_are_in_the_order_of_an_atlas():
    atlas = failure_atlas(ConstrainedSystem(np.ones((1, 3)), None, range(3)), [0])
    assert every_condition(3) == tuple("".join(CODE_LETTERS[c] for c in row) for row in atlas.codes)
    expected = [[0, 0], [1, 0], [2, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 1], [2, 2]]
    assert few_failures(2).tolist() == expected
    assert with_failures(3, 2)[[0, 4, 8]].tolist() == [[1, 1, 0], [1, 0, 1], [0, 1, 1]]


@given(systems(actives=(2, 3), tasks=(1, 3)), st.data())
def test_each_condition_equals_its_separate_analysis(random_system, data):
    """The reference are its own classification and attainable set; speed decides, and gains."""
    system, n, m = (
        random_system.system,
        len(random_system.system.active),
        len(random_system.system.J_T),
    )
    major = data.draw(st.lists(st.integers(0, m - 1), min_size=1, unique=True))
    limits = -random_system.rng.uniform(0.5, 2, n), random_system.rng.uniform(0.5, 2, n)
    codes = few_failures(n)
    analysis = analyze_conditions(system, major, codes, rates=limits)
    assert analysis.classes.worst_speed is not None
    healthy = precision = 0.0
    for row, code in enumerate(codes):
        locked, free = (np.flatnonzero(code == kind) for kind in (LOCKED, FREE))
        kin = system.with_failures(locked, free).kinematics()
        report = kin.manipulability(major)
        lost = report.unmanipulable or report.unstable_major
        radius = 0.0 if lost else kin.attainable(major, limits).radius
        if row == 0:
            healthy, precision = radius, report.largest_gain
        share = 0.0
        if healthy and not lost:
            share = min(radius / healthy, precision / report.largest_gain)
        if abs(share - LEAST_LEFT) > 1e-9:
            assert analysis.survived[row] == (share > LEAST_LEFT)
        np.testing.assert_allclose(analysis.classes.worst_speed[row], radius, rtol=1e-7, atol=1e-9)
        if not lost:
            assert analysis.largest_gain[row] == pytest.approx(1 / report.worst_gain, rel=1e-6)
            assert analysis.error_gain[row] == pytest.approx(report.largest_gain, rel=1e-6)


@given(SEEDS, st.integers(1, 3), st.integers(0, 4), st.integers(1, 3))
def test_no_robot_exceeds_the_mean_square_over_all_sets_of_locks(seed, m, more, i):
    """Ukidve, McInroy and Jafari (2008): the mean square is C(n - i, m) / C(n, m), exactly."""
    n = m + more
    system = ConstrainedSystem(np.random.default_rng(seed).normal(size=(m, n)), None, range(n))
    codes = np.vstack([with_failures(n, 0), with_failures(n, min(i, n))])
    codes = codes[~(codes == FREE).any(axis=1)]
    analysis = analyze_conditions(system, range(m), codes)
    mean = (analysis.relative_manipulability[1:] ** 2).mean()
    bound = comb(n - min(i, n), m) / comb(n, m)
    assert mean == pytest.approx(bound, rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(analysis.best_possible[1:] ** 2, bound, atol=1e-12)
