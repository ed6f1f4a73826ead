"""Test error amplification: gains, condition numbers, and the sentences that report them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem
from tests import spaces
from tests.random_systems import failures, rows_of, systems


def unit_vectors(rng: np.random.Generator, size: int, count: int = 200) -> np.ndarray:
    """Return random directions, shape (count, size)."""
    sample = rng.normal(size=(count, size))
    return sample / np.linalg.norm(sample, axis=1, keepdims=True)


@given(st.data(), systems())
def test_no_rates_of_unit_norm_move_the_task_faster_than_the_gain(data, sample):
    kin = data.draw(failures(sample.system)).kinematics()
    major = rows_of(data, len(kin.J))
    report, Z = kin.manipulability(major), spaces.null(kin.active_constraint)
    speeds = np.linalg.norm(unit_vectors(sample.rng, Z.shape[1]) @ (kin.J[major] @ Z).T, axis=1)
    assert np.all(speeds <= report.largest_gain * (1 + 1e-9) + 1e-9)
    gains = np.linalg.svd(kin.J[major] @ Z, compute_uv=False)
    assert report.largest_gain == pytest.approx(gains.max(initial=0.0), abs=1e-9)
    assert report.worst_gain <= report.largest_gain or not Z.size


@given(st.data(), systems(self_motion=False))
def test_a_servo_error_grows_by_the_amplification_at_worst(data, sample):
    """Check errors of 1 % of the rates' norm, in admissible directions, for any major velocity."""
    kin, rng = sample.system.kinematics(), sample.rng
    major, n = rows_of(data, len(kin.J)), len(kin.active)
    mapping = kin.velocity_mapping(major, joint_weight=rng.uniform(0.5, 2, n))
    Z, v = spaces.null(kin.active_constraint), unit_vectors(rng, len(major))
    rates = mapping(v)
    assert np.all(np.linalg.norm(rates, axis=1) <= mapping.largest_gain * (1 + 1e-9))
    if not Z.size or not mapping.largest_gain:
        return
    J_m = kin.J[major] @ Z
    errors = 0.01 * np.linalg.norm(rates, axis=1)[:, None] * unit_vectors(rng, Z.shape[1])
    moved = np.linalg.norm(errors @ J_m.T, axis=1)
    assert np.all(moved <= 0.01 * mapping.amplification * (1 + 1e-9))
    slowest, fastest = np.linalg.svd(mapping.major)[2][0], np.linalg.svd(J_m)[2][0]
    worst = J_m @ fastest * 0.01 * np.linalg.norm(mapping(slowest))
    assert np.linalg.norm(worst) == pytest.approx(0.01 * mapping.amplification, rel=1e-6)


@given(st.data(), systems())
def test_the_closure_condition_is_that_of_the_passive_columns(data, sample):
    system = data.draw(failures(sample.system))
    kin = system.kinematics()
    moving = sorted(set(range(system.J_T.shape[1])) - {*kin.active, *system.stuck})
    sigma = np.linalg.svd(system.J_C[:, moving], compute_uv=False)
    sigma = sigma[sigma > 1e-8]
    expected = sigma[0] / sigma[-1] if sigma.size else 1.0
    assert kin.closure_condition == pytest.approx(expected, rel=1e-6)
    answers = kin.manipulability([0]), kin.velocity_mapping([0]), kin.force_mapping([0])
    assert {answer.closure_condition for answer in answers} == {kin.closure_condition}


@pytest.mark.parametrize("gain", [99.0, 101.0])
def test_texts_report_only_large_amplifications(gain):
    """Check an actuator slower by `gain`, and a loop whose second equation is scaled by `gain`."""
    large = gain > 100
    slow = ConstrainedSystem(np.diag([1.0, 1.0 / gain]), None, [0, 1]).kinematics()
    mapping, report = slow.velocity_mapping([0, 1]), slow.manipulability([0, 1])
    assert mapping.amplification == pytest.approx(gain)
    assert (f"relative error of the major task {gain:.3g} times as large" in str(mapping)) == large
    assert (f"up to {gain:.3g} times as fast in one direction" in str(report)) == large
    assert str(mapping).startswith("The major task is met exactly.")

    J_C = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / gain]])
    weak = ConstrainedSystem([[1.0, 1.0, 1.0]], J_C, [0]).kinematics()
    answers = weak.manipulability([0]), weak.velocity_mapping([0]), weak.force_mapping([0])
    for answer in answers:
        assert (f"of the passive rates {gain:.3g} times as large." in str(answer)) == large
