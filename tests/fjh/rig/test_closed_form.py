"""The hexapod's Jacobian as printed."""

import mujoco
import numpy as np
import pytest

from fjh.rig.hexapod import paper
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import ConstrainedSystem
from sim import NOMINAL, jacobians


def test_the_jacobian_of_the_model_is_eq_39_signs_included(model):
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
    np.testing.assert_allclose(kin.J, paper.JACOBIAN, atol=6e-4)
    assert kin.J[1, 0] == pytest.approx(1.00455, abs=5e-6)  # printed as 1.004
    assert np.linalg.cond(kin.J) == pytest.approx(paper.CONDITION_NUMBER, abs=0.005)
    A = hexapod(model).inverse_jacobian(NOMINAL)
    np.testing.assert_allclose(A @ kin.J, np.eye(6), atol=1e-12)
    # The paper's Diag[10, 10, 1, 1] must fall on the translations across the line of sight.
    np.testing.assert_allclose(kin.J[SECONDARY], paper.JACOBIAN[[3, 4, 5, 2]], atol=6e-4)
    np.testing.assert_allclose(kin.J[MAJOR], paper.JACOBIAN[[0, 1]], atol=6e-4)
