"""Balance of power: what the actuators spend is what the task receives, eq. (4)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Status, force_mapping
from tests import spaces
from tests.random_systems import (
    SEEDS,
    ZERO,
    failures,
    of_rank,
    rows_of,
    springs,
    systems,
    weights,
    with_stiffness,
)


@given(st.data(), systems(), st.booleans())
def test_force_times_velocity_is_torque_times_rate_for_every_motion(data, drawn, oblique):
    """Through self-motion, redundant rows, failures; f . v = f_m . v_m + f_s . v_s of any basis."""
    system = data.draw(failures(drawn.system))
    kin, rng = system.kinematics(), drawn.rng
    m, n = kin.J.shape
    m1 = data.draw(st.integers(1, m))
    S = of_rank(rng, m, m, m) if oblique else np.eye(m)[data.draw(st.permutations(range(m)))]
    W3, W4 = data.draw(weights(n, rng)), data.draw(weights(m - m1, rng))
    mapping = kin.force_mapping(S[:m1], S[m1:], W3, W4)
    aims = [rng.normal(size=size) for size in (m1, n, m - m1)]
    torques = mapping(*aims)
    f = S.T @ np.append(aims[0] - mapping.residual(aims[0]), mapping.secondary_force(*aims))

    theta_dot = spaces.motions(system)  # each column a motion, all of them together any motion
    v, rates = system.J_T @ theta_dot, theta_dot[kin.active]
    np.testing.assert_allclose(f @ v, torques @ rates, atol=1e-7)
    # The same through the model: v = J rates + whatever self-motion adds.
    drifting = rng.normal(size=kin.self_motion.shape[1])
    rates = rates @ rng.normal(size=rates.shape[1])
    v = kin.J @ rates + kin.self_motion @ drifting
    np.testing.assert_allclose(f @ v, torques @ rates, atol=1e-7)


@given(st.data(), systems(), st.booleans())
def test_the_constraint_forces_of_a_mapping_balance_every_joint(data, drawn, elastic):
    """Eq. (5) whole, with springs: [torques; 0] = J_T^T f + [J_C; E]^T f_C + K theta."""
    system = data.draw(failures(drawn.system))
    N, rng = system.J_T.shape[1], drawn.rng
    K = np.zeros((N, N))
    if elastic:
        R = data.draw(springs(N, rng))
        K = R.T @ R
        system = with_stiffness(system, K)
    kin = system.kinematics()
    m, n = kin.J.shape
    mapping = kin.force_mapping([0], None, np.ones(n), np.ones(m - 1))
    aims = [rng.normal(size=size) for size in (1, n, m - 1)]
    torques = mapping(*aims)
    f = np.append(aims[0] - mapping.residual(aims[0]), mapping.secondary_force(*aims))
    # Springs under the load f with every active joint held; oracle: least energy, densely.
    Z = spaces.self_motions(system, kin)
    held, directions = np.linalg.eigh(Z.T @ K @ Z)
    stretched = Z @ directions[:, held > ZERO]
    theta = -stretched @ ((stretched.T @ system.J_T.T @ f) / held[held > ZERO])
    loaded, closing = system.J_T.T @ f + K @ theta, spaces.closure(system).T
    on_joints = loaded + closing @ kin.constraint_force(f, torques)
    np.testing.assert_allclose(on_joints[kin.active], torques, atol=1e-6)
    np.testing.assert_allclose(on_joints[kin.passive], 0, atol=1e-6)
    # Torques that only squeeze the loops come and go with the choice of f_C.
    on_joints, rates = (
        loaded + closing @ kin.constraint_force(f),
        spaces.null(kin.active_constraint),
    )
    np.testing.assert_allclose(on_joints[kin.passive], 0, atol=1e-6)
    np.testing.assert_allclose(rates.T @ on_joints[kin.active], rates.T @ kin.J.T @ f, atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(-10, 10))
def test_constraint_forces_balance_in_any_unit_of_the_closures(seed, exponent):
    """A stuck joint's reaction is not weighed against the units of J_C."""
    rng, unit = np.random.default_rng(seed), 10.0**exponent
    J_T, J_C = rng.normal(size=(2, 6)), unit * rng.normal(size=(3, 6))
    system = ConstrainedSystem(J_T, J_C, range(4)).with_failures(locked=[0])
    kin = system.kinematics()
    mapping = kin.force_mapping([0], None, np.ones(3), np.ones(1))
    torques, f_s = mapping([1.0], rng.normal(size=3)), mapping.secondary_force([1.0])
    f = np.append(1.0, f_s)
    torques = mapping([1.0])
    f_C = kin.constraint_force(f, torques)
    on_joints = J_T.T @ f + np.vstack([J_C, np.eye(6)[:1]]).T @ f_C
    # Round-off grows with the unit of the reaction's row beside that of J_C.
    tolerance = 1e-7 * max(1.0, unit * 1e-4)
    np.testing.assert_allclose(on_joints[kin.active], torques, atol=tolerance)
    np.testing.assert_allclose(on_joints[kin.passive], 0, atol=tolerance)


