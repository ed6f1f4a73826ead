"""Constrained systems, sound and failed: sections 2.1 and 2.3."""

import mujoco
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod import paper
from fjh.rig.hexapod.closed_form import hexapod
from prioritized import ConstrainedSystem, velocity_mapping
from sim import NOMINAL, jacobians

SEEDS = st.integers(0, 2**32 - 1)


def random_system(seed: int, active: int = 4, loops: int = 3) -> ConstrainedSystem:
    """Four active and three passive velocities in three loops, twist of six."""
    rng = np.random.default_rng(seed)
    N = active + loops
    order = rng.permutation(N)
    return ConstrainedSystem(rng.normal(size=(6, N)), rng.normal(size=(loops, N)), order[:active])


def admissible(system: ConstrainedSystem, extra_rows: np.ndarray) -> np.ndarray:
    """Oracle: basis of all velocities that the constraints and the extra rows allow."""
    return scipy.linalg.null_space(np.vstack([system.J_C, extra_rows]))


@given(SEEDS, st.sets(st.integers(0, 3), max_size=2), st.sets(st.integers(0, 3), max_size=2))
def test_kinematics_agree_with_every_admissible_motion(seed, locked, free):
    """For any motion the failed mechanism can make, v = J rates, whatever failed."""
    system = random_system(seed)
    free = free - locked
    kin = system.with_failures(list(locked), list(free)).kinematics()
    stuck = np.eye(system.J_T.shape[1])[system.active[sorted(locked)]]
    motions = admissible(system, stuck)
    residual = system.J_T @ motions - kin.J @ motions[kin.active]
    # What the active rates do not explain is self-motion, eq. (12).
    residual -= kin.self_motion @ (kin.self_motion.T @ residual)
    np.testing.assert_allclose(residual, 0, atol=1e-7)
    np.testing.assert_allclose(kin.active_constraint @ motions[kin.active], 0, atol=1e-8)


@given(SEEDS)
def test_passive_rates_close_the_loops_and_constraint_forces_balance_them(seed):
    system = random_system(seed)
    kin = system.kinematics()
    rng = np.random.default_rng(seed)
    rates, f = rng.normal(size=4), rng.normal(size=6)
    theta_dot = np.empty(7)
    theta_dot[kin.active], theta_dot[kin.passive] = rates, kin.passive_rates(rates)
    np.testing.assert_allclose(system.J_C @ theta_dot, 0, atol=1e-7)
    # Eq. (9): the passive joints carry no torque.
    force = system.J_T.T @ f + system.J_C.T @ kin.constraint_force(f)
    np.testing.assert_allclose(force[kin.passive], 0, atol=1e-6)
    # Eq. (13): what is left on the active ones is J^T f.
    np.testing.assert_allclose(force[kin.active], kin.J.T @ f, atol=1e-6)


def test_a_serial_arm_has_no_constraint_and_its_jacobian_is_its_task_jacobian():
    J_T = np.random.default_rng(0).normal(size=(3, 4))
    kin = ConstrainedSystem(J_T, None, range(4)).kinematics()
    np.testing.assert_array_equal(kin.J, J_T)
    assert kin.self_motion.shape == (3, 0)
    assert kin.internal_force.shape == (0, 0)
    assert kin.active_constraint.shape == (0, 4)


@given(SEEDS, st.integers(1, 4))
def test_redundant_constraint_rows_change_nothing_but_the_internal_force(seed, copies):
    system = random_system(seed)
    mix = np.random.default_rng(seed).normal(size=(copies, 3))
    stacked = np.vstack([system.J_C, mix @ system.J_C])
    kin = system.kinematics()
    more = ConstrainedSystem(system.J_T, stacked, system.active).kinematics()
    np.testing.assert_allclose(kin.J, more.J, atol=1e-6)
    assert more.internal_force.shape == (copies, 3 + copies)
    assert more.active_constraint.shape == (0, 4)


@given(SEEDS)
def test_dropping_the_column_of_a_locked_joint_is_wrong_in_a_loop_with_constrained_motion(seed):
    """The warning that closes section 2.3.2; for serial arms it is right."""
    rng = np.random.default_rng(seed)
    J_T = rng.normal(size=(2, 3))
    serial = ConstrainedSystem(J_T, None, range(3)).with_failures(locked=[0]).kinematics()
    np.testing.assert_allclose(serial.J, J_T[:, 1:], atol=1e-12)

    # Two active joints bound by one loop row: locking one stops the other as well.
    bound = ConstrainedSystem(J_T[:, :2], [[1.0, -1.0]], range(2))
    kin = bound.with_failures(locked=[0]).kinematics()
    np.testing.assert_allclose(np.abs(kin.active_constraint), [[1.0]], atol=1e-12)
    right = kin.velocity_mapping(major=[0], joint_weight=np.ones(2))
    dropped = velocity_mapping(J_T[:, [1]], [0])
    np.testing.assert_allclose(right([1.0]), 0.0, atol=1e-12)
    assert abs(dropped([1.0])[0]) > 1e-3


