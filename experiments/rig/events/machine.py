"""What happens to payload and floor."""

import math
from collections.abc import Callable

import mujoco

from experiments.rig.events.target import Effect, Target
from sim import Array

_G = 9.81
"""Weights are those on earth, also in a model without gravity, [m]/[s^2]."""


def pushed(target: Target, weights: float, duration_s: float = math.inf) -> Effect:
    """A force on the payload in a drawn direction, in its weight; at its centre of mass.

    One of some time has the same impulse whatever the control period is.
    """
    body = target.rig.payload_body
    newton = weights * _G * float(target.rig.model.body_mass[body])
    force = newton * target.direction(3)
    ends = math.inf
    if math.isfinite(duration_s):
        ends = target.ticks(duration_s)
        force *= duration_s / (ends * target.rig.period_s)

    def plant(tick: int, _: mujoco.MjModel, data: mujoco.MjData) -> None:
        if tick < ends:
            data.xfrc_applied[body, :3] += force

    return Effect(plant)


def tone(target: Target, frequency_hz: float, rms_m_per_s: float) -> Effect:
    """The floor swings along a drawn direction."""
    omega = 2 * math.pi * frequency_hz
    peak, step = math.sqrt(2.0) * rms_m_per_s * omega, omega * target.rig.period_s
    return _on_floor(target.direction(3), lambda tick: peak * math.sin(step * tick))


def tilt(target: Target, rad_per_s: float) -> Effect:
    """The floor tilts steadily about a drawn horizontal axis, through small angles."""
    across, grows = [*target.direction(2), 0.0], _G * rad_per_s * target.rig.period_s
    return _on_floor(across, lambda tick: grows * tick)


def heavier(target: Target, factor: float) -> Effect:
    """Mass and inertia of the payload are that many times as large."""
    body = target.rig.payload_body

    def plant(tick: int, model: mujoco.MjModel, _: mujoco.MjData) -> None:
        if tick == 0:
            model.body_mass[body] *= factor
            model.body_inertia[body] *= factor
            mujoco.mj_setConst(model, mujoco.MjData(model))  # what follows from them

    return Effect(plant)


def _on_floor(along: Array | list[float], acceleration: Callable[[int], float]) -> Effect:
    """Seen from a floor that accelerates by a, every mass m feels -m a."""

    def plant(tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        for axis, part in enumerate(along):
            data.xfrc_applied[:, axis] -= part * acceleration(tick) * model.body_mass

    return Effect(plant)