@given(st.data(), systems())
def test_the_reaction_is_every_force_that_does_no_work_on_any_motion(data, drawn):
    """Such forces change no torque beyond what merely squeezes the loops, C^T eta."""
    system = data.draw(failures(drawn.system))
    kin = system.kinematics()
    major = rows_of(data, len(system.J_T))
    mapping = kin.force_mapping(major, torque_weight=np.ones(len(kin.active)))
    moved = system.J_T @ spaces.motions(system)
    borne = spaces.projector(spaces.null(moved.T))
    np.testing.assert_allclose(mapping.reaction, borne, atol=1e-7)
    squeeze = spaces.projector(kin.active_constraint.T)
    torques = kin.J.T @ borne
    np.testing.assert_allclose(torques, squeeze @ torques, atol=1e-7)
    if not kin.self_motion.size:
        seen = np.linalg.matrix_rank(moved[major], tol=1e-8) == len(major)
        assert mapping.status is (Status.EXACT if seen else Status.UNSEEN)


def test_a_locked_strut_bears_one_force_of_the_hexapod(hexapod):
    """Six directions, five motions: the sixth force loads the lock, and no coil feels it."""
    nominal = hexapod.kinematics()
    healthy = nominal.force_mapping([0, 1], torque_weight=np.ones(6))
    np.testing.assert_allclose(healthy.reaction, 0, atol=1e-9)
    mapping = hexapod.with_failures(locked=[2]).kinematics().force_mapping([0, 1])
    assert np.trace(mapping.reaction) == pytest.approx(1.0)
    assert mapping.status is Status.EXACT
    torques = nominal.J.T @ mapping.reaction @ np.random.default_rng(0).normal(size=6)
    others = np.delete(np.arange(6), 2)
    np.testing.assert_allclose(torques[others], 0, atol=1e-9 * np.abs(torques[2]))


def exerted(kin, torques):
    """Task force that these torques hold in balance, and nothing else does: eqs. (8), (9)."""
    balance = np.vstack([kin.J.T, kin.self_motion.T])
    load = np.concatenate([torques, np.zeros(kin.self_motion.shape[1])])
    f, _, rank, _ = np.linalg.lstsq(balance, load, rcond=None)
    assert rank == len(f)
    return f


def test_without_eq_9_a_free_strut_turns_the_major_force_into_another(hexapod):
    """The paper's (33) lets f push on the released strut, which gives way: the law can fail."""
    free = hexapod.with_failures(free=[2])
    kin, f_md = free.kinematics(), np.array([1.0, -0.5])
    ours = kin.force_mapping([0, 1], torque_weight=np.ones(6))
    np.testing.assert_allclose(exerted(kin, ours(f_md))[:2], f_md, atol=1e-9)
    paper = force_mapping(kin.J, [0, 1], torque_weight=np.ones(5))  # told of no self-motion
    assert np.linalg.norm(exerted(kin, paper(f_md))[:2] - f_md) > 0.1
    theta_dot = spaces.motions(free)
    f = np.concatenate([f_md, paper.secondary_force(f_md)])
    lost = f @ hexapod.J_T @ theta_dot - paper(f_md) @ theta_dot[kin.active]
    assert np.abs(lost).max() > 0.1


@given(systems(actives=(2, 4)).filter(lambda drawn: drawn.bound and not drawn.self_motion))
def test_without_internal_force_an_over_actuated_mechanism_works_harder(drawn):
    """Torques that only squeeze the loops are free to choose: eta makes their sum the least."""
    kin = drawn.system.kinematics()
    m, n = kin.J.shape
    f = drawn.rng.normal(size=m)
    every_row = list(range(m))
    least = kin.force_mapping(every_row, torque_weight=np.ones(n))(f)
    paper = force_mapping(kin.J, every_row, torque_weight=np.ones(n))(f)
    squeeze = kin.active_constraint @ paper
    excess = np.linalg.norm(paper) ** 2 - np.linalg.norm(least) ** 2
    np.testing.assert_allclose(excess, squeeze @ squeeze, atol=1e-8)
    assert excess > 1e-9  # generic loops: some of J^T f squeezes
    np.testing.assert_allclose(kin.active_constraint @ least, 0, atol=1e-9)


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_two_motors_on_one_shaft_share_the_load_as_their_weights_say(share):
    """Geared one to one, tau_1 + tau_2 is what the task feels; W3 divides it."""
    system = ConstrainedSystem([[1.0, 0.0]], [[1.0, -1.0]], [0, 1])
    weight = 1.0 / np.sqrt([share, 1.0 - share])
    mapping = system.kinematics().force_mapping([0], torque_weight=weight)
    np.testing.assert_allclose(mapping([3.0]), [3.0 * share, 3.0 * (1.0 - share)], atol=1e-12)
    # The paper's model knows no eta: which motor turns the output is then a matter of bookkeeping.
    alone = force_mapping([[1.0, 0.0]], [0], torque_weight=weight)
    np.testing.assert_allclose(alone([3.0]), [3.0, 0.0], atol=1e-12)


@given(SEEDS, st.integers(1, 3))
def test_a_desired_torque_that_only_squeezes_is_granted_in_full(seed, n_bound):
    """Preload: torques in the range of C^T move nothing, so every wish for them comes true."""
    rng = np.random.default_rng(seed)
    C = of_rank(rng, n_bound, 4, n_bound)
    mapping = force_mapping(
        rng.normal(size=(3, 4)), [0], torque_weight=np.ones(4), active_constraint=C
    )
    preload = C.T @ rng.normal(size=n_bound)
    without, with_preload = mapping([1.0]), mapping([1.0], preload)
    np.testing.assert_allclose(with_preload - without, preload, atol=1e-9)
