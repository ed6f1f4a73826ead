"""Model files: invalid numbers, added locks, logged warnings of MuJoCo, URDF."""

import logging
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import MODELS, Body, ModelError, assemble, jacobians, load_model
from sim.mjcf import element_id, model_sha256
from tests.models import FOLDER, model_of, saved
from tests.sim.machines import CASES, SHIPPED, linkage


def write_model(folder: Path, content: str) -> Path:
    file = folder / "robot.xml"
    file.write_text(content)
    return file


HUGE = ("inf", "-1e300", "1e20")
BROKEN = {  # replaced text, new text, and expected message
    'timestep="0.002"': ("timestep", ("1e9", "1e-9", "0", "-1", "inf")),
    'gravity="0 0 -9.81"': ("gravity", ("0 0 1e20", "0 inf 0")),
    'density="0"': ("density", HUGE),
    'extent="1"': ("extent", ("inf", "1e300")),
    'pos="0 0 0"': ('pos of body "arm"', ("0 0 1e20", "inf 0 0")),
    'pos="0 0 0.1"': ('pos of site "tip"', ("0 0 1e20", "inf 0 0")),
    'mass="1"': ('inertia of body "arm"', ("inf", "1e300", "1e20")),
    'friction="1"': ('friction of geom "ball"', HUGE),
    'damping="1"': ('damping of joint "hinge"', (*HUGE, "-1")),
    'stiffness="0"': ('stiffness of joint "hinge"', HUGE),
    'armature="0"': ('armature of joint "hinge"', (*HUGE, "-1")),
    'frictionloss="0"': ('frictionloss of joint "hinge"', (*HUGE, "-1")),
    'springref="0"': ('qpos_spring of joint "hinge"', HUGE),
    'damping="2"': ('damping of tendon "cord"', (*HUGE, "-1")),
    'kp="10"': ('of actuator "servo"', HUGE),
    'gear="1"': ('gear of actuator "servo"', HUGE),
    'qpos="0.5"': ('qpos of key "home"', HUGE),
    'ctrl="0.5"': ('ctrl of key "home"', HUGE),
}
NUMBERS = [(old, new, name) for old, (name, values) in BROKEN.items() for new in values]
NUMBERS += [
    (old, "NaN", f"{old.partition('=')[0]} of ")
    for old in (*BROKEN, ' range="-1 1"', 'ctrlrange="-1 1"')
]


def broken(folder: Path, old: str, new: str) -> Path:
    """Create a machine with one attribute replaced."""
    return saved(folder, "checked", (old, f'{old.partition("=")[0]}="{new}"'))


@pytest.mark.parametrize(("old", "new", "element"), NUMBERS)
def test_an_invalid_number_is_rejected_with_the_name_of_its_element(tmp_path, old, new, element):
    """NaN is rejected where MuJoCo treats it as not stated: for a mass it uses the density."""
    file = broken(tmp_path, old, new)
    with pytest.raises(ModelError) as error:
        load_model(file)
    message = str(error.value)
    assert message.startswith(f"{file}: ") and "\n" not in message
    assert element in message and (" must be " in message or new == "NaN")


@pytest.mark.parametrize(
    ("old", "new"), [(' range="-1 1"', "-inf inf"), ('name="tip"', "nan"), ('mass="1"', "1e-6")]
)
def test_numbers_that_may_be_infinite_or_small_are_accepted(tmp_path, old, new):
    assert load_model(broken(tmp_path, old, new)).nsite == 1


@pytest.mark.parametrize(
    "content",
    [
        "<mujoco nan",
        '<mujoco><option timestep="0"/></mujoco>',
        '<mujoco><worldbody><body><joint name="{a}"/></body></worldbody></mujoco>',
    ],
)
def test_an_invalid_file_has_the_same_message_with_and_without_locks(tmp_path, content):
    file, messages = write_model(tmp_path, content), []
    for add_locks in (False, True):
        with pytest.raises(ModelError) as raised:
            load_model(file, add_locks=add_locks)
        messages.append(str(raised.value))
    assert messages[0] == messages[1] and "\n" not in messages[0]


@pytest.mark.parametrize("path", ["nowhere.xml", "x" * 5000, "a\0b", ""])
@pytest.mark.parametrize("read", [load_model, model_sha256])
def test_an_invalid_file_is_one_sentence_for_model_and_hash(read, path):
    with pytest.raises(ModelError, match="there is no MJCF or URDF file"):
        read(path)


def test_assets_in_folders_next_to_the_file_are_loaded(tmp_path):
    (tmp_path / "meshes").mkdir()
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "meshes" / "link.obj").write_text(corners)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "mesh.xml").write_text(
        '<mujoco><asset><mesh name="link" file="link.obj"/></asset></mujoco>'
    )
    here = '<compiler meshdir="meshes"/><include file="parts/mesh.xml"/><worldbody>'
    mesh = '<geom type="mesh" mesh="link" mass="0.1"/>'
    capsule = 'type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" '
    changes = ("<worldbody>", here), ("<geom/>", mesh), (capsule, "")
    file = saved(tmp_path, "three_joints", *changes)
    model = load_model(file, add_locks=True)
    assert (model.nmesh, model.neq) == (1, 3)


