"""Declarations of the named events, each by a decorator of the function of its effect.

Neither `sim` nor SciPy is imported, so that the command line rejects misspelt events at once.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from fjh.study.input_checks import nearest

if TYPE_CHECKING:
    from fjh.rig.events.hooks import Target
    from sim import Array
    from sim.plant import FailureKind

Of = Literal["actuator", "supply", "machine", "sensor"]
Cause = Literal["offset", "supply", "scale"]

LATEST_S = 1e9
"""Latest time of an event [s]: later ones would have no tick."""
GRAVITY = 9.81
"""Acceleration of gravity [m/s^2] for the weights in effects, also for models without gravity."""
FULL = 20.0
"""Full displacement of an actuator without limits, as a multiple of the path's amplitude."""
_LOCKED: "tuple[FailureKind, ...]" = ("locked",)
_UNMOVED: "tuple[FailureKind, ...]" = ("free", "locked")
"""Diagnoses of an actuator that follows no input: free under a spring, locked under a servo."""


class Effect(NamedTuple):
    """Functions that change plant, measurements or inputs at each tick, counted from the onset.

    Attributes:
        plant: Function called before the physics; adds forces to `data.xfrc_applied`.
        measured: Function from the measured major rows (m1,) to those that the controller receives.
        sent: Function from the inputs (n,) of the controller to those that the drives receive.
    """

    plant: Callable[[int, mujoco.MjModel, mujoco.MjData], None] | None = None
    measured: "Callable[[int, Array], Array] | None" = None
    sent: "Callable[[int, Array], Array] | None" = None


@dataclass(frozen=True)
class Kind:
    """Declaration of a named event.

    Attributes:
        sentence: Description of the effect, with sizes.
        of: Part that it affects: an actuator (given in the event), the supply, machine or sensors.
        correct_kinds: Kinds of failure in a correct diagnosis of its actuators; empty: none.
        failures: Kinds of `sim.Failure` that the event includes: of its own actuator, or else of as
            many random actuators.
        after_s: Time from the event to these failures [s].
        cause: Correct diagnosis other than a failure; None: there is none.
        effect: Function that returns its further effect on a target.
    """

    sentence: str
    of: Of
    correct_kinds: "tuple[FailureKind, ...]"
    failures: "tuple[FailureKind, ...]"
    after_s: float
    cause: Cause | None
    effect: "Callable[[Target], Effect]"


EVENTS: dict[str, Kind] = {}
"""Named events, in the order of studies and pages."""


@dataclass(frozen=True)
class Event:
    """Named event at a time: a change of actuators, supply, payload, floor or sensors.

    Attributes:
        name: Name of the event, such as "bump", "hard_over" or "hum"; `EVENTS` has all.
        time_s: Onset [s]; an event at the first tick of a run starts with its lead-in.
        actuator: Number or name of the actuator, for events that act on one actuator; else None.

    Raises:
        ValueError, TypeError: There is no such event; the actuator is missing, superfluous or
            invalid; the time is not from 0 to 1e9 s.
    """

    name: str
    time_s: float
    actuator: int | str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise TypeError(f"name must be the name of an event, got {check.short_repr(self.name)}")
        if self.name not in EVENTS:
            raise ValueError(
                f'there is no event "{self.name:.80}"{nearest(self.name, EVENTS, listed=True)}'
            )
        is_time = isinstance(self.time_s, Real) and not isinstance(self.time_s, bool)
        if not (is_time and 0.0 <= self.time_s <= LATEST_S):
            got = check.short_repr(self.time_s)
            raise ValueError(f"time_s must be a time from 0 to {LATEST_S:g} s, got {got}")
        is_number = isinstance(self.actuator, Integral) and not isinstance(self.actuator, bool)
        if not (isinstance(self.actuator, str | None) or (is_number and self.actuator >= 0)):
            requirement = f"a name, or a number from 0 on, got {check.short_repr(self.actuator)}"
            raise ValueError(f"actuator must be {requirement}")
        if self.kind.of == "actuator" and self.actuator is None:
            raise ValueError(f"actuator of {self.name} must be given: it acts on one actuator")
        if self.kind.of != "actuator" and self.actuator is not None:
            raise ValueError(
                f"actuator of {self.name} must be None, got {check.short_repr(self.actuator)}"
            )

    @classmethod
    def parse(cls, text: str) -> "Event":
        """Return the event of a text, NAME@SECONDS or NAME:ACTUATOR@SECONDS.

        Raises:
            ValueError, TypeError: The text has another form, or the event is invalid.
        """
        if not isinstance(text, str):
            raise TypeError(f"text must be a str, got {check.short_repr(text)}")
        what, _, time_s = text.rpartition("@")
        name, _, actuator = what.partition(":")
        try:
            seconds = float(time_s)
        except ValueError:
            expected = "NAME@SECONDS or NAME:ACTUATOR@SECONDS"
            raise ValueError(f"text must be {expected}, got {check.short_repr(text)}") from None
        return cls(name, seconds, actuator or None)

    @property
    def kind(self) -> Kind:
        """Declaration of the event in `EVENTS`."""
        return EVENTS[self.name]


