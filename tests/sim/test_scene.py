"""A file as a robot at work: what a task involves, what is left to itself, and where all rests."""

import itertools
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem
from sim import Array, Body, ModelError, Pin, Plant, jacobians, load_model
from sim.closing.equalities import closure_rows
from sim.mjcf import Part, located
from sim.mjcf.part import task_part
from sim.scene import Scene, robot_scene
from sim.scene.scene import reduced
from tests.robots import FINGER

LINK = '<joint name="{0}" axis="{1}"/><geom size="0.02" pos="0.05 0.01 0" mass="{2}"/>'


def tree(parents: list[int], ties: list[tuple[int, int]]) -> str:
    """A tree of hinges with a motor each, body k carried by `parents[k]`, and ties of two bodies.

    A tie is a connect of the origins of two bodies, open or closed: only its structure counts.
    """
    children: dict[int, list[int]] = {}
    for k, parent in enumerate(parents):
        children.setdefault(parent, []).append(k)

    def body(k: int) -> str:
        axis = ("1 0 0", "0 1 0", "0 0 1")[k % 3]
        inside = LINK.format(f"j{k}", axis, 0.1 + 0.03 * k)
        below = "".join(body(child) for child in children.get(k, []))
        return f'<body name="b{k}" pos="0.1 0.0{k} 0.02">{inside}{below}</body>'

    bodies = "".join(body(k) for k in children.get(-1, []))
    tied = "".join(f'<connect body1="b{a}" body2="b{b}" anchor="0 0 0"/>' for a, b in ties)
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(len(parents)))
    return (
        f"<mujoco><worldbody>{bodies}</worldbody><equality>{tied}</equality>"
        f"<actuator>{motors}</actuator></mujoco>"
    )


@st.composite
def trees(draw: st.DrawFn) -> tuple[str, int]:
    """Such a file, and the number of the body that is the task frame."""
    count = draw(st.integers(2, 8))
    parents = [draw(st.integers(-1, k - 1)) for k in range(count)]
    pairs = list(itertools.combinations(range(count), 2))
    ties = draw(st.lists(st.sampled_from(pairs), max_size=3, unique=True))
    return tree(parents, ties), draw(st.integers(0, count - 1))


def of_task(model: mujoco.MjModel, frame: str | Body) -> Part:
    return task_part(model, [located(model, "site", frame)], range(model.neq))


def at(model: mujoco.MjModel, qpos: Array) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


@given(trees(), st.integers(0, 99))
def test_what_is_left_out_moves_no_task_and_no_loop_of_the_task(file, seed):
    """By the numbers: its columns of the task Jacobian are zero, and no closure has both."""
    xml, body = file
    model = mujoco.MjModel.from_xml_string(xml)
    part = of_task(model, Body(f"b{body}"))
    data = at(model, np.random.default_rng(seed).uniform(-1, 1, model.nq))
    J = located(model, "site", Body(f"b{body}")).jacobian(model, data)
    np.testing.assert_allclose(J[:, part.still], 0.0, atol=1e-12)
    mine = np.setdiff1d(np.arange(model.nv), part.still)
    rows = np.abs(closure_rows(model, data)) > 1e-12
    assert not (rows[:, part.still].any(axis=1) & rows[:, mine].any(axis=1)).any()


@given(trees(), st.integers(0, 99))
def test_the_model_of_a_part_has_its_places_and_its_inertia(file, seed):
    """What does not move is carried: the mass matrix has rows and columns of the whole one."""
    xml, body = file
    spec = mujoco.MjSpec.from_string(xml)
    model = spec.compile()
    part = of_task(model, Body(f"b{body}"))
    data = at(model, np.random.default_rng(seed).uniform(-1, 1, model.nq))
    own = reduced(spec, part, data)
    own_data = at(own, data.qpos[part.positions])
    np.testing.assert_allclose(own_data.xpos, data.xpos, atol=1e-12)
    np.testing.assert_allclose(own_data.xmat, data.xmat, atol=1e-12)
    M, own_M = np.zeros((model.nv, model.nv)), np.zeros((own.nv, own.nv))
    mujoco.mj_fullM(model, data, M)
    mujoco.mj_fullM(own, own_data, own_M)
    mine = np.setdiff1d(np.arange(model.nv), part.still)
    np.testing.assert_allclose(own_M, M[np.ix_(mine, mine)], atol=1e-12)


