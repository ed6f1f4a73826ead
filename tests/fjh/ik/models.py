"""Models for the tests of inverse kinematics, compiled once per process, and simulated motions."""

from collections.abc import Iterator
from functools import cache

import mujoco
import numpy as np

from fjh.ik import Ik
from sim import MODELS, Pose, TaskFunction, assemble, load_model
from tests.robots import TEST_MODELS

DT = 0.01
Tick = tuple[mujoco.MjData, np.ndarray, float]


@cache
def model_of(name: str) -> mujoco.MjModel:
    if (MODELS / f"{name}.xml").exists():
        return load_model(MODELS / f"{name}.xml")
    return mujoco.MjModel.from_xml_path(str(TEST_MODELS / f"{name}.xml"))


def random_state(model: mujoco.MjModel, seed: int, size: float = 0.3) -> mujoco.MjData:
    """Return a random state near the model's own, loops closed."""
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(scale=size, size=model.nv), 1.0)
    return assemble(model, data)


def shifted(pose: Pose, *shift: float) -> Pose:
    return Pose(pose.rotation, pose.translation_m + shift)


def run_ticks(ik: Ik, data: mujoco.MjData, ticks: int, dt: float) -> Iterator[Tick]:
    """Yield the state of each tick with its velocity and the largest change of a velocity."""
    before = data.qvel.copy()
    for _ in range(ticks):
        qvel = np.array(ik.step(data, dt))
        data = ik.advance(data, qvel, dt)
        yield data, qvel, float(np.abs(qvel - before).max())
        before = qvel


def state_after(ik: Ik, data: mujoco.MjData, ticks: int, dt: float = DT) -> mujoco.MjData:
    """Return the state after a number of ticks."""
    *_, (data, _, _) = run_ticks(ik, data, ticks, dt)
    return data


def remaining_error(task: TaskFunction, model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the largest remaining error of a task."""
    return float(np.abs(task.on(model).error(model, data)).max())