def event(
    of: Of,
    name: str,
    sentence: str,
    correct_kinds: "tuple[FailureKind, ...]" = (),
    failures: "tuple[FailureKind, ...]" = (),
    *,
    after_s: float = 0.0,
    cause: Cause | None = None,
    **sizes: Any,
) -> Callable[[Callable[..., Effect]], Callable[..., Effect]]:
    """Return a decorator that declares an event by the function of its effect.

    The arguments are those of :class:`Kind`; `sizes` are passed to the function after the target.
    The function raises WrongInput if the event does not apply to the target. The lowest of several
    decorators declares its event first.
    """

    def declare(effect: Callable[..., Effect]) -> Callable[..., Effect]:
        bound = partial(effect, **sizes)
        EVENTS[name] = Kind(sentence, of, correct_kinds, failures, after_s, cause, bound)
        return effect

    return declare


actuator_event = partial(event, "actuator")
supply_event = partial(event, "supply")
machine_event = partial(event, "machine")
sensor_event = partial(event, "sensor")


@actuator_event("loose", "the actuator loses force and spring", ("loose", "free"), ("loose",))
@actuator_event("weak", "the actuator keeps half of its force", ("weak",), ("weak",))
@actuator_event("free", "the actuator loses its force", ("free",), ("free",))
@actuator_event("locked", "the actuator locks where it is", _LOCKED, _LOCKED)
def no_effect(_: "Target") -> Effect:
    """Return no effect besides the failures of the event."""
    return Effect()


@actuator_event("spring_lost", "the actuator loses its spring alone", ("loose", "free"))
def lost_spring(target: "Target") -> Effect:
    """Remove the actuator's own spring and its preload."""
    stiffness = target.moved("stiffness")
    if stiffness(target.rig.model) == 0.0:
        raise target.unsupported("has no spring of its own")
    return _once(lambda model: stiffness(model).fill(0.0))


@actuator_event("half_over", "half of the full input from then on", _UNMOVED, part=0.5)
@actuator_event("hard_over", "full input from then on, in a random direction", _UNMOVED, part=1.0)
def constant_input(target: "Target", part: float) -> Effect:
    """Set the input to a fraction of full input, in a random direction."""
    end = target.limits[target.rng.integers(2)]
    full = end if math.isfinite(end) else math.copysign(FULL * target.amplitude, end)
    constant = target.input(part * full)
    return _own_input(target, lambda _, __: constant)


@actuator_event("stuck_input", "the input freezes", _UNMOVED, lag_s=math.inf)
def lagging(target: "Target", lag_s: float) -> Effect:
    """Pass the input through a first-order lag [s]; an infinite lag freezes the input."""
    follows, state = -math.expm1(-target.rig.period_s / lag_s), 0.0

    def lagged(tick: int, own: float) -> float:
        nonlocal state
        state = own if tick == 0 else state + follows * (own - state)
        return state

    return _own_input(target, lagged)


