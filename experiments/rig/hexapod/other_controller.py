"""Controllers that a user brings along, on this machine."""

from typing import Any

import numpy as np

from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.fault_tolerance import nominal_model
from experiments.rig.hexapod.simulation import Trajectory, track_path
from experiments.rig.hexapod.testbed import Testbed
from experiments.study.controllers import controller_factory
from ftc.control_task import ControlTask
from ftc.fdi.fault_model import NominalModel
from ftc.goal import Goal
from ftc.guarded_controller import GuardedController
from sim import NOMINAL, hexapod


def control_task(testbed: Testbed, goal: Goal, nominal: NominalModel) -> ControlTask:
    """What a controller of this machine is told; failures only where the goal has them."""
    drives, bench = testbed.amplifier(), testbed.bench
    full = np.full(testbed.model.nu, 100.0)
    return ControlTask(
        nominal=nominal,
        J=np.linalg.inv(hexapod(testbed.model).posture(NOMINAL).inverse_jacobian),
        major=tuple(MAJOR),
        goal=goal,
        drives=drives,
        limits_m=(drives.displacement_m(-full), drives.displacement_m(full)),
        reference_limit=np.full(len(MAJOR), bench.spiral_radius_urad * 1e-6),
    )


def track_with(
    testbed: Testbed, name: str, goal: Goal, **run: Any
) -> tuple[Trajectory, str | None]:
    """A run with the controller of this name, and what went wrong with it, in a sentence.

    `run` are options of :func:`experiments.rig.hexapod.simulation.track_path`.
    """
    task = control_task(testbed, goal, nominal_model(testbed.model, testbed.bench))
    pilot = GuardedController(name, controller_factory(name), task)
    trajectory, state = track_path(testbed, pilot, **run)
    return trajectory, state.failure