def test_a_tilted_mechanism_gets_the_same_verdict_as_an_upright_one():
    """Self-motion of a spinning strut is no task motion, though its product leaves 1e-17."""
    axis = np.array([0.0, 0.0, 1.0])
    rng = np.random.default_rng(3)
    for R in [np.eye(3), np.linalg.qr(rng.normal(size=(3, 3)))[0]]:
        # One active slide along the axis; a passive spin about it moves no point on the axis.
        arm = R @ (0.3 * axis)
        spin = np.cross(R @ axis, arm)
        J_T = np.column_stack([R @ axis, spin])
        kin = ConstrainedSystem(J_T, np.zeros((0, 2)), [0]).kinematics()
        assert kin.self_motion.shape == (3, 0)


def tilted_arm(R: np.ndarray) -> np.ndarray:
    """Task Jacobian of a planar three-joint arm lying in the plane that R makes of x, z."""
    axis = R @ np.array([0.0, 1.0, 0.0])
    joints = [R @ np.array(p) for p in ([0.0, 0, 0], [0.3, 0, 0.1], [0.5, 0, -0.2])]
    tip = R @ np.array([0.9, 0.0, 0.1])
    return np.array([[*axis, *np.cross(axis, tip - joint)] for joint in joints]).T


def test_a_tilted_arm_does_not_chase_the_secondary_motion_it_cannot_make():
    """Out of its plane the arm cannot move: the product that says so leaves only round-off."""
    for angles in ([0, 0, 0], [20, 30, 40]):
        R = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        in_plane = R[:, [0, 2]].T
        out_of_plane = R[:, [1]].T
        directions = np.hstack([np.zeros((2, 3)), in_plane])
        secondary = np.hstack([np.zeros((1, 3)), out_of_plane])
        kin = ConstrainedSystem(tilted_arm(R), None, range(3)).kinematics()
        mapping = kin.velocity_mapping(directions, secondary, secondary_weight=[1.0])
        np.testing.assert_allclose(mapping.secondary, 0, atol=1e-9)
        least_norm = np.linalg.pinv(directions @ kin.J)
        np.testing.assert_allclose(mapping.major, least_norm, atol=1e-9)
        report = kin.velocity_mapping(secondary)
        assert report.rank == 0


@given(SEEDS)
def test_a_jacobian_that_cancels_is_zero_however_it_is_left(seed):
    """J is a difference of large terms; what round-off leaves of it is no motion."""
    rng = np.random.default_rng(seed)
    J_Ca, J_Cp = rng.normal(size=(3, 2)), rng.normal(size=(3, 3))
    J_Tp = rng.normal(size=(2, 3))
    J_Ta = J_Tp @ np.linalg.solve(J_Cp, J_Ca)  # the task sees nothing of the active joints
    kin = ConstrainedSystem(np.hstack([J_Ta, J_Tp]), np.hstack([J_Ca, J_Cp]), [0, 1]).kinematics()
    assert np.abs(kin.J).max() < 1e-9 * np.linalg.norm(J_Tp @ np.linalg.pinv(J_Cp) @ J_Ca)
    assert kin.velocity_mapping([0, 1]).rank == 0


@given(SEEDS, st.sets(st.integers(0, 3), min_size=1, max_size=2), st.floats(-12, 12))
def test_locked_joints_are_the_papers_unit_rows_in_any_units(seed, locked, exponent):
    """Section 2.3.2 as printed, with E stacked under J_C; scaling J_C changes no motion."""
    system = random_system(seed)
    kin = system.with_failures(locked).kinematics()
    stuck = system.active[sorted(locked)]
    E = np.eye(7)[np.sort(stuck)]
    J_C, active, passive = np.vstack([system.J_C, E]), kin.active, kin.passive
    J_Cp_pinv = np.linalg.pinv(J_C[:, passive])
    left_null = scipy.linalg.null_space(J_C[:, passive].T).T
    # Admissible rates only: on others eq. (14) is a least-squares compromise without meaning.
    rates = scipy.linalg.null_space(left_null @ J_C[:, active], rcond=1e-9)
    J = system.J_T[:, active] - system.J_T[:, passive] @ J_Cp_pinv @ J_C[:, active]
    np.testing.assert_allclose(kin.J @ rates, J @ rates, atol=1e-6)
    f = np.random.default_rng(seed).normal(size=6)
    balance = kin.constraint_force(f) @ J_C[:, passive] + f @ system.J_T[:, passive]
    paper_force = -J_Cp_pinv.T @ system.J_T[:, passive].T @ f
    if not kin.self_motion.size:
        np.testing.assert_allclose(balance, 0, atol=1e-6)
        np.testing.assert_allclose(kin.constraint_force(f), paper_force, atol=1e-6)
    np.testing.assert_allclose(kin.internal_force @ J_C[:, passive], 0, atol=1e-9)
    np.testing.assert_allclose(
        kin.internal_force @ kin.internal_force.T, np.eye(len(left_null)), atol=1e-9
    )
    scaled = ConstrainedSystem(system.J_T, 10.0**exponent * system.J_C, system.active)
    again = scaled.with_failures(locked).kinematics()
    np.testing.assert_allclose(again.J @ rates, kin.J @ rates, atol=1e-6)
    assert again.self_motion.shape == kin.self_motion.shape
    assert again.active_constraint.shape == kin.active_constraint.shape