@actuator_event(
    "drift", "an offset grows per second by 0.6 of the path's motion", cause="offset", rate=0.6
)
@actuator_event(
    "offset", "an offset of three times the motion on the path", cause="offset", size=3.0
)
def offset_input(target: "Target", size: float = 0.0, rate: float = 0.0) -> Effect:
    """Add a displacement and a ramp per second of random sign, in amplitudes of the path."""
    per_amplitude = float(target.rng.choice([-1.0, 1.0])) * target.input(target.amplitude)
    grows = rate * target.rig.period_s
    return _own_input(target, lambda tick, own: own + per_amplitude * (size + grows * tick))


@actuator_event(
    "intermittent", "no force for 100 ms in every 300 ms", ("free", "weak"), off_s=0.1, every_s=0.3
)
def no_force(
    target: "Target", off_s: float, every_s: float = math.inf, *, everywhere: bool = False
) -> Effect:
    """Switch off the actuator, or all, for `off_s`, once or at the start of every period."""
    drives = target.drives if everywhere else [target.drive]
    ids, groups = [k for drive in drives for k in drive.ids], None

    def plant(tick: int, model: mujoco.MjModel, _: mujoco.MjData) -> None:
        nonlocal groups
        is_on = (tick * target.rig.period_s + 1e-9) % every_s >= off_s
        if not is_on and groups is None:
            groups = model.actuator_group[ids]
            for drive in drives:
                target.switch_off(model, drive)
        elif is_on and groups is not None:  # actuators that were off before stay off
            model.actuator_group[ids], groups = groups, None

    return Effect(plant)


@actuator_event("fading", "the force decays by 63 % per second", ("weak", "free"), decay_s=1.0)
def scaled_force(target: "Target", gain: float = 1.0, decay_s: float = math.inf) -> Effect:
    """Multiply the actuator's force by a gain that decays exponentially."""
    ids, decays = list(target.drive.ids), math.exp(-target.rig.period_s / decay_s)

    def plant(tick: int, model: mujoco.MjModel, _: mujoco.MjData) -> None:
        factor = decays if tick else gain * decays
        model.actuator_gainprm[ids, :3] *= factor
        model.actuator_biasprm[ids, :3] *= factor

    return Effect(plant)


@actuator_event("reversed", "the input changes its sign", ("free", "locked", "weak"))
def reversed_input(target: "Target") -> Effect:
    """Change the sign of the input."""
    return _own_input(target, lambda _, own: -own)


actuator_event("slow", "a first-order lag of 30 ms in the input", ("weak", "locked"), lag_s=0.03)(
    lagging
)
actuator_event("strong", "the actuator gives 1.3 times its force", gain=1.3)(scaled_force)


@actuator_event("lock_released", "a lock that opens after 100 ms", _LOCKED, _LOCKED, opens_s=0.1)
def released_lock(target: "Target", opens_s: float) -> Effect:
    """Open the lock that the event closes, `opens_s` after onset."""
    lock, opens = target.lock, target.ticks(opens_s)
    if lock < 0:
        raise target.unsupported("has no lock")

    def plant(tick: int, _: mujoco.MjModel, data: mujoco.MjData) -> None:
        if tick == opens:
            data.eq_active[lock] = False

    return Effect(plant)


actuator_event("free_returns", "no force for 0.5 s, then full force", ("free",), off_s=0.5)(
    no_force
)


@actuator_event(
    "rubbing", "dry friction: half of the force that the path needs", ("locked", "weak"), part=0.5
)
def dry_friction(target: "Target", part: float) -> Effect:
    """Add dry friction, as a fraction of the force of spring and servo on the path."""
    stiffness, friction = target.moved("stiffness"), target.moved("frictionloss")

    def add_friction(model: mujoco.MjModel) -> None:
        holds = stiffness(model) + _feedback(target, model, 1)
        friction(model)[:] += part * target.amplitude * holds

    return _once(add_friction)


@actuator_event("damped", "ten times the damping", ("weak", "locked"), times=10.0)
def damped(target: "Target", times: float) -> Effect:
    """Multiply the actuator's damping, including the servo's."""
    damping = target.moved("damping")

    def damp(model: mujoco.MjModel) -> None:
        damping(model)[:] = times * damping(model) + (times - 1.0) * _feedback(target, model, 2)

    return _once(damp)


