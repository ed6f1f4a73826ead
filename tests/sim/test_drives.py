"""Actuators: driven in a simulation, on one side only, switched off, limited, and refused."""

import itertools

import mujoco
import numpy as np
import pytest

from prioritized import ConstrainedSystem
from sim import Jacobians, ModelError, assemble, jacobians, pose_error, pose_of
from sim.mjcf import Drive, drives, element_id, names_of, number_of

# A planar five-bar on a rail, closed by a connect: three freedoms, driven by a servo on a cable
# over two joints, one on a rope between two points, and one on the rail.
GANTRY = """
<mujoco>
  <option gravity="0 0 0" timestep="5e-4" integrator="implicitfast"/>
  <default><geom contype="0" conaffinity="0" mass="0.3"/>
    <joint damping="3" armature="0.01"/></default>
  <worldbody>
    <site name="anchor" pos="-0.3 0.05 0.3"/>
    <body name="rail">
      <joint name="rail" type="slide" axis="0.6 0 0.8"/><geom size="0.02"/>
      <body name="left">
        <joint name="left" axis="0 1 0"/><geom size="0.02"/><site name="knee" pos="-0.05 0 0.2"/>
        <body name="arm" pos="-0.05 0 0.2">
          <joint name="elbow" axis="0 1 0"/><geom size="0.02"/><site name="tool" pos="0.15 0 0.2"/>
          <body name="back" pos="0.15 0 0.2">
            <joint name="tip" axis="0 1 0"/><geom size="0.02"/>
            <body name="right" pos="0.15 0 -0.2">
              <joint name="right" axis="0 1 0"/><geom size="0.02"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cable"><joint joint="left" coef="0.2"/><joint joint="elbow" coef="0.2"/></fixed>
    <spatial name="rope"><site site="anchor"/><site site="knee"/></spatial>
  </tendon>
  <equality>
    <connect body1="right" body2="rail" anchor="-0.05 0 -0.2"/>
    <tendon name="cable" tendon1="cable" active="false"/>
    <tendon name="rope" tendon1="rope" active="false"/>
    <joint name="rail" joint1="rail" active="false"/>
  </equality>
  <actuator>
    <position name="winch" tendon="cable" gear="3" kp="2e5" kv="100"/>
    <position name="hoist" tendon="rope" gear="-2" kp="2e5" kv="100"/>
    <position name="rail" joint="rail" kp="2e5" kv="100"/>
  </actuator>
</mujoco>
"""


@pytest.mark.parametrize("locked", [None, "cable", "rope", "rail"])
def test_servos_on_tendons_move_a_simulated_tool_as_the_mapping_commands(locked):
    """0.2 mm and mrad within 1 %, also with one of them stuck, by a tendon or joint equality."""
    model = mujoco.MjModel.from_xml_string(GANTRY)
    data = assemble(model)
    jac = jacobians(model, data, "tool")
    system, rows = ConstrainedSystem(jac.J_T, jac.J_C, jac.active), [1, 3, 5]
    if locked:
        system = system.with_failures(locked=[["cable", "rope", "rail"].index(locked)])
        data.eq_active[model.equality(locked).id] = True
        rows = [3, 5]
    kin = system.kinematics()
    mapping = kin.velocity_mapping(major=rows)
    at_rest, start = data.actuator_length.copy(), pose_of(model, data, "tool")
    for step in np.random.default_rng(0).normal(size=(3, len(rows))):
        step *= 2e-4 / np.linalg.norm(step)
        data.ctrl[:] = at_rest + jac.gear * kin.expand(mapping(step))
        mujoco.mj_step(model, data, 4000)
        moved = -pose_error(model, data, "tool", start)[rows]
        assert np.linalg.norm(moved - step) < 0.01 * np.linalg.norm(step)


ARM = """
<mujoco>
  <option><flag contact="disable"/></option>
  <worldbody>
    <body name="upper">
      <joint name="a" axis="0 1 0" {joint}/><geom size="0.05"/>
      <body name="lower" pos="0.4 0 0">
        <joint name="b" axis="0 1 0"/><geom size="0.05"/><site name="tool" pos="0.3 0 0"/>
      </body>
    </body>
    <body name="apart" pos="0 0 3">
      <joint name="c" axis="0 1 0"/><geom size="0.05"/><site name="flag"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cable" {tendon}><joint joint="a" coef="1"/><joint joint="b" coef="2"/></fixed>
  </tendon>
  <actuator>{actuators}</actuator>
</mujoco>
"""


def arm(
    actuators: str, disabled: int = 0, joint: str = "", tendon: str = "", site: str = "tool"
) -> Jacobians:
    xml = ARM.format(actuators=actuators, joint=joint, tendon=tendon)
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.disableactuator = disabled
    return jacobians(model, mujoco.MjData(model), site)


PAIR = '<motor name="m1" joint="a" group="1"/><motor name="m2" tendon="cable" group="2"/>'


