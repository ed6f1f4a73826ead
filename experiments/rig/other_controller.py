"""Controllers that a user brings along."""

from typing import Any

from numpy.typing import ArrayLike

from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.controllers import controller_factory
from ftc.guarded_controller import GuardedController


def fly_with(rig: Rig, name: str, path: ArrayLike, **flight: Any) -> tuple[Run, str | None]:
    """A flight with the controller of this name, and what went wrong with it, in a sentence.

    Failures it is told only where the goal of the rig has them. `flight` is as of
    :meth:`experiments.rig.Rig.fly`.
    """
    pilot = GuardedController(name, controller_factory(name), rig.task)
    run = rig.fly(pilot, path, **flight)
    return run, run.state.failure
