"""Robots as published: locks that are added, names that are given, actuators that share groups."""

import re
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
import pytest

from sim import HEXAPOD_MJCF, ModelError, Plant, load_model
from sim.mjcf import element_id

ROBOT = """
<mujoco>
  <option timestep="2.5e-4"/>
  <default>
    <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" contype="0" conaffinity="0"/>
    <joint axis="0 1 0" armature="0.02"/>
    <position kp="200" kv="10"/>
  </default>
  <worldbody>
    <body><joint name="hip"/><geom/>
      <body pos="0 0 -0.3"><joint name="knee"/><geom/>
        <body pos="0 0 -0.3"><joint name="ankle"/><geom/><site name="foot" pos="0 0 -0.3"/></body>
      </body>
    </body>
  </worldbody>
  {equality}
  <actuator>
    <position name="hip_servo" joint="hip"/>
    <position name="knee_servo" joint="knee"/>
    <position name="ankle_servo" joint="ankle"/>
  </actuator>
</mujoco>
"""
NAMES = {"base": None, "payload": "foot"}
COMMAND = np.array([0.5, -0.4, 0.3])


def saved(folder: Path, text: str) -> Path:
    (folder / "robot.xml").write_text(text)
    return folder / "robot.xml"


@pytest.fixture
def robot(tmp_path) -> Path:
    """A file without locks, groups, or sites of our names."""
    return saved(tmp_path, ROBOT.format(equality=""))


