"""Test the mean-square theorem of Ukidve, McInroy and Jafari (2008), and bounds of worst cases.

"Quantifying and optimizing failure tolerance of a class of parallel manipulators", in Parallel
Manipulators, Towards New Applications (2008), theorem 1 (proof: eqs. 13 to 15) and eq. (17).
"""

from itertools import combinations
from math import comb

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space

from prioritized import ConstrainedSystem
from sim import jacobians
from tests.published.random_arms import random_arm, relative_manipulabilities
from tests.random_systems import SEEDS


def theorem(n: int, m: int, i: int) -> float:
    return comb(n - i, m) / comb(n, m)


def assert_theorem(r: np.ndarray, J: np.ndarray, i: int) -> None:
    """Check all relative manipulabilities; volumes of a badly conditioned J have fewer digits."""
    m, n = J.shape
    assert len(r) == comb(n, i)
    exact = max(1e-12, 1e-15 * np.linalg.cond(J))
    np.testing.assert_allclose(np.mean(r**2), theorem(n, m, i), rtol=exact)


def system_of(J: np.ndarray) -> ConstrainedSystem:
    return ConstrainedSystem(J, None, range(J.shape[1]))


def squared_volume(J: np.ndarray) -> float:
    """Return det(J J^T) as the sum of the squares of all largest minors (Cauchy-Binet)."""
    m, n = J.shape
    return sum(np.linalg.det(J[:, columns]) ** 2 for columns in combinations(range(n), m))


@given(SEEDS, st.sampled_from([(7, 6, 1), (8, 6, 1), (8, 6, 2), (7, 3, 2), (9, 6, 3)]))
def test_the_mean_square_is_that_of_the_theorem_on_any_matrix_and_any_arm(seed, size):
    n, m, i = size
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(random_arm(n, rng))
    jac = jacobians(model, mujoco.MjData(model), site="tool")
    assert_theorem(relative_manipulabilities(system_of(jac.J_T[-m:]), i), jac.J_T[-m:], i)
    J = rng.normal(size=(m, n))
    r = relative_manipulabilities(system_of(J), i)
    assert_theorem(r, J, i)
    left = [squared_volume(np.delete(J, lost, axis=1)) for lost in combinations(range(n), i)]
    # The determinant of a nearly singular remainder has fewer digits than the singular values.
    np.testing.assert_allclose(r**2, np.array(left) / squared_volume(J), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("rows", [[0, 1], [0, 1, 2], [0, 1, 5]])
@pytest.mark.parametrize("i", [1, 2])
def test_the_mean_square_is_that_of_the_theorem_on_the_hexapod(model, rows, i):
    """Check pointing, rotations, and pointing with height, after elimination of the loops."""
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    system = ConstrainedSystem(jac.J_T[rows], jac.J_C, jac.active)
    assert_theorem(relative_manipulabilities(system, i), system.kinematics().J, i)


def of_null_space(N: np.ndarray) -> np.ndarray:
    """Return a Jacobian (m, n) with orthonormal rows whose null space has these rows (n, n - m)."""
    return null_space(N.T).T


def spokes(n: int) -> np.ndarray:
    angle = np.pi * np.arange(n) / n
    return np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize(
    ("J", "best"),
    [
        (np.array([np.cos(np.deg2rad([0, 120, 240])), np.sin(np.deg2rad([0, 120, 240]))]), 0.577),
        (of_null_space(np.ones((7, 1))), 0.378),
        (of_null_space(spokes(8)), 0.5),
    ],
    ids=["three hinges", "7 for 6", "8 for 6"],
)
def test_for_one_failure_the_best_worst_case_is_possible(J, best):
    m, n = J.shape
    r = relative_manipulabilities(system_of(J), 1)
    np.testing.assert_allclose(r, np.sqrt(theorem(n, m, 1)), rtol=1e-12)
    assert r.min() == pytest.approx(best, abs=5e-4)


@pytest.mark.parametrize("n", [3, 4, 7])
def test_the_slowest_direction_of_an_optimal_robot_keeps_one_over_root_n_of_its_speed(n):
    """Check Ben-Gharbia, Maciejewski, Roberts, IEEE Trans. Robotics 30(2), 2014; recalled."""
    system, rows = system_of(of_null_space(np.ones((n, 1)))), range(n - 1)
    assert system.kinematics().manipulability(rows).worst_gain == pytest.approx(1.0)
    for lost in range(n):
        left = system.with_failures(locked=[lost]).kinematics().manipulability(rows)
        assert left.worst_gain == pytest.approx(1 / np.sqrt(n), rel=1e-12)


def best_of_two_failures(n: int) -> float:
    """Return the largest least relative manipulability of n = m + 2 actuators."""
    return 2 * np.sin(np.pi / n) / n


@pytest.mark.parametrize("n", [3, 4, 6, 8])
def test_for_two_failures_spokes_are_the_best_and_below_the_bound_of_the_theorem(n):
    r = relative_manipulabilities(system_of(of_null_space(spokes(n))), 2)
    assert r.min() == pytest.approx(best_of_two_failures(n), rel=1e-9)
    bound = np.sqrt(theorem(n, n - 2, 2))
    assert best_of_two_failures(n) == pytest.approx(bound) if n == 3 else r.min() < 0.9 * bound


@given(SEEDS, st.integers(4, 8), st.floats(0.0, 1.0))
def test_for_two_failures_no_robot_is_better_than_spokes(seed, n, bent):
    """Compare with random robots, and with perturbed spokes."""
    rows = spokes(n) + bent**4 * np.random.default_rng(seed).normal(size=(n, 2))
    r = relative_manipulabilities(system_of(of_null_space(rows)), 2)
    assert r.min() <= best_of_two_failures(n) * (1 + 1e-9)


@given(SEEDS, st.integers(4, 8))
def test_a_relative_manipulability_after_two_failures_is_an_area_of_the_null_space(seed, n):
    J = np.random.default_rng(seed).normal(size=(n - 2, n))
    N = null_space(J)
    area = [abs(np.linalg.det(N[list(pair)])) for pair in combinations(range(n), 2)]
    np.testing.assert_allclose(
        relative_manipulabilities(system_of(J), 2), area, rtol=1e-7, atol=1e-12
    )
