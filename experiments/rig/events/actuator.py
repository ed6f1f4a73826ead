"""What happens to one actuator, and to all that one supply feeds."""

import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from experiments.rig.events.target import Effect, Target
from sim import Array, Drive
from sim.plant.actuators import switch_off, take_spring


def nothing(_: Target) -> Effect:
    """Beside the failures that the event consists of."""
    return Effect()


def over(target: Target, part: float) -> Effect:
    """A part of the full input, at one end or the other."""
    constant = target.input(part * target.full[target.rng.integers(2)])
    return _own_input(target, lambda _, __: constant)


def offset(target: Target, reaches: float, reaches_per_s: float) -> Effect:
    """A displacement is added that may grow, in what the path moves, with a drawn sign."""
    sign = float(target.rng.choice([-1.0, 1.0]))
    per_reach = sign * target.input(target.reach)
    grows = reaches_per_s * target.rig.period_s
    return _own_input(target, lambda tick, own: own + per_reach * (reaches + grows * tick))


def reversed_input(target: Target) -> Effect:
    """The input changes its sign."""
    return _own_input(target, lambda _, own: -own)


def lagging(target: Target, time_constant_s: float) -> Effect:
    """The input passes a first-order lag; of an infinite time constant it stays as it is."""
    follows, state = -math.expm1(-target.rig.period_s / time_constant_s), 0.0

    def lagged(tick: int, own: float) -> float:
        nonlocal state
        state = own if tick == 0 else state + follows * (own - state)
        return state

    return _own_input(target, lagged)


def without_force(
    target: Target, works: Callable[[float], bool], *, everywhere: bool = False
) -> Effect:
    """No force at times [s] since the event at which an actuator, or all of them, does not work."""
    switches = [_Switch(each) for each in (target.drives if everywhere else [target.drive])]

    def plant(tick: int, model: mujoco.MjModel, _: mujoco.MjData) -> None:
        for each in switches:
            each.set(model, is_on=works(tick * target.rig.period_s))

    return Effect(plant)


def fading(target: Target, time_constant_s: float) -> Effect:
    """The force decays exponentially."""
    part = math.exp(-target.rig.period_s / time_constant_s)
    return Effect(lambda _, model, __: _scale_force(model, target.drive, part))


def strong(target: Target, gain: float) -> Effect:
    """The force is that many times as high."""
    return _once(lambda model: _scale_force(model, target.drive, gain))


def spring_lost(target: Target) -> Effect:
    """The own spring of the actuator, and with it its preload, is gone.

    Raises:
        WrongInput: It has none.
    """
    stiffness, k = _of_drive(target, target.rig.model, "stiffness")
    if stiffness[k] == 0.0:
        raise target.refused("has no spring of its own")
    return _once(lambda model: take_spring(model, target.drive))


def rubbing(target: Target, part: float) -> Effect:
    """Dry friction of this part of the force that the path takes against spring and servo.

    Raises:
        WrongInput: The actuator moves neither a joint nor a tendon.
    """
    _of_drive(target, target.rig.model, "frictionloss")

    def rub(model: mujoco.MjModel) -> None:
        stiffness, k = _of_drive(target, model, "stiffness")
        friction, at = _of_drive(target, model, "frictionloss")
        holds = stiffness[k] + _feedback(model, target.drive, 1)
        friction[at] += part * target.reach * holds

    return _once(rub)


def damped(target: Target, times: float) -> Effect:
    """Its damping, the servo's included, is that many times as high.

    Raises:
        WrongInput: The actuator moves neither a joint nor a tendon.
    """
    _of_drive(target, target.rig.model, "damping")

    def damp(model: mujoco.MjModel) -> None:
        damping, k = _of_drive(target, model, "damping")
        damping[k] = times * damping[k] + (times - 1.0) * _feedback(model, target.drive, 2)

    return _once(damp)


def released(target: Target, after_s: float) -> Effect:
    """A lock that the event brings opens again.

    Raises:
        WrongInput: The actuator has no lock.
    """
    lock, opens = target.lock, target.ticks(after_s)

    def plant(tick: int, _: mujoco.MjModel, data: mujoco.MjData) -> None:
        if tick == opens:
            data.eq_active[lock] = False

    return Effect(plant)


def sag(_: Target, part: float) -> Effect:
    """All inputs are this part of what is sent."""
    return Effect(sent=lambda _, inputs: part * inputs)


def ripple(target: Target, part: float, frequency_hz: float) -> Effect:
    """All inputs rise and fall by this part; at most at a quarter of the control rate."""
    omega = 2 * math.pi * min(frequency_hz * target.rig.period_s, 0.25)
    return Effect(sent=lambda tick, inputs: (1.0 + part * math.sin(omega * tick)) * inputs)


def _own_input(target: Target, change: Callable[[int, float], float]) -> Effect:
    """The input of the event's own actuator is another one, within the range of its drive."""
    k, ends = target.actuator, target.rig.task.limits
    low, high = (target.input(float(end[k])) if np.isfinite(end[k]) else end[k] for end in ends)

    def sent(tick: int, inputs: Array) -> Array:
        changed = np.array(inputs, dtype=float)
        changed[k] = min(max(change(tick, float(changed[k])), low), high)
        return changed

    return Effect(sent=sent)


def _once(change: Callable[[mujoco.MjModel], None]) -> Effect:
    """A change of the plant's model that stays."""

    def plant(tick: int, model: mujoco.MjModel, _: mujoco.MjData) -> None:
        if tick == 0:
            change(model)

    return Effect(plant)


class _Switch:
    """Takes the force of a drive away and gives it back; what is off already stays off."""

    def __init__(self, drive: Drive) -> None:
        self._drive, self._groups = drive, None

    def set(self, model: mujoco.MjModel, *, is_on: bool) -> None:
        ids: Sequence[int] = list(self._drive.ids)
        if not is_on and self._groups is None:
            self._groups = model.actuator_group[ids].copy()
            switch_off(model, self._drive)
        elif is_on and self._groups is not None:
            model.actuator_group[ids], self._groups = self._groups, None


def _scale_force(model: mujoco.MjModel, drive: Drive, factor: float) -> None:
    """As :meth:`sim.Plant.weaken`, with any factor."""
    ids = list(drive.ids)
    model.actuator_gainprm[ids, :3] *= factor
    model.actuator_biasprm[ids, :3] *= factor


def _feedback(model: mujoco.MjModel, drive: Drive, order: int) -> float:
    """Force of the servos of a drive per displacement (order 1) or velocity (2) of it."""
    gains = model.actuator_biasprm[list(drive.ids), order]
    return -float(np.square(drive.gear) @ gains)


def _of_drive(target: Target, model: mujoco.MjModel, what: str) -> tuple[Array, int]:
    """The array of all joints or tendons, and the place in it of what the event's actuator moves.

    Raises:
        WrongInput: It moves neither.
    """
    joint, tendon = target.drive.joint, target.drive.tendon
    if joint is not None and what == "stiffness":
        return model.jnt_stiffness, joint
    if joint is not None:
        return getattr(model, f"dof_{what}"), int(model.jnt_dofadr[joint])
    if tendon is not None:
        return getattr(model, f"tendon_{what}"), tendon
    raise target.refused("moves neither a joint nor a tendon")
