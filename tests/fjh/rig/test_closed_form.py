"""The hexapod's Jacobian as printed, and failures of models against all motions they allow."""

import mujoco
import numpy as np
import pytest

from fjh.rig.hexapod import paper
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import ConstrainedSystem
from sim import NOMINAL, jacobians


def system_of(model: mujoco.MjModel, axes: str | None = None) -> ConstrainedSystem:
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes=axes)
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active)


def test_the_jacobian_of_the_model_is_eq_39_signs_included(model):
    kin = system_of(model, "base").kinematics()
    np.testing.assert_allclose(kin.J, paper.JACOBIAN, atol=6e-4)
    assert kin.J[1, 0] == pytest.approx(1.00455, abs=5e-6)  # printed as 1.004
    assert np.linalg.cond(kin.J) == pytest.approx(paper.CONDITION_NUMBER, abs=0.005)
    A = hexapod(model).inverse_jacobian(NOMINAL)
    np.testing.assert_allclose(A @ kin.J, np.eye(6), atol=1e-12)
    # The paper's Diag[10, 10, 1, 1] must fall on the translations across the line of sight.
    np.testing.assert_allclose(kin.J[SECONDARY], paper.JACOBIAN[[3, 4, 5, 2]], atol=6e-4)
    np.testing.assert_allclose(kin.J[MAJOR], paper.JACOBIAN[[0, 1]], atol=6e-4)


def test_a_locked_strut_loses_its_column_along_which_a_free_one_moves(model):
    """Six struts, six degrees of freedom: here, and only here, dropping the column is right."""
    system = system_of(model, "base")
    J = system.kinematics().J
    locked = system.with_failures(locked=[0]).kinematics()
    np.testing.assert_allclose(locked.J, J[:, 1:], atol=1e-10)
    assert locked.self_motion.shape == (6, 0)
    assert locked.active_constraint.shape == (0, 5)
    free = system.with_failures(free=[2]).kinematics()
    assert free.self_motion.shape == (6, 1)
    column = J[:, 2] / np.linalg.norm(J[:, 2])
    assert abs(column @ free.self_motion[:, 0]) == pytest.approx(1.0)
