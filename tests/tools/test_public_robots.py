"""Tests of `make robots` that need no packages, on small files."""

import csv
import io
from pathlib import Path

import mujoco
import numpy as np

from sim import MODELS, Body, jacobians
from tools.public_robots.registry import files
from tools.public_robots.stripping import stripped
from tools.public_robots.summary import COLUMNS, table, totals
from tools.public_robots.task_frame import task_frame
from tools.public_robots.trial import difference_error, power_error

MESHED = """
<mujoco>
  <compiler inertiafromgeom="true"/>
  <default>
    <default class="shown"><geom type="mesh" material="grey" density="700"/></default>
  </default>
  <asset><mesh name="wedge" vertex="0 0 0  0.2 0 0  0 0.3 0  0 0 0.4"/><material name="grey"/>
    <texture name="sky" type="skybox" builtin="gradient" width="8" height="48"/></asset>
  <worldbody>
    <body name="upper">
      <joint name="j1" axis="0 1 0" frictionloss="0.1"/>
      <geom class="shown" mesh="wedge"/>
      <body name="lower" pos="0 0 0.4">
        <joint name="j2" axis="1 0 0"/>
        <geom class="shown" mesh="wedge" euler="30 0 0"/>
        <geom class="shown" type="sphere" size="0.05" name="tip"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="j1" kp="50"/><motor joint="j2" gear="2"/></actuator>
</mujoco>
"""


def of_text(text):
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def test_a_stripped_robot_moves_as_the_whole_one(tmp_path):
    """Equal forces give equal accelerations, and no asset file is needed."""
    file = tmp_path / "robot.xml"
    file.write_text(MESHED)
    whole, data = of_text(MESHED)
    bare, other = of_text(stripped(file))
    assert (bare.nmesh, bare.nmat, bare.ntex, bare.ngeom) == (0, 0, 0, 1)
    for state in (data, other):
        state.qpos[:], state.qvel[:], state.ctrl[:] = [0.4, -0.7], [1.0, 2.0], [0.3, -1.0]
    mujoco.mj_forward(whole, data)
    mujoco.mj_forward(bare, other)
    assert np.abs(data.qacc).max() > 1.0
    np.testing.assert_allclose(other.qacc, data.qacc, rtol=1e-4)  # MJCF is written with six digits


def test_files_that_others_include_and_those_of_tests_are_no_robots(tmp_path):
    for name, text in {
        "scene.xml": '<mujoco><include file="arm.xml"/></mujoco>',
        "arm.xml": "<mujoco/>",
        "part.xml": "<mujocoinclude/>",
        "tests/arm.xml": "<mujoco/>",
        "setup.xml": "<package/>",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert [file.name for file in files(tmp_path)] == ["scene.xml"]


def test_a_robot_stands_on_its_lowest_sites_and_works_with_another_end():
    spec = mujoco.MjSpec.from_file(str(MODELS / "quadruped.xml"))
    feet = ("front_left", "front_right", "rear_left", "rear_right")
    model = spec.compile()
    assert task_frame(model, mujoco.MjData(model)) == ("trunk", feet)
    arm = spec.body("trunk").add_body(name="arm", pos=[0, 0, 0.3], mass=1, inertia=[1, 1, 1])
    arm.add_joint(name="shoulder")
    arm.add_body(name="hand", pos=[0.3, 0, 0])
    spec.add_actuator(name="m", target="shoulder", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    model = spec.compile()
    assert task_frame(model, mujoco.MjData(model)) == ("hand", feet)


def test_the_task_of_an_arm_is_the_end_of_its_longest_driven_chain():
    """The flag has as many driven joints but is nearer; the pendulum is not driven."""
    model, data = of_text(
        '<mujoco><worldbody><body name="upper"><joint name="j1"/><geom size="0.1"/>'
        '<body name="lower" pos="0 0 1"><joint name="j2"/><geom size="0.1"/>'
        '<body name="flag" pos="0.1 0 0"/><body name="tool" pos="0.5 0 0"/></body>'
        '<body name="pendulum" pos="9 0 0"><joint axis="1 0 0"/><joint axis="0 1 0"/>'
        '<geom size="0.1"/><body name="rod"><body name="bob"/></body></body></body></worldbody>'
        '<actuator><position joint="j1"/><position joint="j2"/></actuator></mujoco>'
    )
    assert task_frame(model, data) == ("tool", ())


def test_a_wrong_jacobian_is_detected_by_differences_and_a_wrong_rate_by_power():
    model, data = of_text(MESHED)
    data.qpos[:] = [0.4, -0.7]
    mujoco.mj_forward(model, data)
    good, body = jacobians(model, data, Body("lower")), model.body("lower").id
    assert difference_error(model, data, good, body) < 1e-8
    assert power_error(model, data, good, body) < 1e-12
    data.qpos[0] = 1.0
    bad = jacobians(model, data, Body("lower"))
    data.qpos[0] = 0.4
    mujoco.mj_forward(model, data)
    assert difference_error(model, data, bad, body) > 0.1
    assert power_error(model, data, bad, body) > 0.01


def test_results_become_lines_of_a_csv_file_and_totals():
    """The robots are one that completed both runs and one that was refused."""
    numbers = {"measured": [3.0, 4.0], "predicted": [5.0, 0.0], "uncompared": None, "leaves": None}
    numbers |= {"of_path": 0.05, "wrong": ["motor1 is locked"], "named_after_ms": 80}
    done: dict = {"package": "dm-control", "name": "arm", "stage": None, "load": {"actuators": 2}}
    done |= {"rig": {"rows": [3, 4], "warnings": []}, "healthy": numbers, "lock": numbers}
    rejected = {"package": "dm-control", "name": "hand", "stage": "rig", "refused": "no task"}
    result = totals([done, rejected])
    assert [result[key] for key in ("models", "completed", "refused")] == [2, 1, 1]
    for key in ("healthy_wrong", "healthy_close", "lock_close", "lock_named"):
        assert (result[f"{key}_count"], result[f"{key}_cases"]) == (1, 1)
        assert np.isclose(result[f"{key}_low"], 0.025) and result[f"{key}_high"] == 1.0
    assert result["jacobians_models"] == 0 and result["healthy_off_without_warning"] == 0
    rows = list(csv.DictReader(io.StringIO(table([done, rejected]))))
    assert [row["outcome"] for row in rows] == ["completed", "refused"]
    assert rows[0]["measured_over_predicted"] == "1.00" and rows[1]["message"] == "rig: no task"
    published = (Path(__file__).parents[2] / "docs/data/robots.csv").read_text()
    assert published.splitlines()[0] == ",".join(COLUMNS)
