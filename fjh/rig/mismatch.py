"""Mismatch between a plant and its controller's model: sizes, and sampling of plants."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import mujoco
import numpy as np

import argument_checks as check
from fjh.rig.random_streams import Family, RandomStreams
from fjh.rig.within import check_within
from fjh.study.errors import WrongInput
from sim import Array
from sim.mjcf import Drive

LIMITS: dict[str, tuple[float, float]] = {
    "gain": (0.0, 0.9),
    "stiffness": (0.0, 0.9),
    "damping": (0.0, 0.99),
    "inertia": (0.0, 0.9),
    "delay_ticks": (0, 1000),
    "floor_um_per_s": (0.0, 1e6),
    "drift_urad_per_s": (0.0, 1e6),
    "gain_drift_per_s": (0.0, 1e-2),
    "hysteresis": (0.0, 0.9),
    "drift_per_s": (0.0, 1e6),
}
"""Smallest and largest accepted value of each size, in its unit."""


@dataclass(frozen=True)
class Mismatch:
    """Sizes of the differences between a plant and its controller's model; by default none.

    Relative sizes are half widths of uniform distributions; a seed determines the sampled plant.
    Sizes that do not apply to a robot are rejected: floor, drifts of coils and detector, stiffness,
    hysteresis and physics step apply to the hexapod only.

    Attributes:
        gain: Force of each actuator, and feedback of each servo.
        stiffness: Stiffness of each suspension spring and each flexure spring of the hexapod.
        damping: Damping of each joint and each servo; of each suspension of the hexapod.
        inertia: Mass, and independently inertia, of each body.
        delay_ticks: Delay of each command in control ticks; not sampled.
        floor_um_per_s: RMS velocity of the hexapod's floor in each third octave from 8 to 80 Hz;
            not sampled.
        drift_urad_per_s: Half width of the drift rate of the zero of the hexapod's detector in
            (alpha, beta), in a sampled direction.
        gain_drift_per_s: Half width of the relative drift rate of each coil's gain.
        hysteresis: Fraction of the suspensions' stiffness that slips, as a Maxwell-slip chain
            (:class:`sim.plant.MaxwellSlip`); only the slips of its elements are sampled.
        timestep_s: Physics step; None is the model's.
        drift_per_s: Half width of the drift rate of each sensor's zero, in standard deviations of
            one sample, for robots other than the hexapod.
        steps: Physics steps for each of the model's, for robots other than the hexapod; not
            sampled.
        family: Distribution of the sampled relative sizes; "lognormal" has the standard deviation
            of the uniform distribution.

    Raises:
        ValueError: A size is no number or outside its `LIMITS`, or the physics step is out of
            range.
    """

    gain: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    inertia: float = 0.0
    delay_ticks: int = 0
    floor_um_per_s: float = 0.0
    drift_urad_per_s: float = 0.0
    gain_drift_per_s: float = 0.0
    hysteresis: float = 0.0
    timestep_s: float | None = None
    drift_per_s: float = 0.0
    steps: int = 1
    family: Family = "uniform"

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            check_within(name, getattr(self, name), low, high)
        check_within("steps", self.steps, 1, 1000)
        check.choice("family", self.family, get_args(Family))
        if self.timestep_s is not None:
            check_within("timestep_s", self.timestep_s, 1e-6, 1e-2)

    def scaled(self, factor: float) -> "Mismatch":
        """Return a mismatch with all sizes times a factor, the delay rounded to whole ticks.

        The physics step is not scaled, except for a factor of zero, which gives :data:`EXACT`.

        Raises:
            ValueError: The factor is negative, or a scaled size is outside its `LIMITS`.
        """
        check_within("factor", factor, 0.0, 1e6)
        sizes = {name: factor * getattr(self, name) for name in LIMITS}
        sizes["delay_ticks"] = round(sizes["delay_ticks"])
        if not factor:
            return EXACT
        return replace(self, **sizes)


EXACT = Mismatch()
"""Mismatch of zero: the plant equals the model."""

Known = Literal["exact", "all"]
"""Names of mismatches: none, or all that apply to a robot."""


def sizes_of(mismatch: Known | Mismatch, everything: Mismatch, unknown: Sequence[str]) -> Mismatch:
    """Return the mismatch with a name, or the given one, if it applies to a robot.

    Args:
        mismatch: Name, or sizes.
        everything: Sizes that "all" stands for.
        unknown: Names of sizes that do not apply to the robot.

    Raises:
        WrongInput: The name is unknown, or a size does not apply to the robot.
    """
    by_name = {"exact": EXACT, "all": everything}
    sizes = by_name.get(mismatch) if isinstance(mismatch, str) else mismatch
    if not isinstance(sizes, Mismatch):
        raise WrongInput(
            f'mismatch must be "exact", "all" or a Mismatch, got {check.short_repr(mismatch)}'
        )
    for name in unknown:
        if getattr(sizes, name) != getattr(EXACT, name):
            raise WrongInput(f"{name} does not apply to this robot, got {getattr(sizes, name)}")
    return sizes


def without(sizes: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all sizes except these and the family: those that do not apply."""
    return tuple(field.name for field in fields(Mismatch) if field.name not in (*sizes, "family"))


def sampled_model(
    model: mujoco.MjModel,
    drives: Sequence[Drive],
    sizes: Mismatch,
    streams: RandomStreams,
    damped: Array | None = None,
) -> tuple[mujoco.MjModel, Array]:
    """Return a copy of a model with sampled gains, dampers, inertias; and its gain factors (n,).

    Each size has its own random stream: the same seed gives the same samples of one size for any
    values of the others.

    Args:
        model: Model of the controller.
        drives: Its actuators; all outputs of one have the same gain.
        sizes: Sizes of the mismatch.
        streams: Random streams.
        damped: Joints whose damping differs; None is all.
    """
    model = copy.copy(model)
    gains = streams.factors("gain", len(drives), sizes.gain)
    servos = streams.factors("servo", len(drives), sizes.damping)
    for drive, gain, servo in zip(drives, gains, servos, strict=True):
        ids = list(drive.ids)
        model.actuator_gainprm[ids, :3] *= gain
        model.actuator_biasprm[ids, :3] *= gain
        model.actuator_biasprm[ids, 2] *= servo
    joints = np.arange(model.njnt) if damped is None else damped
    factors = np.ones(model.njnt)
    factors[joints] = streams.factors("damping", len(joints), sizes.damping)
    model.dof_damping[:] *= factors[model.dof_jntid]
    if sizes.inertia:
        model.body_mass[:] *= streams.factors("mass", model.nbody, sizes.inertia)
        model.body_inertia[:] *= streams.factors("inertia", model.nbody, sizes.inertia)[:, None]
        mujoco.mj_setConst(model, mujoco.MjData(model))  # constants derived from masses
    model.opt.timestep /= sizes.steps
    return model, gains
