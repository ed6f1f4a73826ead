"""The rig that the options of a command ask for."""

from dataclasses import fields
from pathlib import Path

from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions
from experiments.rig.rig import Rig
from experiments.study.study import WrongInput


def asked_rig(model: Path | None, options: RobotOptions) -> Rig:
    """Of a robot's file; None is the hexapod, which has its own frame, loops and sensors.

    Raises:
        WrongInput: Something that the robot does not have or cannot do.
        sim.ModelError: The file, or what it says.
    """
    if model is not None:
        return robot_rig(model, options)
    for option in fields(options):
        its_own = option.name not in ("size", "feedforward")
        if its_own and getattr(options, option.name) != option.default:
            name = option.name.replace("_", "-")
            raise WrongInput(f"--{name} needs a MODEL.xml: the hexapod of the testbed has its own")
    return Rig.hexapod(size=options.size, feedforward=options.feedforward == "on")
