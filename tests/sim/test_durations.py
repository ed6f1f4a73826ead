"""No period is so long that it does not come back, and a long one can be interrupted."""

import _thread
import threading
import time

import mujoco
import numpy as np
import pytest

from sim import Bench, Plant
from sim.plant import TaskSensor

PENDULUM = mujoco.MjModel.from_xml_string("""
<mujoco><option timestep="1e-3" gravity="0 0 0"/><worldbody><body>
  <joint name="turn" type="hinge"/><geom size="0.1" mass="1"/><site name="payload"/>
</body></worldbody><equality><joint name="lock1" joint1="turn" active="false"/></equality>
<actuator><position joint="turn" kp="9" kv="1"/></actuator></mujoco>
""")
TOO_LONG = {
    "step": lambda plant: plant.step(np.zeros(1), 1e6),
    "settle": lambda plant: plant.settle(1e6),
    "bench": lambda plant: Bench(
        plant, TaskSensor([0], 0.0, 0.0, 0), time_s=np.zeros(1), period_s=1e6
    ),
}


@pytest.mark.parametrize("what", TOO_LONG)
def test_a_period_without_end_is_refused(what):
    with pytest.raises(
        ValueError, match=r"^(period_s|seconds) must be at most 1e\+07 physics steps, here 10000 s"
    ):
        TOO_LONG[what](Plant(PENDULUM, base=None))


def test_a_long_one_ends_within_a_second_of_ctrl_c():
    plant, after_s = Plant(PENDULUM, base=None), 0.2
    timer = threading.Timer(after_s, _thread.interrupt_main)
    began_s = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        plant.settle(9e3)  # some 10 s of computing
    assert time.monotonic() - began_s < after_s + 1.0
    assert 0.0 < plant.data.time < 9e3


def test_a_period_in_parts_is_the_same_to_the_last_bit(model):
    """More physics steps than are taken between two looks for Ctrl-C."""
    once, often = Plant(model), Plant(model)
    command, period_s = np.full(6, 1e-5), 7 * 100 * model.opt.timestep
    once.step(command, period_s)
    for _ in range(7):
        often.step(command, 100 * model.opt.timestep)
    np.testing.assert_array_equal(once.data.qpos, often.data.qpos)