def test_failures_compose():
    system = random_system(0)
    one_by_one = system.with_failures(free=[1]).with_failures(locked=[0]).with_failures(locked=[0])
    at_once = system.with_failures(locked=[0], free=[1])
    np.testing.assert_array_equal(one_by_one.kinematics().J, at_once.kinematics().J)
    jammed = system.with_failures(free=[1]).with_failures(locked=[1])
    assert jammed.failures.locked == {1}
    assert jammed.failures.free == frozenset()
    again = jammed.with_failures(locked={1}).with_failures(locked=[1, 1])
    assert again.failures == jammed.failures
    released_later = jammed.with_failures(free=[1])
    assert released_later.failures.locked == {1}


def test_a_stuck_passive_joint_is_one_more_constraint():
    system = random_system(5)
    passive = int(system.kinematics().passive[0])
    kin = system.with_failures(locked_passive=[passive]).kinematics()
    assert kin.active_constraint.shape == (1, 4)
    rates = scipy.linalg.null_space(kin.active_constraint)[:, 0]
    at = list(kin.passive).index(passive)
    assert abs(kin.passive_rates(rates)[at]) < 1e-9


def test_expand_puts_survivors_where_they_were():
    kin = random_system(1).with_failures(locked=[2]).kinematics()
    np.testing.assert_array_equal(kin.expand([1.0, 2.0, 3.0]), [1.0, 2.0, 0.0, 3.0])
    np.testing.assert_array_equal(kin.actuators, [0, 1, 3])


@pytest.mark.parametrize(
    ("failures", "message"),
    [
        ({"locked": [0], "free": [0]}, "either locked or free"),
        ({"locked": [4]}, r"locked must lie in 0\.\.3"),
        ({"free": [-1]}, r"free must lie in 0\.\.3"),
        ({"locked": [1.5]}, "locked must be a list of integers"),
    ],
)
def test_impossible_failures_are_refused_by_name(failures, message):
    with pytest.raises(ValueError, match=message):
        random_system(0).with_failures(**failures)


def test_an_actuated_joint_is_not_a_passive_one():
    system = random_system(0)
    with pytest.raises(ValueError, match="locked_passive must name passive velocities"):
        system.with_failures(locked_passive=[int(system.active[0])])


def hexapod_system(model) -> ConstrainedSystem:
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active)


def test_the_jacobian_of_the_model_is_eq_39_signs_included(model):
    kin = hexapod_system(model).kinematics()
    np.testing.assert_allclose(kin.J, paper.JACOBIAN, atol=6e-4)
    assert kin.J[1, 0] == pytest.approx(1.00455, abs=5e-6)  # printed as 1.004
    assert np.linalg.cond(kin.J) == pytest.approx(paper.CONDITION_NUMBER, abs=0.005)


def test_the_closed_form_inverse_jacobian_is_the_models(model):
    kin = hexapod_system(model).kinematics()
    A = hexapod(model).inverse_jacobian(NOMINAL)
    np.testing.assert_allclose(A @ kin.J, np.eye(6), atol=1e-12)


def test_a_locked_strut_of_the_hexapod_loses_its_column(model):
    """Six struts, six degrees of freedom: here, and only here, dropping the column is right."""
    system = hexapod_system(model)
    kin, failed = system.kinematics(), system.with_failures(locked=[0]).kinematics()
    np.testing.assert_allclose(failed.J, kin.J[:, 1:], atol=1e-10)
    assert failed.self_motion.shape == (6, 0)
    assert failed.active_constraint.shape == (0, 5)


def test_a_released_strut_of_the_hexapod_lets_the_payload_move_along_its_column(model):
    system = hexapod_system(model)
    kin, failed = system.kinematics(), system.with_failures(free=[2]).kinematics()
    column = kin.J[:, 2] / np.linalg.norm(kin.J[:, 2])
    assert failed.self_motion.shape == (6, 1)
    assert abs(column @ failed.self_motion[:, 0]) == pytest.approx(1.0)