def test_actuators_that_are_switched_off_are_not_active_and_the_warnings_say_so():
    both = arm(PAIR)
    assert both.active.tolist() == [0, 3] and both.warnings == ()
    first = arm(PAIR, disabled=1 << 2)
    assert first.active.tolist() == [0] and first.J_C.shape == (0, 3)
    assert first.warnings == ("opt.disableactuator switches off, so not active: m2",)
    second = arm(PAIR, disabled=1 << 1)
    assert second.active.tolist() == [3]
    assert second.names is not None and second.names.actuators == (("m2",),)
    assert second.warnings == ("opt.disableactuator switches off, so not active: m1",)


def test_jacobians_say_what_drives_them_after_the_model_has_changed():
    """Actuators are switched off between the reading and the question."""
    model = mujoco.MjModel.from_xml_string(ARM.format(actuators=PAIR, joint="", tendon=""))
    both = jacobians(model, mujoco.MjData(model), "tool")
    model.opt.disableactuator = 1 << 2
    assert both.names.actuators == (("m1",), ("m2",))
    assert len(both.force_range) == len(both.one_sided) == len(both.active) == 2


MUSCLE = '<muscle name="{}" joint="a" gear="{}" lengthrange="-1 1"/>'


@pytest.mark.parametrize(
    ("actuators", "side"),
    [
        ('<motor joint="a"/>', 0),
        ('<motor joint="a" ctrlrange="-1 2"/>', 0),
        ('<motor joint="a" ctrlrange="0 1"/>', 1),
        ('<motor joint="a" ctrlrange="0 1" gear="-3"/>', -1),
        ('<general joint="a" ctrlrange="0 1" gainprm="-2"/>', -1),
        ('<motor joint="a" forcerange="-4 0"/>', -1),
        ('<motor joint="a" forcerange="-4 0" gear="-1"/>', 1),
        ('<position joint="a" kp="9" ctrlrange="0 1"/>', 0),  # of the target, not of the force
        ('<position joint="a" kp="9" forcerange="0 5"/>', 1),
        (MUSCLE.format("m", 1), -1),
        (MUSCLE.format("m", -1), 1),
        (MUSCLE.format("m", 1) + MUSCLE.format("n", -2), 0),
        (MUSCLE.format("m", 1) + MUSCLE.format("n", 2), -1),
        ('<motor tendon="cable" ctrlrange="-1 0"/>', -1),
        ('<motor tendon="cable" ctrlrange="-1 0"/><motor tendon="cable" ctrlrange="0 1"/>', 0),
        (
            '<motor site="tool" gear="0 0 -1 0 0 0" ctrlrange="0 1"/>',
            1,
        ),  # its velocity is along the gear
    ],
)
def test_what_pushes_to_one_side_only_is_marked_and_the_warnings_say_so(actuators, side):
    """A negative gear turns the side of a joint round; an antagonistic pair pushes both ways."""
    jac = arm(actuators)
    assert jac.one_sided.tolist() == [side]
    name = jac.names.velocities[jac.active[0]]
    words = f"actuated in one direction only, which the mappings do not know: {name}"
    assert jac.warnings == ((words,) if side else ())


