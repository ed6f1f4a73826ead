"""URDF: MuJoCo compiles it, and what it does not state is asked for."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim import Body, ModelError, assemble, jacobians, load_model
from sim.scene import robot_scene

INERTIA = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
    '<origin xyz="{3}" rpy="{4}"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" effort="{5}" velocity="2"/>{6}</joint>'
)
ARM = f"""
<robot name="arm">
  <mujoco><compiler fusestatic="false"/></mujoco>
  <link name="base"/><link name="upper">{INERTIA}</link><link name="lower">{INERTIA}</link>
  <link name="finger">{INERTIA}</link><link name="tool"/>
  {JOINT.format("shoulder", "base", "upper", "0 0 0.2", "0 0.5 0", 80, "")}
  {JOINT.format("elbow", "upper", "lower", "0 0 0.3", "0 1.2 0.4", 60, "")}
  {JOINT.format("follower", "upper", "finger", "0 0.1 0", "0 0 0", 9, "MIMIC")}
  <joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/>
    <origin xyz="0.05 0 0.25"/></joint>
</robot>
""".replace("MIMIC", '<mimic joint="elbow" multiplier="-2" offset="0.1"/>')
TOOL = Body("tool")


@pytest.fixture
def file(tmp_path) -> Path:
    file = tmp_path / "arm.urdf"
    file.write_text(ARM)
    return file


def driven(file: Path) -> Path:
    """The same as MJCF, with a servo at shoulder and elbow."""
    spec = mujoco.MjSpec.from_file(str(file))
    for name in ("shoulder", "elbow"):
        spec.joint(name).armature = 0.1
        kind = mujoco.mjtTrn.mjTRN_JOINT
        spec.add_actuator(name=name, target=name, trntype=kind).set_to_position(kp=500, kv=30)
    spec.compile()
    robot = file.with_suffix(".xml")
    robot.write_text(spec.to_xml())
    return robot


def turn(axis: int, angle: float) -> np.ndarray:
    """A rotation about x, y or z."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return R


def test_a_urdf_file_moves_as_the_specification_of_urdf_says(file):
    """A fixed joint's link stays a body; roll, pitch, yaw are about fixed axes, x first."""
    model, q = load_model(file), np.array([0.3, -0.4])
    data = mujoco.MjData(model)
    for name, angle in zip(("shoulder", "elbow"), q, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(model, data)
    elbow = turn(2, 0.4) @ turn(1, 1.2) @ turn(1, q[1])
    tool = np.array([0, 0, 0.3]) + elbow @ np.array([0.05, 0, 0.25])
    tool = np.array([0, 0, 0.2]) + turn(1, 0.5) @ turn(1, q[0]) @ tool
    np.testing.assert_allclose(data.body("tool").xpos, tool, atol=1e-12)


def test_a_mimic_joint_of_urdf_is_a_closed_loop(file):
    model = load_model(driven(file))
    jac = jacobians(model, assemble(model), site=TOOL)
    elbow, follower = (model.joint(name).dofadr[0] for name in ("elbow", "follower"))
    (row,) = jac.J_C / jac.J_C[0, follower]
    assert row[elbow] == pytest.approx(2.0)
    assert jac.active.tolist() == [model.joint("shoulder").dofadr[0], elbow]


def test_the_effort_of_a_urdf_joint_limits_its_actuator(file):
    model = load_model(driven(file))
    jac = jacobians(model, assemble(model), site=TOOL)
    np.testing.assert_array_equal(jac.force_range, [[-80, 80], [-60, 60]])


def test_a_urdf_file_without_actuators_is_refused_with_the_remedy(file):
    """By the Jacobians, and by the robot that is to fly, which blamed the task frame."""
    model = load_model(file, add_locks=True)
    with pytest.raises(ModelError, match="no enabled actuator"):
        jacobians(model, assemble(model), site=TOOL)
    with pytest.raises(ModelError, match="no enabled actuator"):
        robot_scene(file, TOOL, None, mujoco.MjData)
