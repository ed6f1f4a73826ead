"""Names are refused by the file alone, as the compiled model would."""

from dataclasses import replace
from typing import get_args

import mujoco
import pytest

from experiments.rig.choices import Failing
from experiments.rig.options import RobotOptions
from experiments.rig.spelling import actuators, check_names
from experiments.study.study import WrongInput
from sim import FailureKind, load_model
from sim.mjcf.drive import names_of
from sim.mjcf.transmission import drives
from tests.sim.test_drives import CROSSED


def test_the_names_in_a_file_are_those_of_its_actuators_compiled_or_not(tmp_path):
    file = tmp_path / "crossed.xml"
    file.write_text(CROSSED)
    stated = {name for names in actuators(file) for name in names}
    assert stated == {"a", "b", "c", "push", "pull", "rope", "wire", "number 5"}
    file.write_text("no MJCF")
    assert actuators(file) == ()
    check_names(file, RobotOptions())  # compiling it says what is wrong


def test_the_hexapods_names_are_those_of_its_file():
    compiled = names_of(drives(load_model()))
    assert {frozenset(names) for names in actuators(None)} == {*map(frozenset, compiled)}


def test_the_commands_kinds_of_failure_are_those_of_the_physics():
    assert set(get_args(Failing)) == set(get_args(FailureKind))


INCLUDED = """<mujoco><worldbody><include file="arm.xml"/>
  <replicate count="2" offset="1 0 0" sep="_">
    <body name="pillar"><geom size="1"/></body></replicate>
</worldbody></mujoco>"""
ARM = """<mujocoinclude><body name="arm"><joint name="hip"/><geom size="0.1"/>
  <site name="tool"/></body></mujocoinclude>"""


@pytest.mark.parametrize("site", ["tool", "arm", "pillar_1", "3"])
def test_frames_that_the_compiled_model_has_are_let_pass(tmp_path, site):
    """Of included files and repeated bodies, too."""
    file = tmp_path / "whole.xml"
    file.write_text(INCLUDED)
    (tmp_path / "arm.xml").write_text(ARM)
    model = mujoco.MjModel.from_xml_path(str(file))
    assert site == "3" or mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "arm") > 0
    check_names(file, RobotOptions(site=site))
    for wrong in ({"site": "tol"}, {"axes": "tol"}, {"keyframe": "home"}, {"pinned": "tol:point"}):
        with pytest.raises(WrongInput, match=r"tol.*did you mean \"tool\"|keyframe.*has none"):
            check_names(file, replace(RobotOptions(site=site), **wrong))


def test_a_default_that_nobody_typed_is_called_the_default(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(f"<mujoco><worldbody>{ARM[15:-16]}</worldbody></mujoco>")
    with pytest.raises(WrongInput, match=r"^the default --site payload: the model has no site or"):
        check_names(file, RobotOptions())
    with pytest.raises(WrongInput, match=r"^--site tol: "):
        check_names(file, RobotOptions(site="tol"))
