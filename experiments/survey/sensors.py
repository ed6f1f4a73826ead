"""Which failures of one actuator sensors tell apart, and which further sensor separates the rest.

By the steady response to a dither that the major task does not feel, at the robot's start, as
docs/diagnosis-design.md says. By the linear model alone: nothing is simulated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from experiments.rig.dither import CONDITIONS, rig_dither
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions, Sensing
from experiments.rig.rig import Rig
from experiments.rig.units import ROWS
from experiments.study.study import WrongInput
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.sensor_choice import ranked_sensors
from ftc.fdi.separation import Separations, separations
from ftc.fdi.uncertainty import CERTAIN
from sim import Array

SENSES: tuple[Sensing, ...] = ("task", "joints", "both")
MOST_ADDED = 3
"""Further sensors that are looked for."""

MOST_ACTUATORS = 12
"""With more the search of a dither takes minutes."""

_STILL = 1e-9
"""Part of the largest motion that is round-off."""
_ONE_VELOCITY = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Added:
    """One more sensor, and how many failures are told apart with it and those before it."""

    name: str
    isolable: int


@dataclass(frozen=True)
class Sensed:
    """What a set of sensors tells apart.

    Attributes:
        sense: Which sensors.
        design: The dither that is best for them, and the separations of the single failures, each
            actuator locked, free and with half its force.
        exactly: How many would be told apart with an exact model.
        added: Further sensors, each the best beside those before it; none where none helps.
    """

    sense: Sensing
    design: DitherDesign
    exactly: int
    added: tuple[Added, ...]

    @property
    def separations(self) -> Separations:
        """Of the single failures."""
        return self.design.separations


@dataclass(frozen=True)
class Sensors:
    """What sensors of a robot tell apart at its start.

    Attributes:
        actuators: Their names.
        size: Of the path by which dither and noise are sized.
        noise: Of a sample of the major rows, and of encoders of the actuators.
        sensed: With each set of sensors.
    """

    actuators: tuple[str, ...]
    size: float
    noise: tuple[float, float]
    sensed: tuple[Sensed, ...]


def sensors_of(file: Path, options: RobotOptions, at: Array | None = None) -> Sensors | str:
    """What is told apart with a sensor of the task, with encoders, and with both; or why nothing.

    Nothing is where no loop holds the task, nothing can move beside it, or its linear model has an
    undamped mode.

    Args:
        file: MJCF.
        options: Of the robot.
        at: Joint positions (nq,) to start at; None is as the options say.
    """
    try:
        rig = robot_rig(file, replace(options, sense="both"), at)
        sensed = [_sensed(rig, sense) for sense in SENSES]
    except (WrongInput, ValueError) as error:
        return str(error)
    noise = rig.noise, rig.encoder_noise
    return Sensors(rig.actuators, rig.size, noise, tuple(sensed))


def with_sensors(rig: Rig, sense: Sensing) -> Rig:
    """The same robot whose diagnosis looks at these sensors; task rows come first."""
    noise = None if sense == "task" else rig.control.encoder_noise
    return replace(rig, control=replace(rig.control, sense=sense, encoder_noise=noise))


def _sensed(rig: Rig, sense: Sensing) -> Sensed:
    looking = with_sensors(rig, sense)
    watched, design = looking.watched, rig_dither(looking, "designed")
    if design is None:
        raise ValueError("the major task leaves no motion by which failures could be told apart")
    exact = separations(watched, design.dither, replace(CONDITIONS, uncertainty=CERTAIN))
    left, added = candidates(rig, sense), []
    isolable, faults = len(design.separations.isolable()), len(design.separations.faults)
    while left and len(added) < MOST_ADDED and isolable < faults:
        best = ranked_sensors(watched, left, design.dither, CONDITIONS)[0]
        if (with_it := len(best.separations.isolable())) <= isolable:
            break
        isolable = with_it
        added.append(Added(best.name, isolable))
        row, noise = left.pop(best.name)
        watched = watched.measured(np.vstack([watched.plant.C, row]), [*watched.noise, noise])
    return Sensed(sense, design, len(exact.isolable()), tuple(added))


def candidates(rig: Rig, sense: Sensing) -> dict[str, tuple[Array, float]]:
    """Rows per state of what a further sensor may measure, and its noise, by its name.

    Encoders of the actuators, the other rows of the twist, and encoders of hinges and slides that
    nothing drives; those that the robot does not have. All are as precise as forward kinematics
    from encoders of the actuators.
    """
    linear, model = rig.machine.robot.linear, rig.machine.robot.scene.own
    assert linear.motion is not None  # that of a plant
    encoders, twist, moves = linear.C_active, linear.C_twist, linear.motion
    found = {} if sense != "task" else _named("encoder of", rig.actuators, encoders)
    for k, name in enumerate(ROWS):
        if k not in rig.major or sense == "joints":
            found[f"sensor of {name}"] = twist[k]
    driven = {drive.joint for drive in rig.machine.robot.alone.drives}
    free = [k for k in range(model.njnt) if k not in driven and model.jnt_type[k] in _ONE_VELOCITY]
    at = model.jnt_dofadr[free]
    positions = np.hstack([moves[at], np.zeros_like(moves[at])])
    found |= _named("encoder of", [linear.joints[k] for k in at], positions)
    per_encoder = np.linalg.pinv(encoders[:, : moves.shape[1]])
    moved = {k: np.abs(row[: len(per_encoder)] @ per_encoder).max() for k, row in found.items()}
    return {
        name: (row, float(rig.encoder_noise * moved[name]))
        for name, row in found.items()
        if moved[name] > _STILL * max(moved.values())
    }


def _named(kind: str, names: Sequence[str], rows: Array) -> dict[str, Array]:
    return {f"{kind} {name}": row for name, row in zip(names, rows, strict=True)}
