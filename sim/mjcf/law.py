"""The force law of an actuator: what its control, its length and its speed do."""

from typing import NamedTuple

import mujoco

from sim.errors import ModelError
from sim.mjcf.model import name_of

_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)
_NO_BIAS, _AFFINE = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
_OTHER_GAINS = {
    int(mujoco.mjtGain.mjGAIN_AFFINE): "an actuator of variable gain",
    int(mujoco.mjtGain.mjGAIN_MUSCLE): "a muscle",
    int(mujoco.mjtGain.mjGAIN_DCMOTOR): "a motor with electric dynamics",
    int(mujoco.mjtGain.mjGAIN_PID): "a PID controller",
    int(mujoco.mjtGain.mjGAIN_SO3): "an orientation servo of three controls",
}


class Law(NamedTuple):
    """force = gain control + constant + per_length length + per_speed speed, before the gear.

    A torque motor has a gain only, a position servo a negative `per_length`.
    """

    gain: float
    constant: float = 0.0
    per_length: float = 0.0
    per_speed: float = 0.0

    @property
    def is_motor(self) -> bool:
        """Whether the force depends on the control alone."""
        return self == Law(self.gain)


def law_of(model: mujoco.MjModel, actuator: int) -> Law:
    """The force law of an actuator that has one of this form.

    Raises:
        ModelError: Another gain or feedback, gain zero, or a state of the actuator's own.
    """
    called = f'actuator "{name_of(model.actuator(actuator))}"'
    gain, bias = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
    if gain != _FIXED or bias not in (_NO_BIAS, _AFFINE):
        raise ModelError(
            f"{called} is {_OTHER_GAINS.get(gain, 'user-defined')}: only servos and motors of "
            "fixed gain and linear feedback are commanded by displacements"
        )
    if model.actuator_actnum[actuator]:
        raise ModelError(
            f"{called} has a state of its own, and a command could not be its displacement"
        )
    if not model.actuator_gainprm[actuator, 0]:
        raise ModelError(f"{called} has gain 0, so nothing commands it: take it out")
    feedback = model.actuator_biasprm[actuator, :3].tolist() if bias == _AFFINE else ()
    return Law(float(model.actuator_gainprm[actuator, 0]), *feedback)
