"""Mismatch of a hexapod: general sizes, and springs, hysteresis, drifts and floor."""

from dataclasses import dataclass

import mujoco
import numpy as np

from fjh.rig.mismatch import Mismatch, sampled_model
from fjh.rig.random_streams import RandomStreams
from sim import Array, ModelError, Plant
from sim.mjcf import drives
from sim.plant import MaxwellSlip

ALL = Mismatch(
    gain=0.03,
    stiffness=0.03,
    damping=0.2,
    inertia=0.02,
    delay_ticks=1,
    floor_um_per_s=12.5,
    drift_urad_per_s=0.01,
    gain_drift_per_s=1e-4,
    hysteresis=0.01,
    timestep_s=2.5e-4,
)
"""Mismatch of all kinds at once, with a floor at vibration criterion VC-C.

With 1 % of the stiffness slipping, the loss factor of a suspension is at most 0.01 / pi = 0.3 %, as
for metal springs in clamps; the flexures of `fjh.xml` have 1 %. The physics step is twice the
model's, which doubles MuJoCo's errors of frequency and damping.
"""

SIZES = (
    *("gain", "stiffness", "damping", "inertia", "delay_ticks", "floor_um_per_s"),
    *("drift_urad_per_s", "gain_drift_per_s", "hysteresis", "timestep_s"),
)
"""Sizes that apply to the hexapod."""

ALL_SIZES = {name: getattr(ALL, name) for name in SIZES}
"""Sizes of :data:`ALL`, ready for JSON."""

ALONE: dict[str, Mismatch] = {name: Mismatch(**{name: size}) for name, size in ALL_SIZES.items()}
"""Mismatches with a single size of :data:`ALL` each."""

SAMPLED = ("gain", "stiffness", "damping", "inertia")
"""Sizes that are sampled for each part; `ftc.fdi.uncertainty.TYPICAL` has the diagnosis's prior."""

SLIP_M = (0.3e-6, 30e-6)
"""Range of the stretch [m] at which a hysteresis element slips, sampled log-uniformly: from less
than the dither of 0.5 um to more than the struts move on the spiral."""

ELEMENTS = 4
"""Number of equally stiff elements in the hysteresis of each suspension."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences between a hexapod's plant and its controllers' model; by default none.

    Attributes:
        model: Model of the plant: springs, dampers, inertias, gains of the coils, physics step;
            None is the controllers' model.
        hysteresis: Hysteresis parallel to the suspension springs, or None.
        gain_drift_per_s: Relative drift rate of each coil's gain from the start of a run.
        delay_ticks: Delay of commands in control ticks.
        floor_m_per_s: RMS velocity of the floor in each third octave.
        floor_seed: Seed of the floor's phases.
        drift_rad_per_s: Drift rate of the detector's zero in (alpha, beta) from the start of a run.
    """

    model: mujoco.MjModel | None = None
    hysteresis: MaxwellSlip | None = None
    gain_drift_per_s: tuple[float, ...] = (0.0,) * 6
    delay_ticks: int = 0
    floor_m_per_s: float = 0.0
    floor_seed: tuple[int, ...] = (0,)
    drift_rad_per_s: tuple[float, ...] = (0.0, 0.0)


def sampled_differences(nominal: mujoco.MjModel, sizes: Mismatch, seed: int) -> Differences:
    """Return the sampled differences of a machine from its controllers' model.

    A seed determines plant and drift for any controller and duration, and the floor for runs of one
    length. Each size has its own random stream, so that its samples do not depend on other sizes.
    The suspensions are preloaded again, as at commissioning, so that the payload rests at the
    nominal pose.

    Raises:
        sim.ModelError: The struts are not driven by coils against springs.
    """
    if not has_suspensions(nominal):
        raise ModelError("a mismatch needs struts with suspension springs, got one without")
    streams = RandomStreams(seed, sizes.family)
    model, _ = sampled_model(nominal, drives(nominal), sizes, streams, damped=_suspensions(nominal))
    hysteresis = _set_springs(model, sizes, streams)
    if sizes.timestep_s is not None:
        model.opt.timestep = sizes.timestep_s
    if sizes.stiffness or sizes.inertia or sizes.hysteresis:
        missing = Plant(model, start=mujoco.MjData(model)).coil_force_n()
        joints = _suspensions(model)
        model.qpos_spring[model.jnt_qposadr[joints]] += missing / model.jnt_stiffness[joints]
    direction, rate = streams.uniform("drift", 2)
    speed = 1e-6 * sizes.drift_urad_per_s * rate
    drift = speed * np.cos(np.pi * direction), speed * np.sin(np.pi * direction)
    gain_drift = sizes.gain_drift_per_s * streams.uniform("gain_drift", model.nu)
    return Differences(
        model,
        hysteresis=hysteresis,
        gain_drift_per_s=tuple(gain_drift.tolist()),
        delay_ticks=sizes.delay_ticks,
        floor_m_per_s=1e-6 * sizes.floor_um_per_s,
        floor_seed=streams.seed("floor"),
        drift_rad_per_s=tuple(map(float, drift)),
    )


def has_suspensions(model: mujoco.MjModel) -> bool:
    """Return True if each coil acts against a spring, as a mismatch requires."""
    return bool(model.jnt_stiffness[_suspensions(model)].all())


def _suspensions(model: mujoco.MjModel) -> Array:
    return model.actuator_trnid[:, 0]


def _set_springs(
    model: mujoco.MjModel, sizes: Mismatch, streams: RandomStreams
) -> MaxwellSlip | None:
    """Sample all springs; replace part of the suspensions' stiffness by elements that slip."""
    model.jnt_stiffness[:] *= streams.factors("stiffness", model.njnt, sizes.stiffness)
    if not sizes.hysteresis:
        return None
    joints, shape = _suspensions(model), (model.nu, ELEMENTS)
    stiffness = model.jnt_stiffness[joints]
    low, high = np.log(SLIP_M)
    at = 0.5 + 0.5 * streams.uniform("hysteresis", model.nu * ELEMENTS).reshape(shape)
    model.jnt_stiffness[joints] -= sizes.hysteresis * stiffness
    element_stiffness = np.outer(sizes.hysteresis * stiffness, np.full(ELEMENTS, 1 / ELEMENTS))
    return MaxwellSlip(stiffness=element_stiffness, slip=np.exp(low + at * (high - low)))