DESK = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="3 3 0.1"/>
    <body name="upper" pos="0 0 0.6">
      <joint name="shoulder" axis="0 1 0" damping="1" armature="0.05"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" damping="1" armature="0.05"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="0.6"/>
        <site name="tip" pos="0.3 0 0"/>
        <body name="jaw" pos="0.3 0.02 0">
          <joint name="jaw" type="slide" axis="0 1 0" damping="4"/>
          <geom size="0.01" mass="0.02" contype="0" conaffinity="0"/>
        </body>
      </body>
    </body>
    <body name="ball" pos="1 1 0.3"><freejoint/><geom size="0.05" mass="0.1"/></body>
    <body name="other" pos="-1 0 0.5">
      <joint name="other" axis="0 1 0" damping="0.2"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="0.3"/>
    </body>
  </worldbody>
  <actuator>
    <position name="m1" joint="shoulder" kp="300" kv="30"/>
    <position name="m2" joint="elbow" kp="200" kv="20"/>
    <position name="pads" joint="jaw" kp="80" ctrlrange="0.003 0.045"/>
    <motor name="limp" joint="other"/>
  </actuator>
</mujoco>
"""


def desk(folder: Path, **changes: str) -> Scene:
    """The scene of an arm at its desk, some words of the file changed."""
    text = DESK
    for old, new in changes.items():
        text = text.replace(f'name="{old}"', f'name="{old}" {new}')
    file = folder / "desk.xml"
    file.write_text(text)
    return robot_scene(file, "tip", None, mujoco.MjData)


def test_props_a_hand_and_a_second_arm_come_to_rest_and_the_arm_stays(tmp_path):
    """The ball falls to the floor, the jaw goes to the end of its range, a limp arm hangs."""
    scene = desk(tmp_path)
    assert scene.part is not None and scene.part.left_out == ("jaw", "ball", "other")
    assert [scene.own.joint(j).name for j in range(scene.own.njnt)] == ["shoulder", "elbow"]
    assert scene.start.body("ball").xpos[2] == pytest.approx(0.05, abs=2e-3)
    assert scene.start.joint("jaw").qpos[0] == pytest.approx(0.003, abs=1e-5)
    assert scene.start.joint("other").qpos[0] == pytest.approx(np.pi / 2, abs=0.05)
    plant = Plant(scene.whole, base=None, payload="tip", start=scene.start, part=scene.part)
    before = plant.data.qpos.copy()
    plant.step(np.zeros(2), 1.0)
    assert np.abs(plant.displacements()).max() < 1e-6
    assert np.abs(plant.data.qpos - before)[scene.part.positions].max() < 1e-6


def test_an_arm_whose_actuators_come_after_those_of_the_rest_has_its_locks(tmp_path):
    """They are numbered anew: the second and third become the arm's two."""
    limp = '    <motor name="limp" joint="other"/>\n'
    order = DESK.replace(limp, "").replace("<actuator>\n", f"<actuator>\n{limp}")
    file = tmp_path / "desk.xml"
    file.write_text(order)
    scene = robot_scene(file, "tip", None, mujoco.MjData)
    assert scene.part is not None and scene.part.actuators == (1, 2)
    plant = Plant(scene.own, base=None, payload="tip", start=scene.own_start)
    plant.lock(1)
    plant.step(np.full(2, 0.05), 1.0)
    np.testing.assert_allclose(plant.displacements(), [0.05, 0.0], atol=1e-3)


def test_what_is_commanded_is_the_part_alone(tmp_path):
    """Everything else keeps the controls with which it came to rest."""
    scene = desk(tmp_path)
    plant = Plant(scene.whole, base=None, payload="tip", start=scene.start, part=scene.part)
    assert [drive.name for drive in plant.drives] == ["shoulder", "elbow"]
    plant.step(np.array([0.01, 0.0]), 1.0)
    np.testing.assert_allclose(plant.data.ctrl[2:], scene.start.ctrl[2:])
    np.testing.assert_allclose(plant.displacements(), [0.01, 0.0], atol=1e-3)


