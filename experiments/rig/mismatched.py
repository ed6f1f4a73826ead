"""Plants of any MJCF file that differ from their controller's model, by sizes stated beforehand."""

import copy

import mujoco

from experiments.rig.mismatch import Mismatch
from experiments.study.draw import Draw
from sim import Array, Plant, Pose, Reading, Sensors

ALL = Mismatch(gain=0.03, damping=0.2, inertia=0.02, delay_ticks=1, drift_per_s=0.1, steps=2)
"""Everything at once: gains, dampers, inertias and delay as of the hexapod's testbed."""


def mismatched_model(
    model: mujoco.MjModel, plant: Plant, mismatch: Mismatch, seed: int
) -> tuple[mujoco.MjModel, Array]:
    """A model so drawn, and the gains (n,) of its actuators.

    The same seed gives the same model, whoever controls it. Each size has a stream of its own.

    Args:
        model: Of the controller.
        plant: Made of it, whose drives are drawn: all actuators of one have the same gain.
        mismatch: Sizes.
        seed: Of all that is drawn.
    """
    draw, model = Draw(seed, mismatch.family), copy.copy(model)
    gains = draw.factors("gain", len(plant.drives), mismatch.gain)
    damping = draw.factors("servo", len(plant.drives), mismatch.damping)
    for drive, gain, damped in zip(plant.drives, gains, damping, strict=True):
        ids = list(drive.ids)
        model.actuator_gainprm[ids, :3] *= gain
        model.actuator_biasprm[ids, :3] *= gain
        model.actuator_biasprm[ids, 2] *= damped
    joints = draw.factors("damping", model.njnt, mismatch.damping)
    model.dof_damping[:] *= joints[model.dof_jntid]
    if mismatch.inertia:
        model.body_mass[:] *= draw.factors("mass", model.nbody, mismatch.inertia)
        model.body_inertia[:] *= draw.factors("inertia", model.nbody, mismatch.inertia)[:, None]
        mujoco.mj_setConst(model, mujoco.MjData(model))  # what follows from them
    model.opt.timestep /= mismatch.steps
    return model, gains


def displaced(known: Plant, plant: Plant, gains: Array) -> Array:
    """What a plant takes a command for that was made for the known one, per command, shape (n,).

    A plant is commanded by displacements, and balances its own gains and springs; the controls of a
    robot are made by the model that its controller has. At the start both stand still: a robot is
    held there before a flight.
    """
    return gains * known.stiffness / plant.stiffness


class DriftingSensors:
    """Sensors whose zeros move at constant rates from the first reading on."""

    def __init__(self, sensors: Sensors, of_task: Array, of_encoders: Array) -> None:
        """Take the sensors, and how far each zero moves in a tick, (m1,) and (n,)."""
        self._sensors, self._rates, self._ticks = sensors, (of_task, of_encoders), 0

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """What they read, their zeros where they are by now."""
        of_task, of_encoders = (rate * self._ticks for rate in self._rates)
        self._ticks += 1
        reading = self._sensors.read(pose, displacements + of_encoders)
        return reading._replace(output=reading.output + of_task)
