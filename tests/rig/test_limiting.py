"""What most of a flight's error comes from: each cause is put into a flight, and named."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments.rig import Rig
from experiments.rig.limiting import limiting
from ftc.decision import Outlook
from sim import Failure
from tests.arms import ARMS


def said(
    folder: Path, path: str = "circle", joint: str = "", torque: float = 1.0, **options: Any
) -> str | None:
    """Of a flight of a second along a path of a Panda-like arm, with so many times its torque."""
    servos = [(kp, kv, torque * most) for kp, kv, most in ARMS["panda"].servos]
    file = replace(ARMS["panda"], servos=servos).write(folder / "panda.xml", joint)
    how = {"site": "tool", "major": [3, 4, 5], "crossover": 0.13, **options}
    rig = Rig.of_mjcf(file, **how)
    run = rig.fly(rig.controller(), rig.path(path, duration_s=1.0, turn_s=2.0))
    assert len(run.saturated.T) == len(rig.actuators)
    return limiting(rig, run)


@pytest.mark.long
def test_noise_is_named_where_less_of_it_leaves_less_error(tmp_path):
    noisy = said(tmp_path, noise=1e-3)
    assert noisy == "Most of the error is noise of the sensors, which the loops pass on."
    assert said(tmp_path, noise=1e-12) is None


@pytest.mark.long
def test_a_servo_that_saturates_is_named_with_the_part_of_the_time(tmp_path):
    """Steps of a tenth of a metre take more torque than it has; with more torque it does not."""
    steps: dict[str, Any] = {"path": "steps", "size": 0.1, "noise": 1e-6}
    found = said(tmp_path, **steps)
    assert found is not None
    assert re.match(r"The servo of servo\d saturates: it gives its largest force for \d+ %", found)
    assert said(tmp_path, torque=1e6, **steps) is None


@pytest.mark.long
def test_dry_friction_of_the_file_is_named(tmp_path):
    found = said(tmp_path, joint='frictionloss="2"', noise=1e-6)
    assert found == "Most of the error is from dry friction in the joints."


@pytest.mark.long
@pytest.mark.parametrize(
    ("stuck_s", "limit"),
    [
        (0.6, "what the loops, whose crossover is at 0.14 Hz, take to make up for it."),
        (1.0, "from the time until servo4 was named locked at 1.144 s."),
    ],
)
def test_after_a_lock_slow_loops_or_a_late_name_are_named(tmp_path, monkeypatch, stuck_s, limit):
    """A joint that sticks as the path sets out leaves little to make up; in full motion, much."""
    monkeypatch.setattr(Outlook, "goes_over", lambda *_: True)
    rig = Rig.of_mjcf(ARMS["panda"].write(tmp_path / "panda.xml"), site="tool", major=[3, 4, 5])
    path = rig.path("circle", duration_s=2.0, turn_s=2.0)
    stuck = [Failure("joint4", "locked", stuck_s)]
    run = rig.fly(rig.supervisor("none"), path, failures=stuck)
    assert [each.actuator for each in run.diagnoses] == ["servo4"]
    found = limiting(rig, run, stuck)
    assert found is not None and found.endswith(limit)
    unaware = rig.fly(rig.controller(), path, failures=stuck)
    found = limiting(rig, unaware, stuck)
    assert found is not None and found.endswith("that of a controller that does not know of it.")