def test_a_servo_that_cannot_hold_the_start_sags_and_says_so(tmp_path):
    """Its weakest joint comes to rest where the range of the control ends."""
    scene = desk(tmp_path, m1='ctrlrange="0 1"')
    assert "shoulder by" in scene.moved[0]
    held = Plant(scene.whole, base=None, payload="tip", start=scene.start, part=scene.part)
    held.step(np.zeros(2), 1.0)
    assert np.abs(held.displacements()).max() < 1e-6


DIVERGING = """
<mujoco>
  <option integrator="{}"/>
  <worldbody>
    <body>
      <freejoint/>
      <geom size="0.05"/>
    </body>
    <body pos="0 0 1">
      <joint name="hip" axis="0 1 0"/>
      <geom size="0.02" pos="0.1 0 0" mass="0.1"/>
      <site name="toe" pos="0.2 0 0"/>
    </body>
  </worldbody>
  <actuator><position joint="hip" kp="100" kv="20"/></actuator>
</mujoco>
"""


def test_physics_that_diverges_is_refused_with_what_helps(tmp_path):
    """MuJoCo begins again at time zero, for ever: Euler's method explodes on so much damping."""
    file = tmp_path / "stiff.xml"
    file.write_text(DIVERGING.format("Euler"))
    with pytest.raises(ModelError, match=r"diverges, .* of 0.002 s .* EULER; .* or implicitfast$"):
        robot_scene(file, "toe", None, mujoco.MjData)
    file.write_text(DIVERGING.format("implicitfast"))
    assert robot_scene(file, "toe", None, mujoco.MjData).own.nu == 1


def test_a_joint_that_the_file_has_outside_its_range_begins_inside(tmp_path):
    """By a twentieth of the range, and it says so; from there it moves both ways."""
    scene = desk(tmp_path, elbow='range="17.2 74.5" limited="true"')
    low, high = np.deg2rad([17.2, 74.5])
    begins = low + 0.05 * (high - low)
    np.testing.assert_allclose(scene.own_start.joint("elbow").qpos, begins, atol=1e-6)
    assert re.match(
        "the start is beyond ranges, .*: elbow at 0, its range 0.3 to 1.3;", scene.moved[0]
    )
    assert scene.moved[1:] == (f"came to rest away from its start: elbow by {begins:.2g} rad",)
    plant = Plant(scene.whole, base=None, payload="tip", start=scene.start, part=scene.part)
    for way in (-0.02, 0.02):
        plant.step(np.array([0.0, way]), 1.0)
        np.testing.assert_allclose(plant.displacements(), [0.0, way], atol=1e-3)


BIPED = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="3 3 0.1"/>
    <body name="trunk" pos="0 0 0.5">
      <freejoint name="root"/>
      <geom type="box" size="0.1 0.15 0.1" mass="3"/>
      <body name="arm" pos="0.1 0 0.05">
        <joint name="lift" axis="0 1 0" damping="0.5" armature="0.02"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" mass="0.2"/>
        <site name="hand" pos="0.2 0 0"/>
      </body>
      {legs}
    </body>
  </worldbody>
  <actuator>
    <position name="lift" joint="lift" kp="50" kv="5"/>
    {motors}
  </actuator>
</mujoco>
"""
LEG = """
<body name="thigh_{0}" pos="0 {1} -0.1">
  <joint name="hip_{0}" axis="0 1 0" damping="1" armature="0.02"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 0.05 0 -0.18" mass="0.5"/>
  <body name="shin_{0}" pos="0.05 0 -0.18">
    <joint name="knee_{0}" axis="0 1 0" damping="1" armature="0.02"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 -0.05 0 -0.18" mass="0.4"/>
    <body name="{0}" pos="-0.05 0 -0.18">
      <joint name="ankle_{0}" axis="0 1 0" damping="1" armature="0.02"/>
      <geom type="box" size="0.08 0.04 0.02" pos="0.02 0 -0.02" mass="0.2"/>
    </body>
  </body>