def equalities(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """All that MuJoCo knows of them; of their numbers, those that are used."""
    names = ("type", "obj1id", "obj2id", "objtype", "active0", "solref", "solimp")
    kept = {name: getattr(model, f"eq_{name}") for name in names}
    constant = np.array([model.equality(k).data[0] for k in range(model.neq)])
    return kept | {"name": [model.equality(k).name for k in range(model.neq)], "data": constant}


def locked_in_motion(plant: Plant, actuator: int) -> tuple[float, np.ndarray]:
    """How far the joint leaves the place where it locked, and how far the others go."""
    plant.step(COMMAND, 0.1)
    plant.lock(actuator)
    start, away = plant.displacements(), []
    for _ in range(300):
        plant.step(-COMMAND, 1e-3)
        away.append(np.abs(plant.displacements() - start))
    return np.max(away, axis=0)[actuator], np.delete(away[-1], actuator)


@pytest.mark.parametrize("actuator", range(3))
def test_a_published_robot_is_locked_in_motion_by_a_lock_that_was_added(robot, actuator):
    """Under weight and servos, while the other joints move by more than 0.1 rad."""
    held, others = locked_in_motion(Plant(load_model(robot, add_locks=True), **NAMES), actuator)
    assert 0 < held < 1e-6
    assert others.min() > 0.1


@pytest.mark.parametrize("actuator", range(3))
def test_a_lock_that_was_added_gives_way_by_what_its_time_constant_says(robot, actuator):
    """At rest by a (1 - d) T^2: a the acceleration prevented, d = 0.9999, T two physics steps.

    MuJoCo takes the inertia at a lock approximately; here it is 3 % off.
    """
    model = load_model(robot, add_locks=True)
    plant = Plant(model, **NAMES)
    plant.lock(actuator)
    plant.settle(4.0, COMMAND)
    prevented = plant.data.qacc_smooth[actuator]
    expected = prevented * 1e-4 * (2 * model.opt.timestep) ** 2
    assert plant.displacements()[actuator] == pytest.approx(expected, rel=0.05)
    assert abs(prevented) > 100.0


def flown_locked(model: mujoco.MjModel, step_s: float, *locked: int) -> np.ndarray:
    """Displacements every 10 ms on a smooth path, on which some actuators lock at 0.3 s."""
    model.opt.timestep = step_s
    for k in range(model.neq):  # as add_locks has it at this step
        model.eq_solref[k] = [2 * step_s, 1.0]
    plant, seen = Plant(model, **NAMES), []
    for tick in range(100):
        if tick == 30:
            for actuator in locked:
                plant.lock(actuator)
        phase = 2 * np.pi * tick * 0.01 / 0.6
        plant.step(0.1 * np.sin(phase) * COMMAND, 0.01)
        seen.append(plant.displacements())
    return np.array(seen)


def damped(file: Path, integrator: str) -> mujoco.MjModel:
    """Whose dampers are those of joints, which every integrator takes implicitly."""
    model = load_model(file, add_locks=True)
    model.dof_damping[:], model.actuator_biasprm[:, 2] = 20.0, 0.0
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    return model


@pytest.mark.parametrize("locked", [(1,), (0, 2)])
@pytest.mark.parametrize("integrator", ["EULER", "IMPLICIT", "IMPLICITFAST", "DISCRETE"])
@pytest.mark.parametrize("step_s", [2e-3, 5e-3, 1e-2])
def test_a_lock_holds_at_any_usual_step_and_the_others_move_as_at_a_short_one(
    robot, integrator, step_s, locked
):
    """The oracle is MuJoCo at 0.1 ms, where the equality alone holds."""
    oracle = flown_locked(damped(robot, "DISCRETE"), 1e-4, *locked)
    found = flown_locked(damped(robot, integrator), step_s, *locked)
    sound = np.ptp(flown_locked(damped(robot, integrator), step_s)[31:], axis=0)
    assert (np.ptp(found[31:], axis=0)[list(locked)] < 0.05 * sound[list(locked)]).all()
    assert (np.abs(found - oracle).max(axis=0) < 0.15 * sound).all()


@pytest.mark.parametrize("flag", ["EQUALITY", "CONSTRAINT"])
def test_a_lock_holds_in_a_file_whose_flags_disable_equalities(robot, flag):
    """And nothing else that the flags disable comes back."""
    model = load_model(robot, add_locks=True)
    model.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")
    model.jnt_limited[:], model.jnt_range[:] = flag == "CONSTRAINT", [-0.05, 0.05]
    assert locked_in_motion(Plant(model, **NAMES), 1)[0] < 1e-6
    assert model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")


def test_a_lock_that_gives_way_says_so_before_anything_flies(robot):
    """On a tendon, which cannot be made heavy; as soft as a file has it; not where it holds."""
    cable = '<fixed name="cable"><joint joint="knee" coef="1"/></fixed>'
    text = ROBOT.format(equality=f"<tendon>{cable}</tendon>")
    text = text.replace('joint="knee"/>\n    <pos', 'tendon="cable"/>\n    <pos')
    said = {}
    for integrator in ("IMPLICITFAST", "DISCRETE"):
        for step_s in (2.5e-4, 1e-2):
            model = damped(saved(robot.parent, text), integrator)
            model.opt.timestep, model.eq_solref[:] = step_s, [2 * step_s, 1.0]
            said[integrator, step_s] = Plant(model, **NAMES).soft_locks
    assert {k: list(v) for k, v in said.items() if v} == {("IMPLICITFAST", 1e-2): [1]}
    words = r'lock of tendon "cable" gives way, by about \d+ % .* implicitfast .* of 10 ms'
    assert re.search(words, said["IMPLICITFAST", 1e-2][1])
    soft = load_model(robot.with_name("robot.xml"), add_locks=True)
    soft.eq_solref[:], soft.eq_solimp[:, 0] = [0.1, 1.0], 0.9
    assert "a time constant of" in Plant(soft, **NAMES).soft_locks[1]


def test_a_lock_of_mujocos_default_stiffness_does_not_hold_as_well(robot):
    model = load_model(robot, add_locks=True)
    model.eq_solref[:], model.eq_solimp[:] = [0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]
    assert locked_in_motion(Plant(model, **NAMES), 1)[0] > 1e-4


@pytest.mark.parametrize("name", ["fjh", "arm", "arms", "hand", "platform"])
def test_locks_are_added_as_the_files_of_this_repository_have_them(tmp_path, name):
    """Taken out of the file and added again, all equalities are as before."""
    file = HEXAPOD_MJCF.with_name(f"{name}.xml")
    text, count = re.subn(r'<joint name="lock\d+".*/>', "", file.read_text())
    complete, bare = load_model(file), saved(tmp_path, text)
    assert count == complete.nu
    assert load_model(bare).neq == complete.neq - count
    added = equalities(load_model(bare, add_locks=True))
    for what, values in equalities(complete).items():
        np.testing.assert_array_equal(added[what], values)


def test_nothing_is_added_to_a_file_that_has_all_locks_and_no_file_is_changed(robot):
    before = robot.read_bytes()
    locked = load_model(robot, add_locks=True)
    assert robot.read_bytes() == before
    assert (load_model(robot).neq, locked.neq) == (0, 3)
    assert not locked.eq_active0.any()
    np.testing.assert_array_equal(locked.eq_solref, [[5e-4, 1.0]] * 3)
    hexapod = load_model(HEXAPOD_MJCF, add_locks=True)
    np.testing.assert_array_equal(hexapod.eq_data, load_model(HEXAPOD_MJCF).eq_data)


MANY_DRIVES = """
<mujoco>
  <worldbody>
    <body><joint name="a"/><geom size="0.1"/><site name="tip" pos="0.2 0 0"/>
      <body><joint name="b"/><geom size="0.1"/>
        <body><joint name="round" type="ball"/><geom size="0.1"/>
          <body><joint name="c" type="slide"/><geom size="0.1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="cable"><joint joint="a" coef="1"/></fixed></tendon>
  <equality><joint name="brake" joint1="b" active="{braked}"/></equality>
  <actuator>
    <motor tendon="cable"/>
    <motor joint="round"/>
    <motor site="tip" gear="1 0 0 0 0 0"/>
    <position joint="a"/>
    <velocity joint="a"/>
    <motor joint="b"/>
    <motor jointinparent="c"/>
  </actuator>
</mujoco>
"""


@pytest.mark.parametrize("braked", ["false", "true"])
def test_each_slide_or_hinge_joint_and_tendon_with_an_actuator_gets_one_lock(tmp_path, braked):
    """Named after its first actuator; a joint that has one, of whatever name, keeps it."""
    model = load_model(saved(tmp_path, MANY_DRIVES.format(braked=braked)), add_locks=True)
    held = {}
    for k in range(model.neq):
        on_tendon = model.eq_type[k] == mujoco.mjtEq.mjEQ_TENDON
        part = (model.tendon if on_tendon else model.joint)(model.eq_obj1id[k])
        held[model.equality(k).name] = part.name
    assert held == {"brake": "b", "lock1": "cable", "lock4": "a", "lock7": "c"}
    np.testing.assert_array_equal(model.eq_active0, [braked == "true", False, False, False])


@pytest.mark.parametrize(
    "taken",
    [
        '<joint name="lock2" joint1="hip" joint2="ankle"/>',
        '<connect name="lock2" body1="shin" anchor="0 0 0"/>',
    ],
)
def test_a_name_that_another_equality_has_is_refused(tmp_path, taken):
    text = ROBOT.replace('-0.3"><joint name="knee', '-0.3" name="shin"><joint name="knee')
    file = saved(tmp_path, text.format(equality=f"<equality>{taken}</equality>"))
    with pytest.raises(ModelError, match=r'^the lock of joint "knee" cannot be added: another'):
        load_model(file, add_locks=True)


@pytest.mark.parametrize(
    "content",
    [
        "<mujoco",
        "<mujoco><wheel/></mujoco>",
        '<mujoco><option timestep="0"/></mujoco>',
        MANY_DRIVES,
    ],
)
def test_a_bad_file_has_the_same_sentence_with_and_without_locks(tmp_path, content):
    file, said = saved(tmp_path, content), []
    for add_locks in (False, True):
        with pytest.raises(ModelError) as refused:
            load_model(file, add_locks=add_locks)
        said.append(str(refused.value))
    assert said[0] == said[1]
    assert "\n" not in said[0]
    with pytest.raises(ModelError, match="there is no MJCF or URDF file"):
        load_model(tmp_path / "absent.xml", add_locks=True)


def test_assets_in_folders_beside_the_file_are_found(tmp_path):
    (tmp_path / "meshes").mkdir()
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "meshes" / "link.obj").write_text(corners)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "mesh.xml").write_text(
        '<mujoco><asset><mesh name="link" file="link.obj"/></asset></mujoco>'
    )
    text = ROBOT.replace("<mujoco>", '<mujoco><compiler meshdir="meshes"/>', 1)
    text = text.replace("<worldbody>", '<include file="parts/mesh.xml"/><worldbody>')
    text = re.sub('<geom type="capsule".*?/>', '<geom type="mesh" mesh="link" mass="0.1"/>', text)
    model = load_model(saved(tmp_path, text.format(equality="")), add_locks=True)
    assert (model.nmesh, model.neq) == (1, 3)


