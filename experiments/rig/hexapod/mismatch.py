"""Plants that differ from their controller's model, by sizes written down beforehand."""

import copy
from dataclasses import replace

import mujoco
import numpy as np

from experiments.rig.hexapod.inexact import InexactPlant
from experiments.rig.hexapod.testbed import Testbed
from experiments.rig.mismatch import Mismatch
from experiments.study.draw import Draw
from sim import Array, MaxwellSlip, ModelError, Plant

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


def mismatched(testbed: Testbed, mismatch: Mismatch, seed: int) -> Testbed:
    """The testbed with a plant so drawn; its controllers keep the nominal model.

    The same seed gives the same plant and drift, whoever controls it and for how long, and the same
    floor in runs of one length. Each difference has a stream of its own: a plant drawn with one
    size alone has the values that it has with all others beside it. The suspensions are preloaded
    anew, as at commissioning: the payload rests at the nominal pose, whatever springs and weights.

    Raises:
        sim.ModelError: A machine whose struts are not driven by coils against springs.
    """
    if not has_suspensions(testbed.model):
        raise ModelError("a mismatch needs struts with suspension springs, got one without")
    draw = Draw(seed, mismatch.family)
    model = copy.copy(testbed.model)
    hysteresis = _set_springs(model, mismatch, draw)
    model.actuator_gainprm[:, 0] *= draw.factors("gain", model.nu, mismatch.gain)
    model.dof_damping[model.jnt_dofadr[_suspensions(model)]] *= draw.factors(
        "damping", model.nu, mismatch.damping
    )
    if mismatch.inertia:
        _set_inertia(model, mismatch.inertia, draw)
    if mismatch.timestep_s is not None:
        model.opt.timestep = mismatch.timestep_s
    if mismatch.stiffness or mismatch.inertia or mismatch.hysteresis:
        _preload(model)
    direction, rate = draw.uniform("drift", 2)
    speed = 1e-6 * mismatch.drift_urad_per_s * rate
    drift = speed * np.cos(np.pi * direction), speed * np.sin(np.pi * direction)
    gain_drift = mismatch.gain_drift_per_s * draw.uniform("gain_drift", model.nu)
    return replace(
        testbed,
        inexact=InexactPlant(
            model,
            hysteresis=hysteresis,
            gain_drift_per_s=tuple(gain_drift.tolist()),
            delay_ticks=mismatch.delay_ticks,
            floor_m_per_s=1e-6 * mismatch.floor_um_per_s,
            floor_seed=draw.seed("floor"),
            drift_rad_per_s=tuple(map(float, drift)),
        ),
    )


def has_suspensions(model: mujoco.MjModel) -> bool:
    """Whether a spring stands against each coil, as a mismatch needs it."""
    return bool(model.jnt_stiffness[_suspensions(model)].all())


def _suspensions(model: mujoco.MjModel) -> Array:
    """Joints of the coils, shape (6,)."""
    return model.actuator_trnid[:, 0]


def _set_springs(model: mujoco.MjModel, mismatch: Mismatch, draw: Draw) -> MaxwellSlip | None:
    """Draw all springs; of the suspensions', a part becomes elements that slip."""
    model.jnt_stiffness[:] *= draw.factors("stiffness", model.njnt, mismatch.stiffness)
    if not mismatch.hysteresis:
        return None
    joints, shape = _suspensions(model), (model.nu, ELEMENTS)
    stiffness = model.jnt_stiffness[joints]
    low, high = np.log(SLIP_M)
    at = 0.5 + 0.5 * draw.uniform("hysteresis", model.nu * ELEMENTS).reshape(shape)
    model.jnt_stiffness[joints] -= mismatch.hysteresis * stiffness
    each = np.outer(mismatch.hysteresis * stiffness, np.full(ELEMENTS, 1 / ELEMENTS))
    return MaxwellSlip(stiffness=each, slip=np.exp(low + at * (high - low)))


def _set_inertia(model: mujoco.MjModel, half_width: float, draw: Draw) -> None:
    """Draw the mass of each body, and apart from it the size of its inertia."""
    model.body_mass[:] *= draw.factors("mass", model.nbody, half_width)
    model.body_inertia[:] *= draw.factors("inertia", model.nbody, half_width)[:, None]
    mujoco.mj_setConst(model, mujoco.MjData(model))  # what follows from them


def _preload(model: mujoco.MjModel) -> None:
    """Preload the suspensions so that the machine rests at its nominal pose without current."""
    missing = Plant(model, start=mujoco.MjData(model)).coil_force_n()
    joints = _suspensions(model)
    model.qpos_spring[model.jnt_qposadr[joints]] += missing / model.jnt_stiffness[joints]