</body>
"""
SERVO = '<position name="{0}_{1}" joint="{0}_{1}" kp="200" kv="10"/>'


def biped(folder: Path) -> Path:
    feet = "left_foot", "right_foot"
    legs = [LEG.format(foot, y) for foot, y in zip(feet, (0.1, -0.1), strict=True)]
    motors = [SERVO.format(joint, foot) for joint in ("hip", "knee", "ankle") for foot in feet]
    file = folder / "biped.xml"
    file.write_text(BIPED.format(legs="".join(legs), motors="".join(motors)))
    return file


def test_a_base_that_falls_is_refused_with_pins_that_work(tmp_path):
    """The advice is done as written: the feet stay, and the machine stands still."""
    file = biped(tmp_path)
    with pytest.raises(ModelError, match="gravity moves the free joint") as refused:
        robot_scene(file, "hand", None, mujoco.MjData)
    names = str(refused.value).split("pinned ")[1].split(",")
    assert names == ["left_foot", "right_foot"]
    pins = [Pin(name, weld=True) for name in names]
    scene = robot_scene(file, "hand", None, mujoco.MjData, pins)
    plant = Plant(scene.whole, base=None, payload="hand", start=scene.start, part=scene.part)
    feet = [plant.data.body(name).xpos.copy() for name in names]
    command = np.zeros(len(plant.drives))
    command[[drive.name for drive in plant.drives].index("lift")] = 0.05
    plant.step(command, 1.0)
    mujoco.mj_forward(plant.model, plant.data)
    for name, before in zip(names, feet, strict=True):
        np.testing.assert_allclose(plant.data.body(name).xpos, before, atol=1e-4)
    assert plant.closure_residual_m() < 1e-4


def test_a_frame_that_nothing_moves_is_refused(tmp_path):
    file = biped(tmp_path)
    still = file.read_text().replace("</worldbody>", '<site name="floor"/></worldbody>')
    file.write_text(still)
    with pytest.raises(ModelError, match="no actuator moves floor"):
        robot_scene(file, "floor", None, mujoco.MjData)


ROD = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="crank">
      <joint name="crank" axis="0 1 0" damping="0.1" armature="0.01"/>
      <geom size="0.02" mass="0.1"/>
      <body name="rod" pos="0.1 0 0">
        <joint name="ball" type="ball" damping="0.001"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0 0 0.2" mass="0.1"/>
        <site name="end" pos="0 0 0.2"/>
      </body>
    </body>
    <body name="slide" pos="0.1 0 0.2">
      <joint name="slide" type="slide" axis="1 0 0" damping="0.1"/>
      <geom size="0.02" mass="0.1"/>
      <site name="tip"/>
    </body>
  </worldbody>
  <equality><connect site1="end" site2="tip" solref="0.004 1"/></equality>
  <actuator><position joint="crank" kp="10" kv="1"/></actuator>
</mujoco>
"""


def test_a_rod_between_two_ball_joints_is_idle_about_its_axis_alone():
    """It may stand at any angle about itself, and nothing else may."""
    lock = '<joint name="lock1" joint1="crank" active="false"/></equality>'
    model = mujoco.MjModel.from_xml_string(ROD.replace("</equality>", lock))
    linear = Plant(model, base=None, payload="tip", start=mujoco.MjData(model)).linear()
    assert linear.idle == ("ball",)


def test_a_velocity_servo_becomes_a_position_servo(tmp_path):
    """Its range was one of speed, and limits no force."""
    file = tmp_path / "desk.xml"
    servo = '<velocity name="m2" joint="elbow" kv="5" ctrlrange="-1 1"/>'
    position = '<position name="m2" joint="elbow" kp="200" kv="20"/>'
    file.write_text(DESK.replace(position, servo))
    with pytest.raises(ModelError, match=r"velocity servo.*--servo"):
        robot_scene(file, "tip", None, mujoco.MjData)
    scene = robot_scene(file, "tip", None, mujoco.MjData, servo_hz=5.0)
    plant = Plant(scene.whole, base=None, payload="tip", start=scene.start, part=scene.part)
    plant.step(np.array([0.0, 0.02]), 2.0)
    np.testing.assert_allclose(plant.displacements(), [0.0, 0.02], atol=1e-3)
    assert not plant.model.actuator("m2").forcelimited


ACROBAT = """
<mujoco>
  <worldbody>
    <geom type="plane" size="3 3 0.1"/>
    <body name="torso" pos="0 0 0.5">
      <joint name="rootz" type="slide" axis="0 0 1"/>
      <geom size="0.05" mass="1"/>
      <body name="leg" pos="0 0 -0.1">
        <joint name="hip" axis="0 1 0" damping="1"/>
        <geom type="capsule" size="0.04" fromto="0 0 0 0 0 -0.3" mass="0.3"/>
        <site name="toe" pos="0 0 -0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="hip" kp="100" kv="5"/></actuator>
</mujoco>
"""


