"""Scenes: the part that a task involves, the rest of the file, and its equilibrium."""

import itertools
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import Array, Body, ModelError, Pin, Plant
from sim.closing.equalities import closure_rows
from sim.mjcf import located, mass_matrix
from sim.mjcf.part import task_part
from sim.scene import Scene, robot_scene
from sim.scene.scene import reduced
from tests.models import FOLDER, saved


def tree(parents: list[int], ties: list[tuple[int, int]]) -> mujoco.MjSpec:
    """Create a tree of hinges with motors, body k attached to `parents[k]`, and some connects."""
    spec = mujoco.MjSpec()
    bodies = [spec.worldbody]
    for k, parent in enumerate(parents):
        body = bodies[parent + 1].add_body(name=f"b{k}", pos=[0.1, 0.01 * k, 0.02])
        body.add_joint(name=f"j{k}", axis=np.eye(3)[k % 3])
        body.add_geom(size=[0.02, 0, 0], pos=[0.05, 0.01, 0], mass=0.1 + 0.03 * k)
        spec.add_actuator(target=f"j{k}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        bodies.append(body)
    for a, b in ties:
        kind, of = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_BODY
        spec.add_equality(type=kind, objtype=of, name1=f"b{a}", name2=f"b{b}", data=np.zeros(12))
    return spec


@st.composite
def trees(draw: st.DrawFn) -> tuple[mujoco.MjSpec, int]:
    """Sample such a tree, and the number of the body that is the task frame."""
    count = draw(st.integers(2, 8))
    parents = [draw(st.integers(-1, k - 1)) for k in range(count)]
    pairs = list(itertools.combinations(range(count), 2))
    ties = draw(st.lists(st.sampled_from(pairs), max_size=3, unique=True))
    return tree(parents, ties), draw(st.integers(0, count - 1))


def at(model: mujoco.MjModel, qpos: Array) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


@given(trees(), st.integers(0, 99))
def test_a_part_has_all_joints_of_the_task_with_their_inertia(file, seed):
    """Columns of the rest are zero, no closure has both, and M has rows of the whole one."""
    spec, body = file
    model = spec.compile()
    frame = located(model, "site", Body(f"b{body}"))
    part = task_part(model, [frame], range(model.neq))
    data = at(model, np.random.default_rng(seed).uniform(-1, 1, model.nq))
    np.testing.assert_allclose(
        frame.jacobian(model, data)[:, part.other_velocities], 0.0, atol=1e-12
    )
    mine = np.setdiff1d(np.arange(model.nv), part.other_velocities)
    rows = np.abs(closure_rows(model, data)) > 1e-12
    assert not (rows[:, part.other_velocities].any(axis=1) & rows[:, mine].any(axis=1)).any()
    own = reduced(spec, part, data)
    own_data = at(own, data.qpos[part.positions])
    np.testing.assert_allclose(own_data.xpos, data.xpos, atol=1e-12)
    np.testing.assert_allclose(own_data.xmat, data.xmat, atol=1e-12)
    M = mass_matrix(model, data)[np.ix_(mine, mine)]
    np.testing.assert_allclose(mass_matrix(own, own_data), M, atol=1e-12)


def scene_of(file: Path, site: str = "tip", *more, **options) -> Scene:
    return robot_scene(file, site, None, mujoco.MjData, *more, **options)


def plant_of(scene: Scene, payload: str = "tip") -> Plant:
    return Plant(scene.model, base=None, payload=payload, start=scene.start, part=scene.part)


def desk(folder: Path, **changes: str) -> Scene:
    """Create the scene of an arm at its desk, with some elements changed."""
    replacements = [(f'name="{name}"', f'name="{name}" {new}') for name, new in changes.items()]
    return scene_of(saved(folder, "desk", *replacements))


def moved(plant: Plant, *command: float, seconds: float = 0.5) -> np.ndarray:
    plant.step(np.array(command), seconds)
    return plant.displacements()


def test_objects_a_hand_and_a_second_arm_come_to_rest_and_the_arm_stays(tmp_path):
    """The ball falls, the jaw moves to the end of its range, an unpowered arm hangs."""
    scene = desk(tmp_path)
    assert scene.part is not None and scene.part.left_out == ("jaw", "ball", "other")
    assert [scene.task_model.joint(j).name for j in range(scene.task_model.njnt)] == [
        "shoulder",
        "elbow",
    ]
    assert scene.start.body("ball").xpos[2] == pytest.approx(0.05, abs=2e-3)
    assert scene.start.joint("jaw").qpos[0] == pytest.approx(0.003, abs=1e-5)
    assert scene.start.joint("other").qpos[0] == pytest.approx(np.pi / 2, abs=0.05)
    plant = plant_of(scene)
    before = plant.data.qpos.copy()
    assert np.abs(moved(plant, 0.0, 0.0)).max() < 1e-6
    assert np.abs(plant.data.qpos - before)[scene.part.positions].max() < 1e-6
    # Only the part is commanded; other controls keep the values of the equilibrium.
    assert [drive.name for drive in plant.drives] == ["shoulder", "elbow"]
    np.testing.assert_allclose(moved(plant, 0.01, 0.0), [0.01, 0.0], atol=1e-3)
    np.testing.assert_allclose(plant.data.ctrl[2:], scene.start.ctrl[2:])


def test_an_arm_whose_actuators_come_after_others_has_its_locks(tmp_path):
    """Actuators are renumbered: the second and third become the arm's two."""
    motor = '    <motor name="limp" joint="other"/>\n'
    scene = scene_of(saved(tmp_path, "desk", (motor, ""), ("<actuator>\n", f"<actuator>\n{motor}")))
    assert scene.part is not None and scene.part.actuators == (1, 2)
    plant = Plant(scene.task_model, base=None, payload="tip", start=scene.task_start)
    plant.lock(1)
    np.testing.assert_allclose(moved(plant, 0.05, 0.05), [0.05, 0.0], atol=1e-3)


def test_a_servo_too_weak_for_the_start_sags_with_a_warning(tmp_path):
    """The weakest joint comes to rest at the end of the control range."""
    scene = desk(tmp_path, m1='ctrlrange="0 1"')
    assert "shoulder by" in scene.start_warnings[0]
    assert np.abs(moved(plant_of(scene), 0.0, 0.0)).max() < 1e-6


def test_a_joint_outside_its_range_in_the_file_starts_inside(tmp_path):
    """The joint starts inside by a twentieth of the range, and can move both ways."""
    scene = desk(tmp_path, elbow='range="17.2 74.5" limited="true"')
    low, high = np.deg2rad([17.2, 74.5])
    begins = low + 0.05 * (high - low)
    np.testing.assert_allclose(scene.task_start.joint("elbow").qpos, begins, atol=1e-6)
    assert re.match(
        "the start is beyond .*: elbow at 0, its range 0.3 to 1.3 rad;", scene.start_warnings[0]
    )
    assert scene.start_warnings[1:] == (
        f"came to rest away from its start: elbow by {begins:.2g} rad",
    )
    plant = plant_of(scene)
    for target in (-0.02, 0.02):
        np.testing.assert_allclose(moved(plant, 0.0, target, seconds=1.0), [0.0, target], atol=1e-3)


def test_a_finger_on_one_cable_starts_in_balance_with_its_springs():
    """Two joints on one cable: the springs determine the posture."""
    scene = scene_of(FOLDER / "finger.xml")
    assert "one by" in scene.start_warnings[0] and "two by" in scene.start_warnings[0]
    plant = plant_of(scene)
    plant.step(np.zeros(1), 2.0)
    assert np.abs(plant.pose().displacement()).max() < 1e-5
    np.testing.assert_allclose(moved(plant, -1e-4, seconds=2.0), [-1e-4], atol=2e-5)


def test_diverging_physics_is_rejected_with_advice_that_helps(tmp_path):
    """Euler's method diverges with this damping, and MuJoCo would restart at time zero."""
    damped = ('kv="30"', 'kv="3000"')
    euler = saved(tmp_path, "desk", damped, ('"implicitfast"', '"Euler"'))
    with pytest.raises(ModelError, match=r"diverges, .* of 0.002 s .* EULER; .* or implicitfast$"):
        scene_of(euler)
    assert scene_of(saved(tmp_path, "desk", damped)).task_model.nu == 2


def test_a_falling_base_is_rejected_with_pins_that_work():
    """The feet stay with the advised pins, and the machine is at rest."""
    file = FOLDER / "walker.xml"
    with pytest.raises(ModelError, match="gravity moves the free joint") as error:
        scene_of(file, "hand")
    names = str(error.value).split("pinned ")[1].split(",")
    assert names == ["foot_l", "foot_r"]
    scene = scene_of(file, "hand", [Pin(name, weld=True) for name in names])
    plant = plant_of(scene, "hand")
    feet = [plant.data.body(name).xpos.copy() for name in names]
    command = np.zeros(len(plant.drives))
    command[[drive.name for drive in plant.drives].index("elbow")] = 0.05
    plant.step(command, 0.5)
    mujoco.mj_forward(plant.model, plant.data)
    for name, before in zip(names, feet, strict=True):
        np.testing.assert_allclose(plant.data.body(name).xpos, before, atol=1e-4)
    assert plant.closure_residual_m() < 1e-4
    with pytest.raises(ModelError, match="no actuator moves floor"):
        scene_of(file, "floor")


def test_thrusters_have_a_force_mapping_but_no_servo_simulation(tmp_path):
    corners = [(x, y) for x in (0.1, -0.1) for y in (0.1, -0.1)]
    sites = "".join(f'<site name="s{k}" pos="{x} {y} 0"/>' for k, (x, y) in enumerate(corners))
    motors = "".join(f'<motor site="s{k}" gear="0 0 1 0 0 0" ctrlrange="0 4"/>' for k in range(4))
    xml = f"""<mujoco><worldbody><body pos="0 0 1"><freejoint/><geom size="0.1"/>
      <site name="tip"/>{sites}</body></worldbody><actuator>{motors}</actuator></mujoco>"""
    file = tmp_path / "thrusters.xml"
    file.write_text(xml)
    for servo_hz in (None, 2.0):
        with pytest.raises(ModelError, match="force mapping"):
            scene_of(file, servo_hz=servo_hz)
