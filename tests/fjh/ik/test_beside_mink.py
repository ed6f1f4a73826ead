"""Mink as an oracle: docs/coming-from-mink.md says where its answers differ."""

import mink
import mujoco
import numpy as np

from fjh.ik import Ik, Limits
from sim import CenterOfMass, CenterOfMassTask, FrameTask, TaskFunction, pose_of
from tests.fjh.ik.models import DT, model_of, shifted


def test_where_all_tasks_can_be_met_at_once_both_give_the_same_velocity():
    """Feet, a hand and the centre of mass of a humanoid: nothing conflicts, costs are idle."""
    model = model_of("humanoid")
    data = mujoco.MjData(model)
    targets = {name: pose_of(model, data, name) for name in ("left_foot", "right_foot")}
    targets["right_hand"] = shifted(pose_of(model, data, "right_hand"), 0.02, -0.01, 0.03)
    com = pose_of(model, data, CenterOfMass()).translation_m + 0.004
    center = mink.ComTask(cost=1.0)
    center.set_target(com)
    theirs: list[mink.Task] = [center]
    ours: list[TaskFunction] = [CenterOfMassTask(target=com)]
    for name, target in targets.items():
        task = mink.FrameTask(name, "site", position_cost=1.0, orientation_cost=1.0)
        task.set_target(mink.SE3.from_matrix(target.matrix()))
        theirs.append(task)
        ours.append(FrameTask(name, target=target))
    configuration = mink.Configuration(model, data.qpos)
    v = mink.solve_ik(configuration, theirs, dt=DT, solver="daqp", limits=[], damping=1e-12)
    ik = Ik(model, [ours], Limits(ranges=False), active=["root"])
    np.testing.assert_allclose(ik.step(data, DT), v, atol=2e-3 * np.abs(v).max())
