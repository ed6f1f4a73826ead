"""Limits of joints and tendons, ranges, contacts and pins."""

import mujoco
import numpy as np
import pytest
import scipy.linalg

from sim import Body, ModelError, Pin, assemble, jacobians, pose_of, ranges
from tests.models import model_of
from tests.motions import change, kinematics, shifted
from tests.sim.machines import limited


def position(data: mujoco.MjData, name: str) -> float:
    """Return the quantity that a limit bounds."""
    if name == "cable":
        return data.ten_length[0]
    if name == "ball":
        return float(np.linalg.norm(change(data.model, data.model.qpos0, data.qpos)[2:]))
    return data.joint(name).qpos[0]


AT_A_LIMIT = [
    ('joint "hinge"', {"hinge": np.deg2rad(60.0), "slide": 0.19}),
    ('joint "hinge"', {"hinge": np.deg2rad(-40.0), "slide": -0.05}),
    ('joint "hinge"', {"hinge": np.deg2rad(60.0) + 1e-3, "slide": 0.19}),
    ('joint "slide"', {"slide": 0.2}),
    ('joint "slide"', {"slide": -0.1 + 1e-8}),  # or as near
    ('joint "ball"', {"ball": np.deg2rad(50.0)}),
    ('joint "ball"', {"ball": np.deg2rad(50.0) + 1e-3}),
    ('tendon "cable"', {"hinge": 0.6, "slide": -0.07}),
    ('tendon "cable"', {"hinge": -0.2, "slide": 0.14}),
]


@pytest.mark.parametrize(("name", "pose"), AT_A_LIMIT)
def test_an_element_on_its_limit_gives_a_warning_or_is_stuck(name, pose):
    data = limited(**pose)
    model, joint = data.model, name.split('"')[1]
    free, stuck, listed = (
        jacobians(model, data, "tool", stuck_at_limits=choice) for choice in (False, True, [joint])
    )
    warning = f'{name} rests on its limit and is treated as free: stuck_at_limits=["{joint}"]'
    assert len(free.warnings) == 1 and free.warnings[0].startswith(warning)
    assert stuck.warnings == listed.warnings == ()
    np.testing.assert_array_equal(listed.J_C, stuck.J_C)
    assert len(stuck.J_C) == len(free.J_C) + 1

    def slope(velocity: np.ndarray) -> float:
        there, back = (shifted(model, data, h * velocity[: model.nv]) for h in (1e-4, -1e-4))
        return abs(position(there, joint) - position(back, joint)) / 2e-4

    allowed, every = scipy.linalg.null_space(stuck.J_C), scipy.linalg.null_space(free.J_C)
    assert allowed.shape[1] == every.shape[1] - 1
    assert max(map(slope, allowed.T)) < 1e-7
    assert max(map(slope, every.T)) > 0.1


def test_away_from_limits_there_is_no_warning_and_nothing_is_stuck():
    for pose in ({}, {"slide": 0.2 - 1e-4}, {"ball": np.deg2rad(50.0) - 1e-3}, {"ball": 0.0}):
        data = limited(**pose)
        free, stuck = (
            jacobians(data.model, data, "tool", stuck_at_limits=choice) for choice in (False, True)
        )
        assert free.warnings == stuck.warnings == ()
        np.testing.assert_array_equal(stuck.J_C, free.J_C)


def test_only_the_listed_elements_on_limits_are_stuck():
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
def test_limits_disabled_by_flags_have_no_effect(flag):
    data = limited(slide=0.2)
    data.model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, flag))
    jac = jacobians(data.model, data, "tool", stuck_at_limits=True)
    assert len(jac.J_C) == 2  # for the rope and the ball's motor
    assert jacobians(data.model, data, "tool").warnings == ()


SPRUNG = (
    (
        '<option gravity="0 0 0"',
        '<option gravity="0 0 0" timestep="5e-4" integrator="implicitfast"',
    ),
    ('axis="0 0 1"', 'axis="0 0 1" damping="0.02" solreflimit="0.002 1"'),
    ('name="left_elbow"', 'name="left_elbow" range="-50 0" stiffness="0.5" springref="40"'),
    ('anchor="0.2 0.2 0"', 'anchor="0.2 0.2 0" solref="0.002 1"'),
    (
        '<motor name="m1" joint="left"/><motor name="m2" joint="right"/>',
        '<position joint="left" kp="300" kv="3"/>',
    ),
    ('<joint name="wrist"/>', ""),
    ('<motor name="m3" joint="wrist"/>', ""),
)
"""Five-bar as the finger of a 2F85: one servo, a coupler that a spring presses on its limit."""


