"""Controllers that a user brings along, on this machine."""

from typing import Any

from experiments.rig.hexapod.rig import rig_of
from experiments.rig.hexapod.simulation import Trajectory, track_path
from experiments.rig.hexapod.testbed import Testbed
from experiments.study.controllers import controller_factory
from ftc.goal import Goal
from ftc.guarded_controller import GuardedController


def track_with(
    testbed: Testbed, name: str, goal: Goal, **run: Any
) -> tuple[Trajectory, str | None]:
    """A run with the controller of this name, and what went wrong with it, in a sentence.

    Failures it is told only where the goal has them. `run` are options of
    :func:`experiments.rig.hexapod.simulation.track_path`.
    """
    pilot = GuardedController(name, controller_factory(name), rig_of(testbed, goal).task)
    trajectory, state = track_path(testbed, pilot, **run)
    return trajectory, state.failure