@supply_event("ripple", "all inputs vary by 20 % at 100 Hz", ripple=0.2)
@supply_event("sag", "all inputs are multiplied by 0.8", cause="supply", mean=0.8)
def supply(target: "Target", mean: float = 1.0, ripple: float = 0.0, hz: float = 100.0) -> Effect:
    """Multiply all inputs by a mean with a ripple, of at most a quarter of the control rate."""
    omega = 2 * math.pi * min(hz * target.rig.period_s, 0.25)
    return Effect(sent=lambda tick, inputs: (mean + ripple * math.sin(omega * tick)) * inputs)


supply_event("two_locked", "two random actuators lock at once", _LOCKED, 2 * _LOCKED)(no_effect)
supply_event("blackout", "no actuator has force for 50 ms", off_s=0.05, everywhere=True)(no_force)


@actuator_event(
    "bump_then_lock",
    "a bump; 0.4 s later the actuator locks",
    _LOCKED,
    _LOCKED,
    after_s=0.4,
    parts=5,
    for_s=5e-3,
)
@machine_event(
    "bump", "5/54 of the payload's weight for 5 ms, 5 N on the hexapod", parts=5, for_s=5e-3
)
@machine_event(
    "push", "a constant force of 1/54 of the payload's weight, 1 N on the hexapod", parts=1
)
def pushed(target: "Target", parts: float, for_s: float = math.inf) -> Effect:
    """Push the payload at its centre of mass in a random direction, with parts / 54 of its weight.

    A push of finite duration has the same impulse for any control period.
    """
    body, ends = target.rig.payload_body, target.ticks(for_s)
    newton = parts / 54 * GRAVITY * float(target.rig.model.body_mass[body])
    force = newton * target.direction(3)
    if math.isfinite(ends):
        force *= for_s / (ends * target.rig.period_s)

    def plant(tick: int, _: mujoco.MjModel, data: mujoco.MjData) -> None:
        if tick < ends:
            data.xfrc_applied[body, :3] += force

    return Effect(plant)


@machine_event("tone", "the floor vibrates at 20 Hz, 100 um/s RMS", hz=20.0, rms_m_per_s=1e-4)
def swinging_floor(target: "Target", hz: float, rms_m_per_s: float) -> Effect:
    """Let the floor oscillate along a random direction."""
    omega = 2 * math.pi * hz
    peak, step = math.sqrt(2.0) * rms_m_per_s * omega, omega * target.rig.period_s
    return _on_floor(target.direction(3), lambda tick: peak * math.sin(step * tick))


@machine_event("tilt", "the floor tilts by 1 mrad/s", rad_per_s=1e-3)
def tilting_floor(target: "Target", rad_per_s: float) -> Effect:
    """Tilt the floor steadily about a random horizontal axis, through small angles."""
    across, grows = [*target.direction(2), 0.0], GRAVITY * rad_per_s * target.rig.period_s
    return _on_floor(across, lambda tick: grows * tick)


@machine_event("lighter", "the payload gets 20 % less mass and inertia", factor=0.8)
@machine_event("heavier", "the payload gets 20 % more mass and inertia", factor=1.2)
def scaled_mass(target: "Target", factor: float) -> Effect:
    """Multiply mass and inertia of the payload."""
    body = target.rig.payload_body

    def scale(model: mujoco.MjModel) -> None:
        model.body_mass[body] *= factor
        model.body_inertia[body] *= factor
        mujoco.mj_setConst(model, mujoco.MjData(model))  # constants derived from masses

    return _once(scale)


@sensor_event("bias", "the zero jumps by 20 standard deviations", sigmas=20.0)
def biased(target: "Target", sigmas: float, samples: float = math.inf) -> Effect:
    """Add a constant of `sigmas` deviations in a random direction to the first `samples`."""
    off = sigmas * target.rig.noise * target.direction(len(target.rig.major))
    return Effect(measured=lambda tick, output: output + off if tick < samples else output)


@sensor_event("scale", "readings are 1.2 times the true values", cause="scale", factor=1.2)
def scaled(_: "Target", factor: float) -> Effect:
    """Multiply the measurement by a factor."""
    return Effect(measured=lambda _, output: factor * output)