def equalities(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Return all data of the equalities; of their numbers, those that are used."""
    names = ("type", "obj1id", "obj2id", "objtype", "active0", "solref", "solimp")
    fields = {name: getattr(model, f"eq_{name}") for name in names}
    constant = np.array([model.equality(k).data[0] for k in range(model.neq)])
    return fields | {"name": [model.equality(k).name for k in range(model.neq)], "data": constant}


@pytest.mark.parametrize("name", SHIPPED)
def test_locks_are_added_as_the_files_of_this_repository_have_them(tmp_path, name):
    """Removed from the file and added again, all equalities are as before."""
    file = MODELS / f"{name}.xml"
    content, count = re.subn(r'<joint name="lock\d+".*/>', "", file.read_text())
    complete, bare = load_model(file), write_model(tmp_path, content)
    assert count == complete.nu
    assert load_model(bare).neq == complete.neq - count
    for already in (file, bare):
        added = equalities(load_model(already, add_locks=True))
        for what, values in equalities(complete).items():
            np.testing.assert_array_equal(added[what], values)


@pytest.mark.parametrize("braked", ["false", "true"])
def test_each_joint_and_tendon_with_an_actuator_gets_one_lock(braked):
    """The lock has the name of the first actuator; an existing lock of any name is kept."""
    brake = f'<equality><joint name="brake" joint1="shoulder" active="{braked}"/></equality>'
    model, locked_parts = (
        model_of("drives", ("<actuator>", f"{brake}<actuator>"), add_locks=True),
        {},
    )
    for k in range(model.neq):
        on_tendon = model.eq_type[k] == mujoco.mjtEq.mjEQ_TENDON
        part = (model.tendon if on_tendon else model.joint)(model.eq_obj1id[k])
        locked_parts[model.equality(k).name] = part.name
    assert locked_parts == {"brake": "shoulder", "lock2": "cable", "lock3": "tube"}
    np.testing.assert_array_equal(model.eq_active0, [braked == "true", False, False])


def test_the_name_of_another_equality_is_rejected_for_a_lock(tmp_path):
    taken = '<equality><connect name="lock2" body1="shin" anchor="0 0 0"/></equality>'
    file = saved(tmp_path, "three_joints", ("<equality/>", taken))
    with pytest.raises(ModelError, match=r'^the lock of joint "knee" cannot be added: another'):
        load_model(file, add_locks=True)


def test_an_actuator_is_located_for_any_number_of_controls_of_others():
    """An orientation servo is one actuator with three controls."""
    model = linkage(actuators=CASES["orientation servo"].mjcf)
    assert element_id(model, "actuator", "b") == 1
    with pytest.raises(ModelError, match=r'no actuator named "hand"; it has: m, b$'):
        element_id(model, "actuator", "hand")
    with pytest.raises(ModelError, match=r'no equality named "lock1"; it has: none$'):
        element_id(model_of("three_joints"), "equality", "lock1")


ODD = {
    "odd.xml": "<mujoco><include file='part.xml'/></mujoco>",
    "part.xml": "<mujoco><worldbody><geom size='1' mass='nan'/></worldbody></mujoco>",
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Change to an empty folder with a machine file that causes a warning of MuJoCo."""
    monkeypatch.chdir(tmp_path)
    for name, content in ODD.items():
        (tmp_path / name).write_text(content)
    yield tmp_path
    assert {file.name for file in tmp_path.iterdir()} == set(ODD)


def test_a_warning_is_logged_and_not_written_to_a_file(here, caplog):
    with caplog.at_level(logging.WARNING, "sim"):
        load_model("odd.xml")
    assert "NaN" in caplog.text


@pytest.mark.long
@pytest.mark.parametrize(
    ("first", "target"),
    [
        ("import sim", "stderr"),
        ("import mujoco; mujoco.set_mju_user_warning(print); import sim", "stdout"),
        ("import experiments.app.cli, sim", None),
    ],
)
def test_a_program_gets_warnings_by_its_handler_and_a_command_shows_none(here, first, target):
    """Programs leave no MUJOCO_LOG.TXT in their folder."""
    done = subprocess.run(
        [sys.executable, "-c", f"{first}; sim.load_model('odd.xml')"],
        env={"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=True,
    )
    for stream in ("stdout", "stderr"):
        assert ("NaN" in getattr(done, stream)) == (stream == target)


ARM, TOOL = FOLDER / "arm.urdf", Body("tool")


def test_a_urdf_file_moves_as_specified_by_urdf():
    """The link of a fixed joint stays a body; roll, pitch, yaw are about fixed axes, x first."""
    model, q = load_model(ARM), np.array([0.3, -0.4])
    data = mujoco.MjData(model)
    for name, angle in zip(("shoulder", "elbow"), q, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(model, data)
    elbow = Rotation.from_euler("ZY", [0.4, 1.2 + q[1]])
    tool = Rotation.from_euler("Y", 0.5 + q[0]).apply(
        np.array([0, 0, 0.3]) + elbow.apply([0.05, 0, 0.25])
    )
    np.testing.assert_allclose(data.body("tool").xpos, tool + np.array([0, 0, 0.2]), atol=1e-12)


def test_a_mimic_joint_is_a_closed_loop_and_the_effort_limits_the_actuator(tmp_path):
    """Check the file as MJCF, with a servo at shoulder and elbow."""
    spec = mujoco.MjSpec.from_file(str(ARM))
    for name in ("shoulder", "elbow"):
        kind = mujoco.mjtTrn.mjTRN_JOINT
        spec.add_actuator(name=name, target=name, trntype=kind).set_to_position(kp=500, kv=30)
    spec.compile()
    model = load_model(write_model(tmp_path, spec.to_xml()))
    jac = jacobians(model, assemble(model), site=TOOL)
    elbow, follower = (model.joint(name).dofadr[0] for name in ("elbow", "follower"))
    (row,) = jac.J_C / jac.J_C[0, follower]
    assert row[elbow] == pytest.approx(2.0)
    assert jac.active.tolist() == [model.joint("shoulder").dofadr[0], elbow]
    np.testing.assert_array_equal(jac.force_range, [[-80, 80], [-60, 60]])
