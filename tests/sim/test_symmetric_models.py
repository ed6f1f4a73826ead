"""What a symmetric model is read as, and what a refusal names: not as its last bits say."""

import mujoco
import numpy as np
import pytest

from fjh.rig.hexapod.closed_form import Hexapod
from sim import NOMINAL, ClosureError, ModelError, Plant, assemble, jacobians, linearize, load_model
from sim.mjcf.frame import rotation_vector

PROCESSORS = range(12)

TWO_OPEN = """<mujoco><worldbody>
  <body name="a"><joint name="a" type="slide"/><geom size="0.1"/><site name="tool"/></body>
  <body name="b" pos="1 0 0"><joint name="b" type="slide"/><geom size="0.1"/></body></worldbody>
  <equality><joint name="left" joint1="a" polycoef="{0!r} 0 0 0 0"/>
  <joint name="right" joint1="b" polycoef="{1!r} 0 0 0 0"/></equality>
  <actuator><position joint="a" kp="9"/></actuator></mujoco>"""
TWO_FALL = """<mujoco><worldbody>
  <body name="a"><joint name="left" axis="0 1 0"/><geom size="0.1" pos="{0!r} 0 0"/></body>
  <body name="b" pos="1 0 0"><joint name="right" axis="0 -1 0"/><geom size="0.1" pos="-{1!r} 0 0"/>
  </body><body name="c" pos="2 0 0"><joint name="c" type="slide" axis="1 0 0"/><geom size="0.1"/>
    <site name="payload"/></body></worldbody>
  <actuator><position name="c" joint="c" kp="9"/></actuator></mujoco>"""
MORE = 0.1 + 1e-15
BITS = [(0.1, 0.1), (0.1, MORE), (MORE, 0.1)]


@pytest.mark.parametrize("numbers", BITS)
def test_of_two_equal_gaps_the_first_is_named(numbers):
    model = mujoco.MjModel.from_xml_string(TWO_OPEN.format(*map(float, numbers)))
    with pytest.raises(ClosureError, match='"left"'):
        jacobians(model, mujoco.MjData(model), site="tool")


@pytest.mark.parametrize("numbers", BITS)
def test_of_two_equal_pendulums_the_first_is_said_to_fall(numbers, tmp_path):
    (tmp_path / "two.xml").write_text(TWO_FALL.format(*map(float, numbers)))
    with pytest.raises(ModelError, match='gravity moves the joint "left"'):
        model = load_model(tmp_path / "two.xml", add_locks=True)
        Plant(model, base=None, start=mujoco.MjData(model))


@pytest.mark.parametrize("axis", [(0.6, -0.8, 0.0), (0.0, 0.8, -0.6), (0.0, 0.0, 1.0)])
def test_a_half_turn_has_one_vector(axis):
    """By pi about an axis is by pi about its opposite; a component that rounds to 0 has no sign."""
    for seed in PROCESSORS:
        half = 2 * np.outer(axis, axis) - np.eye(3)
        found = rotation_vector(half + 1e-16 * np.random.default_rng(seed).normal(size=(3, 3)))
        np.testing.assert_allclose(found, np.pi * np.array(axis), atol=1e-7)


def test_parallel_gears_are_one_velocity_whatever_rounding_made_of_a_zero():
    xml = """<mujoco><worldbody><body><freejoint/><geom size="0.1"/><site name="s"/></body>
    </worldbody><actuator><motor site="s" gear="{} 1 0 0 0 0"/>
    <motor site="s" gear="{} -1 0 0 0 0"/></actuator></mujoco>"""
    for one, other in ((6e-17, 6e-17), (-6e-17, 6e-17), (0.0, -6e-17)):
        model = mujoco.MjModel.from_xml_string(xml.format(one, other))
        assert len(jacobians(model, mujoco.MjData(model), site="s").active) == 1


PARALLELOGRAM = """<mujoco><compiler angle="radian"/><default><joint axis="0 0 1" stiffness="5"/>
  <geom type="capsule" size="0.01" fromto="0 0 0 0 0.3 0"/></default><worldbody>
  <body name="left"><joint name="left"/><geom/><body name="bar" pos="0 0.3 0"><joint name="bar"/>
    <geom fromto="0 0 0 0.4 0 0"/><site name="tool"/></body></body>
  <body name="middle" pos="0.2 0 0"><joint name="middle"/><geom/></body>
  <body name="right" pos="0.4 0 0"><joint name="right"/><geom/></body></worldbody>
  <equality><connect body1="bar" body2="middle" anchor="0.2 0 0"/>
  <connect body1="bar" body2="right" anchor="0.4 0 0"/></equality>
  <actuator><position joint="left" kp="80"/></actuator></mujoco>"""


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.7])
def test_a_crank_too_many_takes_no_freedom_from_a_linear_model(turn):
    """Three parallel cranks have one freedom; closed to 1e-11, the third is no constraint more."""
    model = mujoco.MjModel.from_xml_string(PARALLELOGRAM)
    data = mujoco.MjData(model)
    data.qpos[[0, 2, 3]], data.qpos[1] = turn + 1e-3, -turn
    held = assemble(model, data)
    held.qpos[3] += 2e-11
    assert len(linearize(model, held, site="tool", axes=None).A) == 2


@pytest.mark.parametrize("length", [0.3, np.nextafter(0.3, 0), np.nextafter(0.3, 1), 0.3 + 1e-12])
def test_a_cable_that_just_begins_to_pull_has_its_stiffness(length):
    """Its spring begins at 0.3 m, which is where it is."""
    model = mujoco.MjModel.from_xml_string(CABLE.format(float(length)))
    jac = jacobians(model, mujoco.MjData(model), site="tool")
    assert jac.stiffness is not None
    np.testing.assert_allclose(jac.stiffness, [[50.0]])


CABLE = """<mujoco><worldbody><site name="top" pos="0 0 {!r}"/><body><joint name="z" type="slide"
  axis="0 0 1"/><geom size="0.01"/><site name="tool"/></body></worldbody>
  <tendon><spatial name="cable" springlength="0 0.3" stiffness="50"><site site="top"/>
  <site site="tool"/></spatial></tendon><actuator><motor joint="z"/></actuator></mujoco>"""


@pytest.mark.parametrize("turn", np.linspace(0.0, 2.0, 9))
def test_a_payload_turned_by_a_right_angle_is_held_by_no_struts(turn):
    """Fichter, "A Stewart platform-based manipulator" (1986): elimination leaves round-off."""
    angle = turn + np.radians([10, 110, 130, 230, 250, 350])
    bottom_m = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    top_m = 0.5 * bottom_m @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + np.eye(3)[2]
    with pytest.raises(ValueError, match="singular"):
        Hexapod(bottom_m, top_m).moved(NOMINAL, 1e-6 * np.arange(6.0))
