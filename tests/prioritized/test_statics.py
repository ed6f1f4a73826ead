"""Test the balance of power between actuators and task, eq. (4)."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prioritized import Status
from tests import spaces
from tests.random_systems import (
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
def test_force_times_velocity_is_torque_times_rate_for_every_motion(data, sample, oblique):
    """Check self-motion, redundant rows, failures; f . v = f_m . v_m + f_s . v_s in any basis."""
    system = data.draw(failures(sample.system))
    kin, rng = system.kinematics(), sample.rng
    m, n = kin.J.shape
    m1 = data.draw(st.integers(1, m))
    S = of_rank(rng, m, m, m) if oblique else np.eye(m)[data.draw(st.permutations(range(m)))]
    W3, W4 = data.draw(weights(n, rng)), data.draw(weights(m - m1, rng))
    mapping = kin.force_mapping(S[:m1], S[m1:], W3, W4)
    targets = [rng.normal(size=size) for size in (m1, n, m - m1)]
    torques = mapping(*targets)
    f = S.T @ np.append(
        targets[0] - mapping.residual(targets[0]), mapping.secondary_force(*targets)
    )

    theta_dot = spaces.motions(system)  # columns span all motions
    v, rates = system.J_T @ theta_dot, theta_dot[kin.active]
    np.testing.assert_allclose(f @ v, torques @ rates, atol=1e-7)
    # The model gives v = J rates + any self-motion.
    drifting = rng.normal(size=kin.self_motion.shape[1])
    rates = rates @ rng.normal(size=rates.shape[1])
    v = kin.J @ rates + kin.self_motion @ drifting
    np.testing.assert_allclose(f @ v, torques @ rates, atol=1e-7)


@given(st.data(), systems(), st.booleans())
def test_the_constraint_forces_of_a_mapping_balance_every_joint(data, sample, elastic):
    """Check eq. (5) with springs: [torques; 0] = J_T^T f + [J_C; E]^T f_C + K theta."""
    system = data.draw(failures(sample.system))
    N, rng = system.J_T.shape[1], sample.rng
    K = np.zeros((N, N))
    if elastic:
        R = data.draw(springs(N, rng))
        K = R.T @ R
        system = with_stiffness(system, K)
    kin = system.kinematics()
    m, n = kin.J.shape
    mapping = kin.force_mapping([0], None, np.ones(n), np.ones(m - 1))
    targets = [rng.normal(size=size) for size in (1, n, m - 1)]
    torques = mapping(*targets)
    f = np.append(targets[0] - mapping.residual(targets[0]), mapping.secondary_force(*targets))
    # Springs under the load f with active joints fixed, compared with the least energy.
    Z = spaces.self_motions(system, kin)
    fixed, directions = np.linalg.eigh(Z.T @ K @ Z)
    stretched = Z @ directions[:, fixed > ZERO]
    theta = -stretched @ ((stretched.T @ system.J_T.T @ f) / fixed[fixed > ZERO])
    loaded, closing = system.J_T.T @ f + K @ theta, spaces.closure(system).T
    on_joints = loaded + closing @ kin.constraint_force(f, torques)
    np.testing.assert_allclose(on_joints[kin.active], torques, atol=1e-6)
    np.testing.assert_allclose(on_joints[kin.passive], 0, atol=1e-6)
    # Internal torques depend on the choice of f_C.
    on_joints, rates = (
        loaded + closing @ kin.constraint_force(f),
        spaces.null(kin.active_constraint),
    )
    np.testing.assert_allclose(on_joints[kin.passive], 0, atol=1e-6)
    np.testing.assert_allclose(rates.T @ on_joints[kin.active], rates.T @ kin.J.T @ f, atol=1e-6)


@given(st.data(), systems())
def test_the_reaction_is_every_force_that_does_no_work_on_any_motion(data, sample):
    """Check that such forces change torques only by C^T eta, which compresses the loops."""
    system = data.draw(failures(sample.system))
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
