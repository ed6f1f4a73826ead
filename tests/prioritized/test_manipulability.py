"""Test the conditions of section 2.2 with explicit motions and forces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem
from tests import spaces
from tests.random_systems import failures, rows_of, systems

FLAGS = {
    "unmanipulable",
    "unmanipulable_task",
    "unstable",
    "unstable_major",
    "unstable_secondary",
    "unobservable",
    "irresolvable",
    "constrained_active",
}


def holding(report) -> set[str]:
    """Return the names of the conditions that hold; flags, findings and bases must agree."""
    assert set(report.findings) == FLAGS
    for name in FLAGS:
        assert getattr(report, name) == report.findings[name].holds
        assert report.findings[name].holds == (report.bases[name].size > 0)
    return {name for name in FLAGS if getattr(report, name)}


HALF = np.sqrt(0.5)


@pytest.mark.parametrize(
    ("J_T", "J_C", "active", "flags", "name", "basis"),
    [
        # A rod between two ball joints spins about its axis, without effect on other joints.
        ([[1, 0, 0]], [[0, 1, -1]], [0], {"unobservable"}, "unobservable", [[HALF], [HALF]]),
        # Two hinges of a door on one axis share the load arbitrarily, and constrain no rate.
        ([[0, 1]], [[1, -1], [1, -1]], [0], {"irresolvable"}, "irresolvable", [[HALF, HALF]]),
        # Torques along (2, -1) of two motors geared one to two are internal.
        (
            *([[1, 0]], [[2, -1]], [0, 1], {"irresolvable", "constrained_active"}),
            *("constrained_active", np.array([[2.0, 1.0]]) / np.sqrt(5.0)),
        ),
    ],
)
def test_spinning_rods_doors_and_gears_are_classified_correctly(
    J_T, J_C, active, flags, name, basis
):
    report = ConstrainedSystem(J_T, J_C, active).kinematics().manipulability([0])
    assert holding(report) == flags
    np.testing.assert_allclose(np.abs(report.bases[name]), basis)


@given(systems())
def test_every_sampled_rank_is_recovered(sample):
    """Check self-motion, unobservable motion, internal forces, constraints, and reachable rank."""
    m, n = len(sample.system.J_T), len(sample.system.active)
    bases = sample.system.kinematics().manipulability(list(range(m))).bases
    assert bases["unstable"].shape == bases["unstable_major"].shape == (m, sample.self_motion)
    assert bases["unobservable"].shape[1] == sample.unobservable
    assert bases["irresolvable"].shape == (sample.internal, len(sample.system.J_C))
    assert bases["constrained_active"].shape == (sample.bound, n)
    assert (
        bases["unmanipulable"].shape
        == bases["unmanipulable_task"].shape
        == (m, m - sample.reachable)
    )
    assert not bases["unstable_secondary"].size


@given(st.data(), systems())
def test_every_basis_is_verified_by_explicit_motions(data, sample):
    """Check each direction with explicit rates of all joints, or forces without torque."""
    system = data.draw(failures(sample.system))
    kin = system.kinematics()
    J_T, N = system.J_T, system.J_T.shape[1]
    major = rows_of(data, len(J_T))
    report = kin.manipulability(major)
    bases = report.bases
    closed, loose = spaces.motions(system), spaces.self_motions(system, kin)
    driven = spaces.null(
        np.vstack([spaces.closure(system), loose.T])
    )  # motions without self-motion

    for name, rows in (("unmanipulable", major), ("unmanipulable_task", range(len(J_T)))):
        moved = J_T[list(rows)] @ driven
        np.testing.assert_allclose(bases[name].T @ moved, 0, atol=1e-8)
        assert bases[name].shape[1] == len(rows) - np.linalg.matrix_rank(moved, tol=1e-8)

    # Columns of `loose` are passive rates that close the loops with active joints at rest.
    moved = J_T @ loose
    still = loose @ spaces.null(moved[major])  # those without major motion
    expected = {
        "unstable": moved,
        "unstable_major": moved[major],
        "unstable_secondary": J_T @ still,
        "unobservable": (loose @ spaces.null(moved))[kin.passive],
    }
    for name, made in expected.items():
        spaces.assert_spans(bases[name], made)

    rows = np.vstack([system.J_C, np.eye(N)[spaces.stuck_joints(system)]])
    np.testing.assert_allclose(bases["irresolvable"] @ rows[:, kin.passive], 0, atol=1e-8)
    left = len(rows) - np.linalg.matrix_rank(rows[:, kin.passive], tol=1e-8)
    assert len(bases["irresolvable"]) == left
    rates = closed[kin.active]
    np.testing.assert_allclose(bases["constrained_active"] @ rates, 0, atol=1e-8)
    forbidden = len(rates) - np.linalg.matrix_rank(rates, tol=1e-8)
    assert len(bases["constrained_active"]) == forbidden


@given(st.data(), systems(self_motion=False))
def test_the_worst_gain_is_the_least_speed_per_unit_rate(data, sample):
    """Compare its inverse with the norm of the mapping's rates for the worst unit velocity."""
    kin = sample.system.kinematics()
    major = rows_of(data, len(kin.J))
    report = kin.manipulability(major)
    cost = np.linalg.norm(kin.velocity_mapping(major).major, 2)
    assert report.unmanipulable == (report.worst_gain == 0.0)
    if not report.unmanipulable:
        assert report.worst_gain == pytest.approx(1.0 / cost, rel=1e-6)


def test_the_gap_includes_the_decision_on_springs():
    """Check a spring of 3e-10 of the stiffest one, above the threshold by a factor of three."""
    system = ConstrainedSystem([[1.0, 1.0, 1.0]], None, [0], stiffness=[0.0, 1.0, 3e-10])
    report = system.kinematics().manipulability([0])
    assert not report.unstable
    assert report.gaps["unstable"] == pytest.approx(3.0)
    assert report.gaps["unobservable"] == pytest.approx(3.0)