# Names.

BRAKES = "".join(
    f'<joint name="{joint}_brake" joint1="{joint}" active="false"/>'
    for joint in ("hip", "knee", "ankle")
)


def test_locks_may_have_other_names(tmp_path):
    file = saved(tmp_path, ROBOT.format(equality=f"<equality>{BRAKES}</equality>"))
    plant = Plant(load_model(file), **NAMES)
    plant.lock(2)
    np.testing.assert_array_equal(plant.data.eq_active, [False, False, True])
    with pytest.raises(ModelError, match=r'named "lock1" to lock the joint "hip"; load_model\('):
        Plant(load_model(saved(tmp_path, ROBOT.format(equality=""))), **NAMES)
    taken = BRAKES.replace("knee_brake", "lock1")
    file = saved(tmp_path, ROBOT.format(equality=f"<equality>{taken}</equality>"))
    with pytest.raises(ModelError, match='equality "lock1" must lock the joint "hip" alone'):
        Plant(load_model(file), **NAMES)


@pytest.mark.parametrize("argument", ["base", "payload"])
def test_a_site_that_is_not_there_is_refused_with_the_most_similar_one(robot, argument):
    model, strange = load_model(robot, add_locks=True), cast(Any, 3)
    names = dict[str, Any](NAMES)
    with pytest.raises(ModelError) as refused:
        Plant(model, **cast(Any, names | {argument: "fot"}))
    assert str(refused.value) == (
        'the model has no site named "fot"; it has: foot; did you mean "foot"?'
    )
    with pytest.raises(TypeError, match=f"^{argument} must be a str, got 3"):
        Plant(model, **(names | {argument: strange}))


