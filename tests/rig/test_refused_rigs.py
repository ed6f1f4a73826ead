"""What a rig refuses in a sentence, and that what the sentence advises works."""

import re
from pathlib import Path

import numpy as np
import pytest

from experiments.rig import Rig
from experiments.study.study import WrongInput

ARM = """<mujoco><option {option}/><statistic extent="1"/><worldbody><body>
  <joint name="a" axis="0 1 0"/><geom size="0.05" mass="1" pos="0 0 -0.4"/>
  <body pos="0 0 -0.4"><joint name="b" axis="0 1 0"/><geom size="0.05" mass="1" pos="0 0 -0.4"/>
    <site name="tool" pos="0 0 -0.4"/></body></body></worldbody>
  <actuator><position joint="a" kp="400" kv="{kv}"/><position joint="b" kp="400" kv="{kv}"/>
  </actuator></mujoco>"""


def rig(folder: Path, bend: float = 0.8, *, kv: float = 8, option: str = "", rows=(3, 5)) -> Rig:
    """Of two links in a plane, the second one bent."""
    file = folder / "arm.xml"
    file.write_text(ARM.format(kv=kv, option=option))
    return Rig.of_mjcf(file, site="tool", major=rows, start=[0.3, bend])


def holds(one: Rig) -> bool:
    """Whether a flight is as predicted."""
    path = one.path("circle", duration_s=0.3, turn_s=0.3)
    run = one.fly(one.controller(), path)
    predicted = one.predict(path, noise=run.measured - run.true).rms_before
    rms = np.sqrt(((run.desired - run.true) ** 2).mean(axis=0))
    return bool(np.linalg.norm(rms) == pytest.approx(np.linalg.norm(predicted), rel=0.1))


def test_servos_that_overshoot_in_a_physics_step_are_refused_with_steps_that_do_not(tmp_path):
    """Euler's step h takes h d of a speed that decays at the rate d: more than twice of it grows.

    In continuous time all is stable, so that no loop shows it.
    """
    with pytest.raises(WrongInput, match=r"overshoots in physics steps of 0\.002 s") as refused:
        rig(tmp_path, kv=300)
    found = re.search(r"steps of at most (\S+) s, or .*?\((\w+)\)", str(refused.value))
    assert found is not None
    assert holds(rig(tmp_path, kv=300, option=f'timestep="{found[1]}"'))
    assert holds(rig(tmp_path, kv=300, option=f'integrator="{found[2]}"'))


@pytest.mark.parametrize("bend", [1e-4, 5e-7])
def test_a_posture_that_is_nearly_singular_is_refused_with_the_row_to_leave_out(tmp_path, bend):
    """A straight arm moves its end across, and hardly along itself."""
    with pytest.raises(WrongInput, match="posture is nearly singular") as refused:
        rig(tmp_path, bend)
    found = re.search(r"row (\d)", str(refused.value))
    assert found is not None and found[1] == "5"
    assert holds(rig(tmp_path, bend, rows=(3,)))
    assert holds(rig(tmp_path, 0.8))
