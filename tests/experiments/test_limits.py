"""Tests of the study `limits`: attainable pointing, strategies and data."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from experiments.limits import (
    Strategy,
    allocation,
    line_of_sight,
    move_arm,
    redistributed,
    signed_distance,
)
from prioritized import ConstrainedSystem
from tests.profiles import examples


def test_the_outline_bounds_the_pointing_of_bounded_least_squares():
    """Inside the error is zero; outside the distance is the least error."""
    rng = np.random.default_rng(0)
    J_m, lower, upper = rng.normal(size=(2, 5)), -rng.uniform(0.1, 1, 5), rng.uniform(0.1, 1, 5)
    kinematics = ConstrainedSystem(J_m, None, range(5)).kinematics()
    corners = kinematics.attainable([0, 1], (lower, upper)).vertices
    points = 3 * rng.normal(size=(60, 2))
    least = [
        np.sqrt(2 * lsq_linear(J_m, point, (lower, upper), method="bvls").cost) for point in points
    ]
    distances = signed_distance(corners, points)
    np.testing.assert_allclose(-np.minimum(distances, 0), least, atol=1e-6)
    assert (distances > 0).any()


@pytest.mark.parametrize("name", ["strict", "scaled", "clipping", "redistributed", "weighted"])
def test_every_strategy_equals_the_mapping_without_active_limits(name):
    """Rates keep narrow limits; weighted problems are inexact."""
    rng = np.random.default_rng(1)
    system = ConstrainedSystem(rng.normal(size=(4, 6)), None, np.arange(6))
    kinematics, v = system.with_failures(locked=[2]).kinematics(), np.array([0.3, -0.2])
    allocate = allocation(Strategy(name, 1e4 if name == "weighted" else None))
    for half in (10.0, 0.05):
        limits = np.full(6, -half), np.full(6, half)
        solution = allocate(kinematics, limits, [0, 1], [2, 3]).solve(v)
        assert np.abs(solution.rates).max() <= half
        if half == 10.0:
            expected = kinematics.velocity_mapping([0, 1], joint_weight=np.ones(5))(v)
            np.testing.assert_allclose(solution.rates, expected, atol=1e-6)


@examples(40)
@given(st.integers(0, 2**32 - 1))
def test_the_others_compensate_for_saturated_actuators(seed):
    """The moving ones compensate by the pseudo-inverse; none is beyond a limit."""
    rng = np.random.default_rng(seed)
    J_m, v, desired = rng.normal(size=(2, 6)), rng.normal(size=2), rng.normal(size=6)
    half = rng.uniform(0.1, 1.0, 6)
    kinematics = ConstrainedSystem(J_m, None, range(6)).kinematics()
    rates = redistributed(kinematics, (-half, half), [0, 1], []).solve(v, desired).rates
    assert (np.abs(rates) <= half).all()
    moving = np.abs(rates) < half
    if moving.sum() >= len(v):
        left = v - J_m[:, ~moving] @ rates[~moving] - J_m[:, moving] @ desired[moving]
        expected = desired[moving] + np.linalg.pinv(J_m[:, moving]) @ left
        np.testing.assert_allclose(rates[moving], expected, atol=1e-9)


@pytest.mark.long
def test_the_line_of_sight_tilts_out_and_back_and_a_locked_elbow_is_fixed():
    views = line_of_sight(np.linspace(0, 40, 401), 40.0)
    np.testing.assert_allclose(np.linalg.norm(views, axis=1), 1)
    np.testing.assert_allclose(views[[0, -1]], [[0, 0, 1]] * 2, atol=1e-12)
    assert np.arccos(views[:, 2]).max() == pytest.approx(0.9)
    elbow_rad = move_arm(Strategy("strict"), 16.0)["joint_rad"][:, 3]
    assert np.ptp(elbow_rad[len(elbow_rad) // 2 + 1 :]) == 0.0


def test_the_data_have_the_errors_of_the_table_and_strict_priority_tracks(study):
    """Attainable targets are tracked as without limits; else the error is at least the minimum."""
    data, spirals = study.arrays("spirals.npz"), study.tables["spirals"]
    for spiral in spirals.itertuples():
        error = np.linalg.norm(data["desired_rad"] - data[f"{spiral.name}_true_rad"], axis=1)
        assert spiral.rms_urad == pytest.approx(1e6 * np.sqrt((error**2).mean()))
    by = spirals.set_index(["condition", "strategy"])
    rms = by.attainable_rms_urad.unstack()
    assert (rms.strict < 1.03 * rms.unlimited).all()
    least = study.tables["conditions"].set_index("condition").least_rms_urad
    assert (by.xs("strict", level="strategy").rms_urad > least).all()