def most_and_least(xml: str, drives: tuple[Drive, ...]) -> np.ndarray:
    """Of the forces along each velocity that MuJoCo computes for all extreme and zero controls."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, forces = mujoco.MjData(model), []
    for data.ctrl[:] in itertools.product([-1e3, 0.0, 1e3], repeat=model.nu):
        mujoco.mj_forward(model, data)
        forces.append([drive.gear @ data.actuator_force[list(drive.outputs)] for drive in drives])
        if drives[0].joint is not None:
            forces[-1][0] = data.qfrc_actuator[0]
    return np.array([np.min(forces, axis=0), np.max(forces, axis=0)]).T


LIMITED = [
    ('<motor joint="a" ctrlrange="-1 2"/>', "", ""),
    ('<motor joint="a" ctrlrange="-1 2" gear="-3"/>', "", ""),
    ('<motor joint="a" ctrlrange="-1 2"/><motor joint="a" ctrlrange="0 3" gear="2"/>', "", ""),
    ('<motor joint="a" ctrlrange="-9 9" forcerange="-1 20"/>', "", ""),
    ('<position joint="a" kp="1" forcerange="-3 4"/>', "", ""),
    ('<motor joint="a" gear="3"/>', 'actuatorfrcrange="-5 7"', ""),
    ('<motor joint="a" gear="3" ctrlrange="-1 9"/>', 'actuatorfrcrange="-5 7"', ""),
    ('<motor tendon="cable" gear="3"/>', "", 'actuatorfrcrange="-5 7"'),
    ('<motor tendon="cable" gear="-3" ctrlrange="-1 9"/>', "", 'actuatorfrcrange="-5 7"'),
    ('<motor tendon="cable" gear="2"/><motor tendon="cable" gear="2" ctrlrange="0 1"/>',
     "", 'actuatorfrcrange="-5 7"'),
    ('<motor tendon="cable" gear="2" ctrlrange="0 9"/><motor tendon="cable" ctrlrange="0 1"/>',
     "", ""),
]  # fmt: skip


@pytest.mark.parametrize(("actuators", "joint", "tendon"), LIMITED)
def test_the_force_range_is_what_mujoco_lets_the_actuators_exert(actuators, joint, tendon):
    """The ranges of several add up, and the limit of the joint's or tendon's total counts."""
    found = arm(actuators, joint=joint, tendon=tendon)
    xml = ARM.format(actuators=actuators, joint=joint, tendon=tendon)
    np.testing.assert_allclose(found.force_range, most_and_least(xml, found.drives), rtol=1e-12)


def test_forces_without_a_limit_range_to_infinity():
    found = arm(PAIR + '<motor joint="b" forcerange="-1 1"/>')
    limits = [[-np.inf, np.inf], [-np.inf, np.inf], [-1.0, 1.0]]
    np.testing.assert_array_equal(found.force_range, limits)
    pulls = arm(MUSCLE.format("m", -2))
    np.testing.assert_array_equal(pulls.force_range, [[0.0, np.inf]])


@pytest.mark.parametrize(
    ("actuators", "message"),
    [
        (
            '<adhesion name="pad" body="lower" gain="1" ctrlrange="0 1"/>',
            'actuator "pad" adheres to .*: take it out .* or disable its group and pin',
        ),
        ('<motor name="m" joint="a" gear="0"/>', 'actuator "m" has gear 0 .*: take it out'),
        ('<motor tendon="cable" gear="0"/>', 'actuator "number 0" has gear 0'),
        ('<motor name="m" site="tool" gear="0 0 0 0 0 0"/>', 'actuator "m" has gear 0'),
        ("", "the model has no enabled actuator, .*: add one"),
        ('<motor name="m" joint="c"/>', "no actuator moves 'tool'"),
        ('<motor name="m" site="flag"/>', "no actuator moves 'tool'"),
    ],
)
def test_what_moves_nothing_is_refused_with_the_remedy(actuators, message):
    with pytest.raises(ModelError, match=message) as caught:
        arm(actuators)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 200


def test_a_model_whose_actuators_are_all_switched_off_commands_nothing():
    with pytest.raises(ModelError, match="no enabled actuator"):
        arm(PAIR, disabled=1 << 1 | 1 << 2)


def test_an_actuator_that_is_refused_may_be_switched_off():
    """The remedy that the message names."""
    pad = '<adhesion name="pad" body="lower" gain="1" ctrlrange="0 1" group="3"/>'
    assert arm(PAIR + pad, disabled=1 << 3).active.tolist() == [0, 3]


def test_an_unknown_actuator_is_refused_with_those_there_are_however_many_controls_they_have():
    """An orientation servo is one actuator with three controls."""
    servo = '<orientation name="wrist" joint="ball"/><motor name="m1" joint="a"/>'
    xml = ARM.format(actuators=servo, joint="", tendon="")
    ball = '<body><joint name="ball" type="ball"/><geom size="0.1"/></body><body name="'
    model = mujoco.MjModel.from_xml_string(xml.replace('<body name="', ball, 1))
    assert element_id(model, "actuator", "m1") == 1
    with pytest.raises(ModelError, match='no actuator named "hand"; it has: wrist, m1'):
        element_id(model, "actuator", "hand")


CROSSED = """
<mujoco>
  <worldbody>
    <body><joint name="a"/><geom size="0.1"/>
    <body><joint name="b"/><geom size="0.1"/>
    <body><joint name="c"/><geom size="0.1"/>
    <body><joint/><geom size="0.1"/></body></body></body></body>
  </worldbody>
  <actuator>
    <motor name="b" joint="a"/><motor name="a" joint="b"/>
    <motor name="push" joint="c"/><motor name="pull" joint="c"/>
    <general name="c" tendon="rope"/><motor tendon="wire"/>
  </actuator>
  <tendon><fixed name="rope"><joint joint="a" coef="1"/><joint joint="b" coef="1"/></fixed>
    <fixed name="wire"><joint joint="b" coef="1"/><joint joint="c" coef="1"/></fixed></tendon>
</mujoco>
"""


def test_an_actuator_has_one_name_that_no_other_has_and_answers_to_its_joints():
    """The file's own wins, also where it is the name of another's joint; two share their joint's.

    Of the two motors of joint "c" the other names come next, as "c" is an actuator of the file.
    """
    known = names_of(drives(mujoco.MjModel.from_xml_string(CROSSED)))
    assert [own for own, *_ in known] == ["b", "a", "push", "c", "wire"]
    for k, names in enumerate(known):
        assert number_of(names[0], known) == k
    assert [number_of(name, known) for name in ("pull", "rope", "number 5")] == [2, 3, 4]
