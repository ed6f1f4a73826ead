"""Jacobians of any MJCF: against finite differences on the manifold, and what is refused."""

import mujoco
import numpy as np
import pytest
import scipy.linalg

from prioritized import ConstrainedSystem
from sim import ModelError, Pose, hexapod, jacobians

# A planar four-bar closed by a connect: three closure rows of rank two.
FOUR_BAR = """
<mujoco>
  <option jacobian="{storage}"><flag contact="disable"/></option>
  <worldbody>
    <site name="ground" euler="20 30 40"/>
    <body name="crank">
      <joint name="crank" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.01"/>
      <body name="coupler" pos="0 0 0.3">
        <joint name="knee" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.01"/>
        <site name="tool" pos="0.25 0 0.1"/>
        <body name="rocker" pos="0.5 0 0">
          <joint name="elbow" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect body1="rocker" anchor="0 0 -0.3"/></equality>
  <actuator><motor name="drive" joint="crank" gear="50"/></actuator>
</mujoco>
"""

SERIAL = """
<mujoco>
  <worldbody>
    <body><joint name="a" axis="0 0 1"/><geom size="0.1"/>
      <body pos="0.4 0 0"><joint name="b" type="{kind}" axis="0 1 0"/><geom size="0.1"/>
        <site name="tool" pos="0.3 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m1" joint="a"/><motor name="m2" joint="{second}"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_a_loop_with_redundant_rows_moves_as_finite_differences_on_the_manifold(storage):
    model = mujoco.MjModel.from_xml_string(FOUR_BAR.format(storage=storage))
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="tool", axes="ground")
    assert jac.J_C.shape == (3, 3)
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
    assert kin.internal_force.shape == (1, 3)
    assert kin.active_constraint.shape == (0, 1)
    np.testing.assert_array_equal(jac.gear, [50.0])

    def tool(h: float) -> np.ndarray:
        """Where the tool is after the crank has turned by h with the loop closed (Newton)."""
        data.qpos[:] = [h, 0, 0]
        for _ in range(20):
            mujoco.mj_fwdPosition(model, data)
            J_C = jacobians(model, data, "tool").J_C
            step = np.linalg.lstsq(J_C[:, 1:], -data.efc_pos[:3], rcond=1e-9)[0]
            data.qpos[1:] += step
        mujoco.mj_fwdPosition(model, data)
        return data.site("ground").xmat.reshape(3, 3).T @ data.site("tool").xpos

    errors = []
    for h in (1e-2, 5e-3):
        finite = (tool(h) - tool(-h)) / (2 * h)
        errors.append(np.linalg.norm(finite - kin.J[3:, 0]))
    assert errors[1] < 1e-5
    assert errors[1] < 0.3 * errors[0] + 1e-9  # central differences: the error falls as h^2


def test_the_inverse_jacobian_of_the_hexapod_is_the_slope_of_its_strut_lengths(model):
    machine = hexapod(model)
    rng = np.random.default_rng(0)
    pose = Pose(np.eye(3), np.zeros(3)).moved(1e-2 * rng.normal(size=6))
    h = 1e-5
    slope = [
        (machine.displacements(pose.moved(e)) - machine.displacements(pose.moved(-e))) / (2 * h)
        for e in h * np.eye(6)
    ]
    np.testing.assert_allclose(machine.inverse_jacobian(pose), np.array(slope).T, atol=1e-9)


def test_the_models_jacobian_agrees_with_the_closed_form_away_from_the_nominal_pose(model):
    """Follow one payload motion through the whole mechanism by Newton on its closures."""
    machine = hexapod(model)
    data = mujoco.MjData(model)
    target = Pose(np.eye(3), np.zeros(3)).moved(np.array([2e-3, -1e-3, 3e-3, 5e-4, 2e-4, -4e-4]))
    struts = [model.joint(f"strut{k}") for k in range(1, 7)]
    lengths = machine.displacements(target)
    for _ in range(8):
        mujoco.mj_fwdPosition(model, data)
        jac = jacobians(model, data, "payload", "base")
        rows = np.zeros((6, model.nv))
        rows[range(6), [joint.dofadr[0] for joint in struts]] = 1.0
        gap = np.concatenate(
            [-data.efc_pos[: len(jac.J_C)], lengths - [data.joint(j.id).qpos[0] for j in struts]]
        )
        step = np.linalg.lstsq(np.vstack([jac.J_C, rows]), gap, rcond=None)[0]
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    jac = jacobians(model, data, "payload", "base")
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
    np.testing.assert_allclose(machine.inverse_jacobian(target) @ kin.J, np.eye(6), atol=1e-7)


def test_only_active_equalities_count(model):
    data = mujoco.MjData(model)
    assert len(jacobians(model, data, "payload").J_C) == 36
    data.eq_active[model.equality("lock3").id] = True
    locked = jacobians(model, data, "payload").J_C
    assert len(locked) == 37
    free = scipy.linalg.null_space(locked)
    assert np.abs(free[model.joint("strut3").dofadr[0]]).max() < 1e-12


def test_what_the_theory_has_no_word_for_is_refused_by_name():
    def check(kind: str, second: str, message: str) -> None:
        model = mujoco.MjModel.from_xml_string(SERIAL.format(kind=kind, second=second))
        with pytest.raises(ModelError, match=message):
            jacobians(model, mujoco.MjData(model), "tool")

    check("ball", "b", 'actuator "m2" does not drive a slide or hinge joint')
    check("hinge", "a", 'actuators "m1" and "m2" drive the same joint "a"')
    model = mujoco.MjModel.from_xml_string(SERIAL.format(kind="hinge", second="b"))
    with pytest.raises(ModelError, match='no site named "nose"; it has: tool'):
        jacobians(model, mujoco.MjData(model), "nose")
