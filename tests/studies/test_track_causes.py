"""What most of a run's error comes from: each cause is put into a run, and named."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fjh.rig import Rig, Run
from fjh.rig.reach import limited_by, predictor
from ftc.reconfiguration import Outlook
from sim import Failure
from tests.arms import ARMS

pytestmark = pytest.mark.long


def cause(rig: Rig, run: Run, told: bool = True) -> str | None:
    return limited_by(rig, run, predictor(rig, run, None)(told=told))


def said(
    folder: Path, path: str = "circle", joint: str = "", torque: float = 1.0, **options: Any
) -> str | None:
    """Of a run of a second along a path of a Panda-like arm, with so many times its torque."""
    servos = [(kp, kv, torque * most) for kp, kv, most in ARMS["panda"].servos]
    file = replace(ARMS["panda"], servos=servos).write(folder / "panda.xml", joint)
    how = {"site": "tool", "major": [3, 4, 5], "crossover": 0.13, **options}
    rig = Rig.of_mjcf(file, **how)
    return cause(rig, rig.fly(rig.controller(), rig.path(path, duration_s=1.0, turn_s=2.0)))


def test_noise_is_named_where_less_of_it_leaves_less_error(tmp_path):
    noisy = said(tmp_path, noise=1e-3)
    assert noisy == "Most of the error is from noise of the sensors, which the loops pass on."
    assert said(tmp_path, noise=1e-12) is None


def test_a_servo_that_saturates_is_named_with_the_part_of_the_time(tmp_path):
    """Steps of a tenth of a metre take more torque than it has; with more torque it does not."""
    steps: dict[str, Any] = {"path": "steps", "size": 0.1, "noise": 1e-6}
    found = said(tmp_path, **steps)
    assert found is not None
    assert re.match(r"The servo of servo\d saturates: it gives its largest force for \d+ %", found)
    assert said(tmp_path, torque=1e6, **steps) is None


def test_dry_friction_of_the_file_is_named(tmp_path):
    found = said(tmp_path, joint='frictionloss="2"', noise=1e-6)
    assert found == "Most of the error is from dry friction in the joints."


def test_a_late_diagnosis_is_named_after_a_lock_in_full_motion(tmp_path, monkeypatch):
    monkeypatch.setattr(Outlook, "goes_over", lambda *_: True)
    rig = Rig.of_mjcf(ARMS["panda"].write(tmp_path / "panda.xml"), site="tool", major=[3, 4, 5])
    path = rig.path("circle", duration_s=2.0, turn_s=2.0)
    stuck = [Failure("joint4", "locked", 1.0)]
    run = rig.fly(rig.supervisor("none"), path, failures=stuck)
    assert [each.actuator for each in run.diagnoses] == ["servo4"]
    late = "After the failure most of the error is from the time until it was diagnosed."
    assert cause(rig, run) == late
    unaware = rig.fly(rig.controller(), path, failures=stuck)
    assert cause(rig, unaware, told=False) != late