@pytest.mark.parametrize("margin", [0.0, 0.05])
@pytest.mark.parametrize("turn_rad", [1e-3, -1e-3])
def test_a_simulated_finger_moves_as_predicted_with_its_coupler_stuck(turn_rad, margin):
    """The prediction without the limit is that of a free coupler."""
    finger = model_of("five_bar", *SPRUNG)
    finger.jnt_margin[finger.joint("left_elbow").id] = margin  # at which the limit starts to act
    data = assemble(finger)
    mujoco.mj_step(finger, data, 4000)  # onto the limit, which is soft
    start = pose_of(finger, data, "tool").translation_m
    still = mujoco.MjData(finger)
    still.qpos[:] = data.qpos
    free, stuck = (
        jacobians(finger, still, "tool", stuck_at_limits=choice) for choice in (False, True)
    )
    assert len(free.warnings) == 1 and 'joint "left_elbow"' in free.warnings[0]
    data.ctrl[0] += turn_rad
    mujoco.mj_step(finger, data, 4000)
    moved = (pose_of(finger, data, "tool").translation_m - start) / turn_rad
    as_stuck, as_free = (kinematics(jac).J[3:, 0] for jac in (stuck, free))
    assert np.linalg.norm(moved - as_stuck) < 0.01 * np.linalg.norm(moved)
    assert np.linalg.norm(moved - as_free) > 0.1 * np.linalg.norm(moved)


def test_ranges_are_infinite_where_there_is_no_limit():
    data, inf = limited(), np.inf
    of_model = ranges(data.model)
    hinge = np.deg2rad([-40.0, 60.0])
    np.testing.assert_allclose(of_model.joint[:2], np.array([hinge, [-0.1, 0.2]]))
    np.testing.assert_array_equal(of_model.joint[2:], [[-inf, inf]] * 3)
    np.testing.assert_array_equal(of_model.tendon, [[-0.4, 0.5]])
    np.testing.assert_array_equal(of_model.control, [[-3, 4], [-inf, inf], [-9, 9], [-inf, inf]])
    np.testing.assert_array_equal(of_model.force, [*[[-inf, inf]] * 2, [-5, 6], [-inf, inf]])
    forces = jacobians(data.model, data, "tool").force_range  # along each velocity
    np.testing.assert_array_equal(forces, [[-3, 4], [-inf, inf], [-12, 10], [-inf, inf]])


def test_a_tendon_rests_on_its_limit_with_bodies_moved_from_outside():
    crane = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body mocap="true" pos="0 0 1"><site name="hook"/></body>
      <body><joint axis="0 1 0"/><geom size="0.1"/><site name="tool" pos="0.3 0 0.2"/></body>
      </worldbody><tendon><spatial name="rope" limited="true" range="0 2"><site site="hook"/>
      <site site="tool"/></spatial></tendon><actuator><motor tendon="rope"/></actuator></mujoco>""")
    data = mujoco.MjData(crane)
    data.mocap_pos[0] = 1.0, 0.0, 1.0
    assert not jacobians(crane, data, "tool").warnings
    data.mocap_pos[0] = 0.3, 0.0, 2.2
    (sentence,) = jacobians(crane, data, "tool").warnings
    assert sentence.startswith('tendon "rope" rests on its limit and is treated as free')


def leg(height: float = 0.0) -> mujoco.MjData:
    """Create a leg with its foot on the floor, or at a height above it."""
    data = mujoco.MjData(model_of("leg"))
    mujoco.mj_kinematics(data.model, data)
    data.qpos[2] += 0.02 * (1 - 1e-6) + height - data.geom_xpos[-1, 2]
    mujoco.mj_forward(data.model, data)
    return data


def test_contacts_give_warnings_with_the_names_of_the_bodies():
    warning = '"foot" touches "world" and is treated as free: pinned= fixes it'
    for height, margin, gap, warnings in (
        (0.0, 0.0, 0.0, (warning,)),
        (1e-3, 0.0, 0.0, ()),
        (1e-3, 2e-3, 0.0, (warning,)),  # the floor exerts force within the margin,
        (1e-3, 0.0, 2e-3, ()),
    ):
        data = leg(height)
        data.model.geom_margin[-1], data.model.geom_gap[-1] = margin, gap
        assert jacobians(data.model, data, "sole").warnings == warnings
    with pytest.raises(ModelError, match=r"no actuator moves 'trunk'.* stands on in pinned="):
        jacobians(data.model, data, "trunk")  # lifted leg


@pytest.mark.parametrize("frame", ["sole", Body("foot"), "toe", Body("toe")])
@pytest.mark.parametrize("weld", [False, True])
def test_a_pinned_frame_does_not_move_and_gives_no_warning(frame, weld):
    """A pin fixes the origin like a connect, or the rotation as well like a weld."""
    data, pins = leg(), [Pin(frame, weld=True) if weld else frame]
    jac = jacobians(data.model, data, "trunk", pinned=pins)
    assert jac.warnings == () and len(jac.J_C) == (6 if weld else 3)
    allowed = scipy.linalg.null_space(jac.J_C)
    assert allowed.shape[1] == data.model.nv - (6 if weld else 3)
    body = isinstance(frame, Body)
    place = data.body(frame.name) if body else data.site(frame)
    linear, angular = np.zeros((2, 3, data.model.nv))
    jacobian = mujoco.mj_jacBody if body else mujoco.mj_jacSite
    jacobian(data.model, data, linear, angular, place.id)
    assert np.abs(linear @ allowed).max() < 1e-14
    turns = np.abs(angular @ allowed).max()
    assert turns < 1e-14 if weld else turns > 0.1
