"""What limits motion besides loops: limits of joints and tendons, and ranges."""

import mujoco
import numpy as np
import pytest

from sim import ModelError, assemble, jacobians, pose_of, ranges
from tests.motions import kinematics, motions

# An arm of a hinge, a slide and a ball, with limits all; a tendon over two of them.
LIMITED = """
<mujoco>
  <option><flag contact="disable"/></option>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 0 1" range="-40 60"/><geom size="0.1"/>
      <body pos="0.5 0 0">
        <joint name="slide" type="slide" axis="1 0 0" range="-0.1 0.2"/><geom size="0.1"/>
        <body pos="0.5 0 0">
          <joint name="ball" type="ball" range="0 50"/><geom size="0.1"/>
          <site name="tool" pos="0.2 0.1 0.3"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cable" limited="true" range="-0.4 0.5">
      <joint joint="hinge" coef="0.6"/><joint joint="slide" coef="-2"/>
    </fixed>
  </tendon>
  <actuator>
    <motor name="hinge" joint="hinge" ctrlrange="-3 4"/><motor name="slide" joint="slide"/>
    <motor name="rope" tendon="cable" gear="-2" forcerange="-5 6" ctrlrange="-9 9"/>
    <motor name="turn" joint="ball" gear="0 0 1"/>
  </actuator>
</mujoco>
"""
TURN = np.array([2.0, -1.0, 2.0]) / 3.0
"""Axis about which the ball joint is turned."""


def limited(hinge: float = 0.1, slide: float = 0.05, ball: float = 0.2) -> mujoco.MjData:
    model = mujoco.MjModel.from_xml_string(LIMITED)
    data = mujoco.MjData(model)
    data.qpos[:2] = hinge, slide
    mujoco.mju_axisAngle2Quat(data.qpos[2:], TURN, ball)
    return data


def positions(data: mujoco.MjData) -> dict[str, float]:
    """What the limits are about."""
    mujoco.mj_fwdPosition(data.model, data)
    turn = np.empty(3)
    mujoco.mju_quat2Vel(turn, data.qpos[2:], 1.0)
    return {
        'joint "hinge"': data.qpos[0],
        'joint "slide"': data.qpos[1],
        'joint "ball"': float(np.linalg.norm(turn)),
        'tendon "cable"': data.ten_length[0],
    }


AT_A_LIMIT = [
    ('joint "hinge"', {"hinge": np.deg2rad(60.0), "slide": 0.19}),
    ('joint "hinge"', {"hinge": np.deg2rad(-40.0), "slide": -0.05}),
    ('joint "hinge"', {"hinge": np.deg2rad(60.0) + 1e-3, "slide": 0.19}),  # and beyond
    ('joint "slide"', {"slide": 0.2}),
    ('joint "slide"', {"slide": -0.1 + 1e-8}),  # or as near
    ('joint "ball"', {"ball": np.deg2rad(50.0)}),
    ('joint "ball"', {"ball": np.deg2rad(50.0) + 1e-3}),
    ('tendon "cable"', {"hinge": 0.6, "slide": -0.07}),
    ('tendon "cable"', {"hinge": -0.2, "slide": 0.14}),
]


@pytest.mark.parametrize(("name", "pose"), AT_A_LIMIT)
def test_what_rests_on_a_limit_is_warned_about_or_taken_as_stuck(name, pose):
    data = limited(**pose)
    joint = name.split('"')[1]
    free, held, named = (
        jacobians(data.model, data, "tool", stuck_at_limits=choice)
        for choice in (False, True, [joint])
    )
    words = f'{name} rests on its limit and is taken to move freely: stuck_at_limits=["{joint}"]'
    assert len(free.warnings) == 1 and free.warnings[0].startswith(words)
    assert held.warnings == named.warnings == ()
    np.testing.assert_array_equal(named.J_C, held.J_C)
    assert len(held.J_C) == len(free.J_C) + 1

    here, allowed = data.qpos.copy(), motions(kinematics(held))
    assert allowed.shape[1] == motions(kinematics(free)).shape[1] - 1

    def slope(velocity: np.ndarray, h: float) -> float:
        ends = []
        for step in (h, -h):
            data.qpos[:] = here
            mujoco.mj_integratePos(data.model, data.qpos, velocity[: data.model.nv], step)
            ends.append(positions(data)[name])
        return (ends[0] - ends[1]) / (2 * h)

    for velocity in allowed.T:
        assert abs(slope(velocity, 1e-4)) < 1e-7
    assert max(abs(slope(velocity, 1e-4)) for velocity in motions(kinematics(free)).T) > 0.1


def test_away_from_limits_nothing_is_warned_about_or_stuck():
    for pose in ({}, {"slide": 0.2 - 1e-4}, {"ball": np.deg2rad(50.0) - 1e-3}, {"ball": 0.0}):
        data = limited(**pose)
        free, held = (
            jacobians(data.model, data, "tool", stuck_at_limits=choice) for choice in (False, True)
        )
        assert free.warnings == held.warnings == ()
        np.testing.assert_array_equal(held.J_C, free.J_C)


def test_of_several_at_their_limits_only_those_named_are_stuck_and_the_others_warned_about():
    data = limited(hinge=np.deg2rad(60.0), slide=0.2)
    both = jacobians(data.model, data, "tool", stuck_at_limits=True)
    hinge, slide = (
        jacobians(data.model, data, "tool", stuck_at_limits=[name]) for name in ("hinge", "slide")
    )
    np.testing.assert_array_equal(np.vstack([hinge.J_C, slide.J_C[-1:]]), both.J_C)
    assert hinge.J_C[-1].tolist() == [1, 0, 0, 0, 0, 0, 0]
    assert len(hinge.warnings) == 1 and 'joint "slide"' in hinge.warnings[0]
    assert len(slide.warnings) == 1 and 'joint "hinge"' in slide.warnings[0]
    with pytest.raises(ModelError, match='"ball" rests on no limit; those that do: hinge, slide'):
        jacobians(data.model, data, "tool", stuck_at_limits=["ball"])