def test_only_a_similar_name_is_proposed(robot):
    model = load_model(robot)
    for kind, name, ending in (
        ("joint", "kneee", 'it has: hip, knee, ankle; did you mean "knee"?'),
        ("joint", "wheel", "it has: hip, knee, ankle"),
        ("actuator", "servo_hip", "it has: hip_servo, knee_servo, ankle_servo"),
        ("equality", "lock1", "it has: none"),
    ):
        with pytest.raises(ModelError) as refused:
            element_id(model, kind, name)
        assert str(refused.value) == f'the model has no {kind} named "{name}"; {ending}'


def test_a_model_without_actuators_makes_no_plant():
    bare = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><site name='base'/></worldbody></mujoco>"
    )
    with pytest.raises(
        ModelError,
        match=r"^the model has no enabled actuator, so nothing can be commanded: add one$",
    ):
        Plant(bare)


# Groups.


def released(plant: Plant, actuator: int) -> np.ndarray:
    """Which actuators of the model give no force once this one of the plant is released."""
    plant.release(actuator)
    plant.step(np.full(len(plant.drives), 0.1), plant.model.opt.timestep)
    return np.flatnonzero(plant.data.actuator_force == 0.0)


@pytest.mark.parametrize("groups", [(0, 0, 0), (30, 30, 30), (30, 31, 5), (-1, 40, 30)])
def test_actuators_are_released_one_by_one_whatever_their_groups(robot, groups):
    model = load_model(robot, add_locks=True)
    model.actuator_group[:] = groups
    plant = Plant(model, **NAMES)
    assert released(plant, 1).tolist() == [1]
    assert released(plant, 2).tolist() == [1, 2]
    np.testing.assert_array_equal(model.actuator_group, groups)


@pytest.mark.parametrize("off", [0, 7, 30])
def test_what_the_model_has_switched_off_stays_off_and_nothing_else(robot, off):
    model = load_model(robot, add_locks=True)
    model.actuator_group[:] = [off, 30 if off != 30 else 3, 3]
    model.opt.disableactuator = 1 << off
    plant = Plant(model, **NAMES)
    assert [drive.actuators for drive in plant.drives] == [("knee_servo",), ("ankle_servo",)]
    assert released(plant, 1).tolist() == [0, 2]


def test_any_of_forty_actuators_is_released(tmp_path):
    """MuJoCo switches 31 groups."""
    bodies = "".join(
        f'<body pos="{k} 0 0"><joint name="j{k}"/><geom size="0.1" contype="0"/></body>'
        for k in range(40)
    )
    drives = "".join(f'<position joint="j{k}" group="{k}"/>' for k in range(40))
    text = f'<mujoco><worldbody><site name="foot"/>{bodies}</worldbody>'
    file = saved(tmp_path, f"{text}<actuator>{drives}</actuator></mujoco>")
    plant = Plant(load_model(file, add_locks=True), **NAMES)
    assert released(plant, 30).tolist() == [30]
    for k in (39, 0, 31):
        plant.release(k)
    assert released(plant, 17).tolist() == [0, 17, 30, 31, 39]