@sensor_event("all_stuck", "all rows of readings freeze", part=1.0)
@sensor_event("stuck", "one row of readings freezes", part=1.0, one_row=True)
def repeated(target: "Target", part: float, *, one_row: bool = False) -> Effect:
    """Repeat the last measurement of all rows, or of a random one, in a fraction of the samples."""
    uniform, m1 = target.rng.random, len(target.rig.major)
    rows, last = target.rng.integers(m1) if one_row else slice(None), np.empty(m1)

    def measured(tick: int, output: "Array") -> "Array":
        if tick == 0 or uniform() >= part:
            last[:] = output
        seen = output.copy()
        seen[rows] = last[rows]
        return seen

    return Effect(measured=measured)


sensor_event("silent", "all readings are zero", factor=0.0)(scaled)


@sensor_event("noisy", "the noise is five times as high", times=5.0)
def noisy(target: "Target", times: float) -> Effect:
    """Multiply the standard deviation of the noise by a factor."""
    added, normal = target.rig.noise * math.sqrt(times**2 - 1.0), target.rng.standard_normal
    return Effect(measured=lambda _, output: output + added * normal(len(output)))


@sensor_event("dropped", "a tenth of the samples is NaN", part=0.1)
@sensor_event("nan_for_50ms", "samples are NaN for 50 ms", duration_s=0.05)
@sensor_event("nan", "one sample is NaN", duration_s=0.0)
def missing(target: "Target", part: float = 1.0, duration_s: float = math.inf) -> Effect:
    """Replace a fraction of the samples by NaN for some time, at least one sample."""
    uniform, ends = target.rng.random, target.ticks(duration_s)

    def measured(tick: int, output: "Array") -> "Array":
        return output * np.nan if tick < ends and uniform() < part else output

    return Effect(measured=measured)


sensor_event("repeated", "a tenth of the samples repeats the previous one", part=0.1)(repeated)
sensor_event("spike", "one sample is off by a million standard deviations", sigmas=1e6, samples=1)(
    biased
)


@sensor_event("late", "samples are five ticks late", ticks=5)
def late(_: "Target", ticks: int) -> Effect:
    """Delay the samples by some ticks; the first sample is repeated until then."""
    recent = deque["Array"](maxlen=ticks + 1)

    def measured(_: int, output: "Array") -> "Array":
        recent.append(output)
        return recent[0]

    return Effect(measured=measured)


@sensor_event(
    "hum", "a sinusoid of 20 Hz and five standard deviations is added", sigmas=5.0, hz=20.0
)
def hum(target: "Target", sigmas: float, hz: float) -> Effect:
    """Add a sinusoid of `hz`, `sigmas` standard deviations, along a random direction."""
    peak = sigmas * target.rig.noise * target.direction(len(target.rig.major))
    step = 2 * math.pi * hz * target.rig.period_s
    return Effect(measured=lambda tick, output: output + peak * math.sin(step * tick))


def _own_input(target: "Target", change: Callable[[int, float], float]) -> Effect:
    """Return an effect that changes the input of the event's actuator, within the drive's range."""
    k = target.actuator
    low, high = (target.input(end) if math.isfinite(end) else end for end in target.limits)

    def sent(tick: int, inputs: "Array") -> "Array":
        changed = np.array(inputs, dtype=float)
        changed[k] = min(max(change(tick, float(changed[k])), low), high)
        return changed

    return Effect(sent=sent)


def _once(change: Callable[[mujoco.MjModel], None]) -> Effect:
    """Return an effect that changes the plant's model permanently at the first tick."""
    return Effect(lambda tick, model, _: change(model) if tick == 0 else None)


def _feedback(target: "Target", model: mujoco.MjModel, order: int) -> float:
    """Return an actuator's servo force per displacement (order 1) or velocity (order 2)."""
    gains = model.actuator_biasprm[list(target.drive.ids), order]
    return -float(np.square(target.drive.gear) @ gains)


def _on_floor(along: "Array | list[float]", acceleration: Callable[[int], float]) -> Effect:
    """Return an effect of an accelerated floor: each mass m gets the inertial force -m a."""

    def plant(tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        for axis, part in enumerate(along):
            data.xfrc_applied[:, axis] -= part * acceleration(tick) * model.body_mass

    return Effect(plant)
