"""What is left in each failure condition: what it has alone, and at most what any robot has."""

from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig.conditions import FREE, LOCKED, few_failures, with_failures
from fjh.rig.examined import LEAST_LEFT, examine
from prioritized import ConstrainedSystem
from tests.random_systems import SEEDS, systems


@given(systems(actives=(2, 3), tasks=(1, 3)), st.data())
def test_each_condition_is_what_it_is_alone(drawn, data):
    """By classification and attainable set of one condition, which share none of the batches.

    What is left of the speed decides, with the gains that stand for the force.
    """
    system, n, m = drawn.system, len(drawn.system.active), len(drawn.system.J_T)
    major = data.draw(st.lists(st.integers(0, m - 1), min_size=1, unique=True))
    limits = -drawn.rng.uniform(0.5, 2, n), drawn.rng.uniform(0.5, 2, n)
    codes = few_failures(n)
    examined = examine(system, major, codes, rates=limits)
    assert examined.left.worst_speed is not None
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
            assert examined.survived[row] == (share > LEAST_LEFT)
        np.testing.assert_allclose(examined.left.worst_speed[row], radius, rtol=1e-7, atol=1e-9)
        if not lost:
            assert examined.largest_gain[row] == pytest.approx(1 / report.worst_gain, rel=1e-6)
            assert examined.error_gain[row] == pytest.approx(report.largest_gain, rel=1e-6)


@given(SEEDS, st.integers(1, 3), st.integers(0, 4), st.integers(1, 3))
def test_no_robot_exceeds_the_mean_square_over_all_sets_of_locks(seed, m, more, i):
    """Ukidve, McInroy and Jafari (2008): the mean square is C(n - i, m) / C(n, m), exactly."""
    n = m + more
    system = ConstrainedSystem(np.random.default_rng(seed).normal(size=(m, n)), None, range(n))
    codes = np.vstack([with_failures(n, 0), with_failures(n, min(i, n))])
    codes = codes[~(codes == FREE).any(axis=1)]
    examined = examine(system, range(m), codes)
    mean = (examined.relative_manipulability[1:] ** 2).mean()
    bound = comb(n - min(i, n), m) / comb(n, m)
    assert mean == pytest.approx(bound, rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(examined.best_possible[1:] ** 2, bound, atol=1e-12)
