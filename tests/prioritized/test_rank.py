"""The one rank decision: where each verdict flips, and how far away that is."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Status, force_mapping, velocity_mapping
from prioritized._solver.rank import RANK_TOLERANCE
from tests.random_systems import SEEDS, orthogonal


def expect(decision: tuple[bool, float], sigma: float, scale: float) -> None:
    """The rank decision (counts, gap) on the singular value sigma of a matrix made from `scale`."""
    distance = sigma / (scale * RANK_TOLERANCE)
    assume(abs(np.log10(distance)) > 0.05)  # round-off moves sigma by 1e-16: 1e-6 of the threshold
    counts, gap = decision
    assert counts == (distance > 1)
    # At sigma = 1e-14 round-off is a few percent of it.
    assert gap == pytest.approx(max(distance, 1 / distance), rel=0.1)


@given(SEEDS, st.floats(2, 14), st.floats(-3, 3))
def test_each_verdict_flips_where_its_singular_value_crosses_the_tolerance(seed, nearness, unit):
    """At sigma / scale = rank_tolerance, nowhere else; the gap is the factor to that point."""
    small, size = 10.0**-nearness, 10.0**unit
    U, V = (orthogonal(np.random.default_rng(seed + k), 2) for k in (0, 1))
    weak = size * U @ np.diag([1.0, small]) @ V.T
    norm = size * np.hypot(1.0, small)

    report = ConstrainedSystem(weak, None, [0, 1]).kinematics().manipulability([0, 1])
    # Both rows are major: a selection of norm sqrt(2) takes part in the product.
    reached = not report.unmanipulable, report.gaps["unmanipulable"]
    expect(reached, size * small, norm * np.sqrt(2.0))
    reached = not report.unmanipulable_task, report.gaps["unmanipulable_task"]
    expect(reached, size * small, norm)

    # The same matrix as passive columns of the task: a second direction of self-motion.
    task = np.hstack([np.zeros((2, 1)), weak])
    report = ConstrainedSystem(task, None, [0]).kinematics().manipulability([0, 1])
    expect((len(report.bases["unstable"].T) == 2, report.gaps["unstable"]), size * small, norm)
    major = len(report.bases["unstable_major"].T) == 2, report.gaps["unstable_major"]
    expect(major, size * small, norm)  # with every row major, the same decision

    # As passive columns of the loops: a closed loop, or one internal force and one idle joint.
    loops = np.hstack([np.zeros((2, 1)), weak])
    report = ConstrainedSystem(np.zeros((1, 3)), loops, [0]).kinematics().manipulability([0])
    expect((not report.irresolvable, report.gaps["irresolvable"]), size * small, norm)
    assert report.idle == report.irresolvable

    # As active columns: a second forbidden rate.
    report = ConstrainedSystem(np.eye(2), weak, [0, 1]).kinematics().manipulability([0])
    bound = len(report.bases["constrained_active"]) == 2, report.gaps["constrained_active"]
    expect(bound, size * small, norm)


@given(SEEDS, st.floats(0, 8))
def test_what_fast_passive_joints_leave_of_each_other_is_no_motion(seed, exponent):
    """Two passive rates of 10^k per active rate, and the task sees their difference: 1e-16 10^k.

    J is decided against the size of its terms; against J_T alone this round-off would be a motion.
    """
    slow = 10.0**-exponent
    rng = np.random.default_rng(seed)
    turn = orthogonal(rng, 2)  # any other pair of passive coordinates
    J_Cp, J_Tp = slow * orthogonal(rng, 2) @ turn, np.array([[1.0, -1.0]]) @ turn
    J_Ca = -J_Cp @ turn.T @ np.ones((2, 1)) / slow
    system = ConstrainedSystem(np.hstack([[[0.0]], J_Tp]), np.hstack([J_Ca, J_Cp]), [0])
    kin = system.kinematics()
    np.testing.assert_allclose(np.linalg.norm(kin.passive_rates([slow])), np.sqrt(2.0))
    assert kin.manipulability([0]).unmanipulable
    assert kin.velocity_mapping([0]).rank == 0


@given(SEEDS, st.floats(2, 14), st.floats(-3, 3))
def test_mappings_flip_with_the_reports(seed, nearness, unit):
    """The same decision behind the status: exact, or best in reach; commanded, or borne unseen."""
    size, small = 10.0**unit, 10.0**-nearness
    U, V = (orthogonal(np.random.default_rng(seed + k), 2) for k in (0, 1))
    J = size * U @ np.diag([1.0, small]) @ V.T
    norm = size * np.hypot(1.0, small)
    velocity = velocity_mapping(J, [0, 1])
    reached = velocity.status is Status.EXACT, float(velocity.gap)
    expect(reached, size * small, norm * np.sqrt(2.0))
    assert velocity.rank == 1 + reached[0]
    # Rates stay finite: the singular value is inverted or dropped, never a zero divided by.
    assert np.abs(velocity.major).max() <= 1.01 / (norm * RANK_TOLERANCE)
    force = force_mapping(J, [0, 1])
    assert force.rank == 2  # any force may be asked for: the structure bears what J does not see
    threshold_apart = abs(np.log10(small / RANK_TOLERANCE)) > 0.5  # sqrt(2) either way
    if threshold_apart:
        assert (force.status is Status.EXACT) == reached[0]
        assert np.trace(force.reaction) == pytest.approx(0.0 if reached[0] else 1.0, abs=1e-9)
