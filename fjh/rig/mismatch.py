"""How far a plant is from its controller's model: sizes written down beforehand, and samples."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import mujoco
import numpy as np

import argument_checks as check
from fjh.rig.draw import Draw, Family
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
"""Smallest and largest accepted size."""


@dataclass(frozen=True)
class Mismatch:
    """Sizes of all differences between plant and model; zero is none.

    Relative ones are half widths of uniform distributions, drawn anew for each flight. Those that a
    robot does not have are refused: a file tells nothing of a floor, a hysteresis, or springs that
    are preloaded anew.

    Attributes:
        gain: Of each actuator's force: of a servo's feedback, too.
        stiffness: Of each suspension spring and each flexure spring of the hexapod.
        damping: Of each joint's damper, and of each servo's; of each suspension of the hexapod.
        inertia: Of the mass, and apart from it of the inertia, of each body.
        delay_ticks: Control ticks by which each command comes late; not drawn.
        floor_um_per_s: RMS velocity of the hexapod's floor in each third octave from 8 to 80 Hz;
            not drawn.
        drift_urad_per_s: Half width of the rate at which the hexapod's detector's zero moves in
            (alpha, beta), in a direction that is drawn.
        gain_drift_per_s: Half width of the relative rate at which each coil's gain changes.
        hysteresis: Part of the suspensions' stiffness that slips, as a Maxwell-slip chain
            (:class:`sim.plant.MaxwellSlip`); not drawn, but for where its elements slip.
        timestep_s: Of the physics; None is the model's.
        drift_per_s: Half width of the rate at which each sensor's zero moves, in standard
            deviations of one sample, of robots but the hexapod.
        steps: Physics steps for each of the model's, of robots but the hexapod; not drawn.
        family: Of the relative sizes that are drawn of a machine's parts, "lognormal" with the
            standard deviation of the uniform distribution.

    Raises:
        ValueError: A size is no number or outside its `LIMITS`, or no such physics step.
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
        """All sizes times a factor, the delay rounded.

        A physics step has no size: it stays, but for a factor of zero, which is :data:`EXACT`.

        Raises:
            ValueError: The factor is negative, or takes a size beyond its `LIMITS`.
        """
        check_within("factor", factor, 0.0, 1e6)
        sizes = {name: factor * getattr(self, name) for name in LIMITS}
        sizes["delay_ticks"] = round(sizes["delay_ticks"])
        if not factor:
            return EXACT
        return replace(self, **sizes)


EXACT = Mismatch()
"""The plant is the model."""

Known = Literal["exact", "all"]
"""A plant that is the controller's model, or one that differs by all that is drawn."""


def sizes_of(mismatch: Known | Mismatch, everything: Mismatch, unknown: Sequence[str]) -> Mismatch:
    """The sizes that are asked for, of a robot that does not have some.

    Args:
        mismatch: By name, or themselves.
        everything: What "all" stands for.
        unknown: Names of sizes that the robot does not have.

    Raises:
        WrongInput: Neither a name nor sizes; or one that the robot does not have.
    """
    named = {"exact": EXACT, "all": everything}
    sizes = named.get(mismatch) if isinstance(mismatch, str) else mismatch
    if not isinstance(sizes, Mismatch):
        raise WrongInput(
            f'mismatch must be "exact", "all" or a Mismatch, got {check.short_repr(mismatch)}'
        )
    for name in unknown:
        if getattr(sizes, name) != getattr(EXACT, name):
            raise WrongInput(f"this robot has no mismatch of {name}, got {getattr(sizes, name)}")
    return sizes


def without(sizes: Sequence[str]) -> tuple[str, ...]:
    """Names of all sizes but these and the family: what a robot with these does not have."""
    return tuple(each.name for each in fields(Mismatch) if each.name not in (*sizes, "family"))


def sampled_model(
    model: mujoco.MjModel,
    drives: Sequence[Drive],
    sizes: Mismatch,
    draw: Draw,
    damped: Array | None = None,
) -> tuple[mujoco.MjModel, Array]:
    """A copy of a model whose gains, dampers and inertias differ, and the gains (n,).

    Each size has a stream of its own: the same seed gives the same value of one, whatever the
    others are.

    Args:
        model: Of the controller.
        drives: Its actuators; all outputs of one have the same gain.
        sizes: How far they may be off.
        draw: Random numbers.
        damped: Joints whose dampers differ; None is all.
    """
    model = copy.copy(model)
    gains = draw.factors("gain", len(drives), sizes.gain)
    servos = draw.factors("servo", len(drives), sizes.damping)
    for drive, gain, servo in zip(drives, gains, servos, strict=True):
        ids = list(drive.ids)
        model.actuator_gainprm[ids, :3] *= gain
        model.actuator_biasprm[ids, :3] *= gain
        model.actuator_biasprm[ids, 2] *= servo
    joints = np.arange(model.njnt) if damped is None else damped
    factors = np.ones(model.njnt)
    factors[joints] = draw.factors("damping", len(joints), sizes.damping)
    model.dof_damping[:] *= factors[model.dof_jntid]
    if sizes.inertia:
        model.body_mass[:] *= draw.factors("mass", model.nbody, sizes.inertia)
        model.body_inertia[:] *= draw.factors("inertia", model.nbody, sizes.inertia)[:, None]
        mujoco.mj_setConst(model, mujoco.MjData(model))  # what follows from them
    model.opt.timestep /= sizes.steps
    return model, gains