def test_a_root_that_slides_is_refused_with_what_stands_when_it_has_fallen(tmp_path):
    file = tmp_path / "acrobat.xml"
    file.write_text(ACROBAT)
    with pytest.raises(ModelError, match=r'joint "rootz": no actuator .*, pinned leg:point$'):
        robot_scene(file, "toe", None, mujoco.MjData)


TWO_LEGS = """
<mujoco>
  <worldbody>
    <body name="plate" pos="0 0 0.5">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <geom type="box" size="0.2 0.2 0.02" mass="2"/>
      <site name="top"/>
    </body>
  </worldbody>
  <actuator>
    <position name="weak" joint="lift" kp="1000" gear="1" forcerange="-5 5"/>
    <position name="strong" joint="lift" kp="1000" gear="1" forcerange="-50 50"/>
  </actuator>
</mujoco>
"""


def test_a_weak_actuator_lets_another_bear_what_is_beyond_its_range():
    """Two of 5 and 50 N bear 19.6 N, of which the least norm gives each a half."""
    lock = '<equality><joint name="lock1" joint1="lift" active="false"/></equality></mujoco>'
    model = mujoco.MjModel.from_xml_string(TWO_LEGS.replace("</mujoco>", lock))
    plant = Plant(model, base=None, payload="top", start=mujoco.MjData(model))
    np.testing.assert_allclose(plant.data.actuator_force, [5.0, 2 * 9.81 - 5.0], rtol=1e-6)
    plant.step(np.zeros(1), 1.0)
    assert np.abs(plant.displacements()).max() < 1e-6


def test_a_finger_on_one_cable_begins_where_cable_and_springs_hold_it(tmp_path):
    """Two joints, one cable: where it stands is for the springs to say, and there it stays."""
    file = tmp_path / "finger.xml"
    file.write_text(FINGER)
    scene = robot_scene(file, "tip", None, mujoco.MjData)
    assert "one by" in scene.moved[0] and "two by" in scene.moved[0]
    plant = Plant(scene.whole, base=None, payload="tip", start=scene.start, part=scene.part)
    plant.step(np.zeros(1), 2.0)
    assert np.abs(plant.pose().displacement()).max() < 1e-5
    plant.step(np.array([-1e-4]), 2.0)
    np.testing.assert_allclose(plant.displacements(), [-1e-4], atol=2e-5)


THRUSTERS = """
<mujoco>
  <worldbody>
    <body name="body" pos="0 0 1">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.02" mass="1"/>
      <site name="middle"/>
      {sites}
    </body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>
"""


def test_thrusters_have_the_attainable_set_of_any_actuator_and_no_flight_of_a_servo(tmp_path):
    """Four of 0 to 4 N lift with 0 to 16 N; each alone tilts by its arm of 0.1 m."""
    corners = [(x, y) for x in (0.1, -0.1) for y in (0.1, -0.1)]
    sites = [f'<site name="s{k}" pos="{x} {y} 0"/>' for k, (x, y) in enumerate(corners)]
    motors = [
        f'<motor name="t{k}" site="s{k}" gear="0 0 1 0 0 0" ctrlrange="0 4"/>' for k in range(4)
    ]
    file = tmp_path / "thrusters.xml"
    file.write_text(THRUSTERS.format(sites="".join(sites), motors="".join(motors)))
    model = load_model(file)
    jac = jacobians(model, mujoco.MjData(model), site="middle")
    kin, limits = ConstrainedSystem.of(jac).kinematics(), tuple(jac.force_range.T)
    lift = kin.attainable_force([5], limits)
    np.testing.assert_allclose([lift.support([1.0]), lift.support([-1.0])], [16.0, 0.0], atol=1e-9)
    tilt = kin.attainable_force([0], limits)
    np.testing.assert_allclose(tilt.support([1.0]), 2 * 4 * 0.1, atol=1e-9)
    for servo_hz in (None, 2.0):
        with pytest.raises(ModelError, match="force mapping"):
            robot_scene(file, "middle", None, mujoco.MjData, servo_hz=servo_hz)
