"""How a hexapod may differ from its controller's model: springs, hysteresis, drifts, floor, too."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fjh.rig.draw import Draw
from fjh.rig.mismatch import Mismatch, sampled_model
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
"""Everything at once, the floor at VC-C.

With 1 % of the stiffness slipping, the loss factor of a suspension is at most 0.01 / pi = 0.3 %,
where all elements are stretched to twice their slip. That is in the range of metal springs in
clamps; the flexures of `fjh.xml` have 1 %. The physics step is twice the model's: MuJoCo's error of
frequency and damping doubles, and a flight costs half.
"""

SIZES = (
    *("gain", "stiffness", "damping", "inertia", "delay_ticks", "floor_um_per_s"),
    *("drift_urad_per_s", "gain_drift_per_s", "hysteresis", "timestep_s"),
)
"""Those of the hexapod."""

ALL_SIZES = {name: getattr(ALL, name) for name in SIZES}
"""Those of :data:`ALL`, ready for JSON."""

ALONE: dict[str, Mismatch] = {name: Mismatch(**{name: size}) for name, size in ALL_SIZES.items()}
"""Each size of :data:`ALL` by itself."""

DRAWN = ("gain", "stiffness", "damping", "inertia")
"""Those drawn of each part: where the diagnosis has a prior, too, `ftc.fdi.uncertainty.TYPICAL`."""

OTHER = replace(ALL, family="lognormal", **{name: 2 * getattr(ALL, name) for name in DRAWN})
"""Another family than the prior's: log-normal, correlated between parts, and twice as wide."""

SLIP_M = (0.3e-6, 30e-6)
"""Range of the stretch at which an element of the hysteresis slips, drawn with a uniform logarithm:
from less than the dither of a diagnosis, 0.5 um, to more than the struts move on the spiral."""

ELEMENTS = 4
"""Of the hysteresis of each suspension, equally stiff."""


@dataclass(frozen=True, eq=False)
class Differences:
    """What of a hexapod differs from the model that its controllers have; by default nothing.

    Attributes:
        model: The machine itself: springs, dampers, inertias, gains of the coils, physics step;
            None is the controllers' model.
        hysteresis: Of the suspensions, beside the springs of the model; None is none.
        gain_drift_per_s: Relative change of each coil's gain from the start of a run.
        delay_ticks: Control ticks by which commands come late.
        floor_m_per_s: RMS velocity of the floor in each third octave.
        floor_seed: Of its phases.
        drift_rad_per_s: Of the detector's zero in (alpha, beta), from the start of a run.
    """

    model: mujoco.MjModel | None = None
    hysteresis: MaxwellSlip | None = None
    gain_drift_per_s: tuple[float, ...] = (0.0,) * 6
    delay_ticks: int = 0
    floor_m_per_s: float = 0.0
    floor_seed: tuple[int, ...] = (0,)
    drift_rad_per_s: tuple[float, ...] = (0.0, 0.0)


def differing(known: mujoco.MjModel, sizes: Mismatch, seed: int) -> Differences:
    """What is drawn of a machine whose controllers have this model.

    The same seed gives the same plant and drift, whoever controls it and for how long, and the same
    floor in runs of one length. Each difference has a stream of its own: a plant drawn with one
    size alone has the values that it has with all others beside it. The suspensions are preloaded
    anew, as at commissioning: the payload rests at the nominal pose, whatever springs and weights.

    Raises:
        sim.ModelError: A machine whose struts are not driven by coils against springs.
    """
    if not has_suspensions(known):
        raise ModelError("a mismatch needs struts with suspension springs, got one without")
    draw = Draw(seed, sizes.family)
    model, _ = sampled_model(known, drives(known), sizes, draw, damped=_suspensions(known))
    hysteresis = _set_springs(model, sizes, draw)
    if sizes.timestep_s is not None:
        model.opt.timestep = sizes.timestep_s
    if sizes.stiffness or sizes.inertia or sizes.hysteresis:
        _preload(model)
    direction, rate = draw.uniform("drift", 2)
    speed = 1e-6 * sizes.drift_urad_per_s * rate
    drift = speed * np.cos(np.pi * direction), speed * np.sin(np.pi * direction)
    gain_drift = sizes.gain_drift_per_s * draw.uniform("gain_drift", model.nu)
    return Differences(
        model,
        hysteresis=hysteresis,
        gain_drift_per_s=tuple(gain_drift.tolist()),
        delay_ticks=sizes.delay_ticks,
        floor_m_per_s=1e-6 * sizes.floor_um_per_s,
        floor_seed=draw.seed("floor"),
        drift_rad_per_s=tuple(map(float, drift)),
    )


def has_suspensions(model: mujoco.MjModel) -> bool:
    """Whether a spring stands against each coil, as a mismatch needs it."""
    return bool(model.jnt_stiffness[_suspensions(model)].all())


def _suspensions(model: mujoco.MjModel) -> Array:
    """Joints of the coils, shape (6,)."""
    return model.actuator_trnid[:, 0]


def _set_springs(model: mujoco.MjModel, sizes: Mismatch, draw: Draw) -> MaxwellSlip | None:
    """Draw all springs; of the suspensions', a part becomes elements that slip."""
    model.jnt_stiffness[:] *= draw.factors("stiffness", model.njnt, sizes.stiffness)
    if not sizes.hysteresis:
        return None
    joints, shape = _suspensions(model), (model.nu, ELEMENTS)
    stiffness = model.jnt_stiffness[joints]
    low, high = np.log(SLIP_M)
    at = 0.5 + 0.5 * draw.uniform("hysteresis", model.nu * ELEMENTS).reshape(shape)
    model.jnt_stiffness[joints] -= sizes.hysteresis * stiffness
    each = np.outer(sizes.hysteresis * stiffness, np.full(ELEMENTS, 1 / ELEMENTS))
    return MaxwellSlip(stiffness=each, slip=np.exp(low + at * (high - low)))


def _preload(model: mujoco.MjModel) -> None:
    """Preload the suspensions so that the machine rests at its nominal pose without current."""
    missing = Plant(model, start=mujoco.MjData(model)).coil_force_n()
    joints = _suspensions(model)
    model.qpos_spring[model.jnt_qposadr[joints]] += missing / model.jnt_stiffness[joints]