@pytest.mark.parametrize("flag", ["mjDSBL_LIMIT", "mjDSBL_CONSTRAINT"])
def test_limits_that_the_models_flags_switch_off_hold_nothing(flag):
    data = limited(slide=0.2)
    data.model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, flag))
    jac = jacobians(data.model, data, "tool", stuck_at_limits=True)
    assert len(jac.J_C) == 2  # of the rope and of the ball's motor
    assert jacobians(data.model, data, "tool").warnings == ()


# A finger as the 2F85's: a five-bar with one servo, whose coupler a spring presses on its limit.
GRIPPER = """
<mujoco>
  <option gravity="0 0 0" timestep="5e-4" integrator="implicitfast"/>
  <default>
    <geom size="0.01" mass="0.05" contype="0" conaffinity="0"/>
    <joint axis="0 1 0" damping="0.02" solreflimit="0.002 1"/>
  </default>
  <worldbody>
    <body name="driver">
      <joint name="driver"/><geom/>
      <body name="coupler" pos="0 0 0.1">
        <joint name="coupler" range="-50 0" stiffness="0.5" springref="40"/><geom/>
      </body>
    </body>
    <body name="link" pos="0.05 0 0">
      <joint name="link"/><geom/>
      <body name="follower" pos="0.04 0 0.08">
        <joint name="follower"/><geom/><site name="tip" pos="0.02 0 0.15"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect body1="coupler" body2="follower" anchor="0.06 0 0.06" solref="0.002 1"/>
  </equality>
  <actuator><position name="servo" joint="driver" kp="300" kv="3"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("margin", [0.0, 0.05])
@pytest.mark.parametrize("turn_rad", [1e-3, -1e-3])
def test_a_simulated_finger_moves_as_predicted_once_its_coupler_counts_as_stuck(turn_rad, margin):
    """Predicted without, the follower turns as if the coupler were free, which it is not."""
    model = mujoco.MjModel.from_xml_string(GRIPPER)
    model.jnt_margin[model.joint("coupler").id] = margin  # where the limit begins to push back
    data = assemble(model)
    mujoco.mj_step(model, data, 4000)  # onto the limit, which gives a little
    start = pose_of(model, data, "tip").translation_m
    still = mujoco.MjData(model)
    still.qpos[:] = data.qpos
    free, held = (
        jacobians(model, still, "tip", stuck_at_limits=choice) for choice in (False, True)
    )
    assert len(free.warnings) == 1 and 'joint "coupler"' in free.warnings[0]
    data.ctrl[0] += turn_rad
    mujoco.mj_step(model, data, 4000)
    moved = (pose_of(model, data, "tip").translation_m - start) / turn_rad
    as_stuck, as_free = (kinematics(jac).J[3:, 0] for jac in (held, free))
    assert np.linalg.norm(moved - as_stuck) < 0.01 * np.linalg.norm(moved)
    assert np.linalg.norm(moved - as_free) > 0.1 * np.linalg.norm(moved)


def test_ranges_are_read_out_as_arrays_and_infinite_where_there_is_none():
    model, inf = limited().model, np.inf
    of_model = ranges(model)
    hinge = np.deg2rad([-40.0, 60.0])
    np.testing.assert_allclose(of_model.joint[:2], np.array([hinge, [-0.1, 0.2]]))
    np.testing.assert_array_equal(of_model.joint[2:], [[-inf, inf]] * 3)
    np.testing.assert_array_equal(of_model.tendon, [[-0.4, 0.5]])
    np.testing.assert_array_equal(of_model.control, [[-3, 4], [-inf, inf], [-9, 9], [-inf, inf]])
    np.testing.assert_array_equal(of_model.force, [*[[-inf, inf]] * 2, [-5, 6], [-inf, inf]])


def test_the_force_of_each_velocity_is_that_of_its_actuators():
    data, inf = limited(), np.inf
    jac = jacobians(data.model, data, "tool")
    forces = [[-3, 4], [-inf, inf], [-12, 10], [-inf, inf]]
    np.testing.assert_array_equal(jac.force_range, forces)


CRANE = """
<mujoco>
  <worldbody>
    <body name="hook" mocap="true" pos="0 0 1"><site name="hook"/></body>
    <body>
      <joint axis="0 1 0"/><geom size="0.1"/><site name="tool" pos="0.3 0 0.2"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope" limited="true" range="0 2"><site site="hook"/><site site="tool"/></spatial>
  </tendon>
  <actuator><motor tendon="rope"/></actuator>
</mujoco>
"""


def test_a_tendon_rests_on_its_limit_in_the_state_with_bodies_moved_from_outside():
    model = mujoco.MjModel.from_xml_string(CRANE)
    data = mujoco.MjData(model)
    data.mocap_pos[0] = 1.0, 0.0, 1.0
    assert not jacobians(model, data, "tool").warnings
    data.mocap_pos[0] = 0.3, 0.0, 2.2
    assert jacobians(model, data, "tool").warnings == (
        'tendon "rope" rests on its limit and is taken to move freely: stuck_at_limits=["rope"] '
        "takes it as stuck",
    )
