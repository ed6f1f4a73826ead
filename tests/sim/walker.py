"""A walker in a plane: a trunk, two legs of hip, knee and ankle, one arm; its feet are pinned."""

import mujoco
import numpy as np

from prioritized import ConstrainedSystem, Task
from sim import Body, CenterOfMass, JacobianReader, Jacobians, Pin, pose_of

FEET = tuple(Pin(Body(f"foot_{side}"), weld=True) for side in "lr")
_STANDING = [0.0, -0.035731, 0.0, *2 * (-0.3, 0.6, -0.3), -0.9, 0.8]


def _leg(side: str, y: float) -> str:
    return f"""
      <body pos="0 {y} 0"><joint name="hip_{side}"/><geom fromto="0 0 0 0 0 -0.4" mass="1.5"/>
        <body pos="0 0 -0.4"><joint name="knee_{side}"/><geom fromto="0 0 0 0 0 -0.4" mass="1"/>
          <body name="foot_{side}" pos="0 0 -0.4"><joint name="ankle_{side}"/>
            <geom fromto="-0.05 0 0 0.1 0 0" mass="0.4"/></body></body></body>"""


_MOVED = [f"{joint}_{side}" for side in "lr" for joint in ("hip", "knee", "ankle")]
_XML = f"""
<mujoco>
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <default><joint axis="0 1 0"/><geom type="capsule" size="0.03"/></default>
  <worldbody>
    <body name="trunk" pos="0 0 0.8">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="pitch"/><geom fromto="0 0 0 0 0 0.4" mass="6"/>
      {_leg("l", 0.1)} {_leg("r", -0.1)}
      <body pos="0 0 0.35"><joint name="shoulder"/><geom fromto="0 0 0 0.25 0 0" mass="0.6"/>
        <body pos="0.25 0 0"><joint name="elbow"/><geom fromto="0 0 0 0.2 0 0" mass="0.4"/>
          <site name="hand" pos="0.2 0 0"/></body></body>
    </body>
  </worldbody>
  <actuator>{"".join(f'<motor joint="{k}"/>' for k in [*_MOVED, "shoulder", "elbow"])}</actuator>
</mujoco>
"""


def walker() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The model, standing with bent knees."""
    model = mujoco.MjModel.from_xml_string(_XML)
    data = mujoco.MjData(model)
    data.qpos[:] = _STANDING
    mujoco.mj_forward(model, data)
    return model, data


def feet_of(data: mujoco.MjData) -> np.ndarray:
    """Where the feet are: positions and quaternions, shape (14,)."""
    return np.concatenate([[*data.body(f).xpos, *data.body(f).xquat] for f in ("foot_l", "foot_r")])


def reader_of(model: mujoco.MjModel) -> JacobianReader:
    """Of the hand and the centre of mass, the feet pinned."""
    return JacobianReader(model, ["hand", CenterOfMass()], pinned=FEET)


def velocity(
    jac: Jacobians,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    start: mujoco.MjData,
    hand: np.ndarray,
) -> np.ndarray:
    """Of all joints, to be where wanted after 1 s, to first order.

    The centre of mass stays over where it is in the state `start`; then the hand goes to a
    position (3,) in the plane; then the posture returns to that of `start`.
    """
    kin = ConstrainedSystem.of(jac).kinematics()
    over = (start.subtree_com[0] - pose_of(model, data, CenterOfMass()).translation_m)[:1]
    reach = (hand - data.site("hand").xpos)[[0, 2]]
    back = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, back, 1.0, data.qpos, start.qpos)
    rates = kin.hierarchy([Task([6]), Task([3, 5]), Task.joints()])([over, reach, back[jac.active]])
    return kin.velocities(rates)
