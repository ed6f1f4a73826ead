"""Names of what can happen to a machine; apart, so that a command's check imports no physics."""

from dataclasses import dataclass
from numbers import Integral, Real
from typing import Literal

from experiments.study.spelling import nearest
from sim import FailureKind

Of = Literal["actuator", "supply", "machine", "sensor"]
"""What an event is of; those of an actuator name it."""


@dataclass(frozen=True)
class Kind:
    """One kind of event.

    Attributes:
        sentence: What happens, with sizes.
        of: Of an actuator, a supply, the machine or its sensors.
        named_as: What its actuators may rightly be taken for; empty: no actuator may be named.
        cause: What a diagnosis can say of it that is no failure; None: it has no name for it.
        failures: Of actuators, as of `sim.Failure`, that the event consists of or brings: of
            its own actuator, or of as many others, drawn.
        after_s: How long after the event these strike.
    """

    sentence: str
    of: Of
    named_as: tuple[FailureKind, ...] = ()
    failures: tuple[FailureKind, ...] = ()
    after_s: float = 0.0
    cause: Literal["offset", "supply", "scale"] | None = None


_UNMOVED: tuple[FailureKind, ...] = ("free", "locked")
"""What obeys no input: free where a spring takes the load, locked where a servo does."""
_LOCKED: tuple[FailureKind, ...] = ("locked",)

EVENTS: dict[str, Kind] = {
    "locked": Kind("the actuator stays where it is", "actuator", _LOCKED, _LOCKED),
    "free": Kind("the actuator loses its force", "actuator", ("free",), ("free",)),
    "weak": Kind("the actuator keeps half of its force", "actuator", ("weak",), ("weak",)),
    "loose": Kind("force and own spring are lost", "actuator", ("loose", "free"), ("loose",)),
    "spring_lost": Kind("the own spring is lost, not the force", "actuator", ("loose", "free")),
    "hard_over": Kind("full input from then on, at a drawn end", "actuator", _UNMOVED),
    "half_over": Kind("half of the full input from then on", "actuator", _UNMOVED),
    "stuck_input": Kind("the input stays as it is", "actuator", _UNMOVED),
    "offset": Kind("an offset of three times what the path moves", "actuator", cause="offset"),
    "drift": Kind("an offset grows in 1 s by 0.6 of the path's motion", "actuator", cause="offset"),
    "intermittent": Kind("no force for 100 ms in every 300 ms", "actuator", ("free", "weak")),
    "fading": Kind("the force decays, time constant 1 s", "actuator", ("weak", "free")),
    "reversed": Kind("the input changes its sign", "actuator", ("free", "locked", "weak")),
    "slow": Kind("the input lags by a first order of 30 ms", "actuator", ("weak", "locked")),
    "strong": Kind("the actuator gives 1.3 times its force", "actuator"),
    "lock_released": Kind("locks, moves again after 100 ms", "actuator", _LOCKED, _LOCKED),
    "free_returns": Kind("no force for 0.5 s, then all again", "actuator", ("free",)),
    "rubbing": Kind("dry friction: half of what the path takes", "actuator", ("locked", "weak")),
    "damped": Kind("its damping is ten times as high", "actuator", ("weak", "locked")),
    "sag": Kind("all inputs times 0.8", "supply", cause="supply"),
    "ripple": Kind("all inputs rise and fall by 20 % at 100 Hz", "supply"),
    "two_locked": Kind("two actuators lock at once, drawn", "supply", _LOCKED, 2 * _LOCKED),
    "blackout": Kind("no actuator has force for 50 ms", "supply"),
    "push": Kind("a constant force of 1/54 of the payload's weight, 1 N on the hexapod", "machine"),
    "bump": Kind("5/54 of the payload's weight for 5 ms, 5 N on the hexapod", "machine"),
    "bump_then_lock": Kind("the same; 0.4 s later a lock", "actuator", _LOCKED, _LOCKED, 0.4),
    "tone": Kind("the floor swings at 20 Hz, 100 um/s RMS", "machine"),
    "tilt": Kind("the floor tilts by 1 mrad/s", "machine"),
    "heavier": Kind("the payload gets 20 % more mass and inertia", "machine"),
    "lighter": Kind("the payload gets 20 % less mass and inertia", "machine"),
    "bias": Kind("the zero jumps by 20 standard deviations", "sensor"),
    "scale": Kind("1.2 of the truth is read", "sensor", cause="scale"),
    "stuck": Kind("one row stays as it is", "sensor"),
    "all_stuck": Kind("all rows stay as they are", "sensor"),
    "silent": Kind("zeros are read", "sensor"),
    "noisy": Kind("the noise is five times as high", "sensor"),
    "nan": Kind("one sample is NaN", "sensor"),
    "nan_for_50ms": Kind("samples are NaN for 50 ms", "sensor"),
    "dropped": Kind("a tenth of the samples is NaN", "sensor"),
    "repeated": Kind("a tenth of the samples repeats the one before", "sensor"),
    "spike": Kind("one sample is off by a million standard deviations", "sensor"),
    "late": Kind("samples come five ticks late", "sensor"),
    "hum": Kind("a sinusoid of 20 Hz and five standard deviations is added", "sensor"),
}  # fmt: skip
"""Every event that has a name; sensors are those of the major rows."""


LATEST_S = 1e9
"""Of an event: later ones would have no tick."""


@dataclass(frozen=True)
class Event:
    """Something happens to a machine at one time.

    Attributes:
        name: One of `EVENTS`.
        time_s: When; what happens at the first tick of a flight has begun before it.
        actuator: By number or name, where the event is of one; else None.

    Raises:
        ValueError, TypeError: No such event; an actuator is missing, superfluous or no name or
            number; a time that is none, or negative.
    """

    name: str
    time_s: float
    actuator: int | str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise TypeError(f"name must be the name of an event, got {self.name!r:.80}")
        if self.name not in EVENTS:
            raise ValueError(
                f'there is no event "{self.name:.80}"{nearest(self.name, EVENTS, listed=True)}'
            )
        is_time = isinstance(self.time_s, Real) and not isinstance(self.time_s, bool)
        if not (is_time and 0.0 <= self.time_s <= LATEST_S):
            said = f"a time from zero on, got {self.time_s!r:.80}, and at most {LATEST_S:g} s"
            raise ValueError(f"time_s must be {said}")
        is_number = isinstance(self.actuator, Integral) and not isinstance(self.actuator, bool)
        if not (isinstance(self.actuator, str | None) or (is_number and self.actuator >= 0)):
            said = f"a name, or a number from 0 on, got {self.actuator!r:.80}"
            raise ValueError(f"actuator must be {said}")
        if self.kind.of == "actuator" and self.actuator is None:
            raise ValueError(f"{self.name} is of an actuator, which must be named")
        if self.kind.of != "actuator" and self.actuator is not None:
            raise ValueError(f"{self.name} is of no single actuator, got {self.actuator}")

    @classmethod
    def parse(cls, text: str) -> "Event":
        """Parse NAME@SECONDS or, of what happens to an actuator, NAME:ACTUATOR@SECONDS.

        Raises:
            ValueError, TypeError: Another form; or as of an event that is made.
        """
        if not isinstance(text, str):
            raise TypeError(f"text must be that of an event, got {text!r:.80}")
        what, _, time_s = text.rpartition("@")
        name, _, actuator = what.partition(":")
        try:
            seconds = float(time_s)
        except ValueError:
            said = f"NAME@SECONDS or NAME:ACTUATOR@SECONDS, got {text!r:.80}"
            raise ValueError(f"text must be {said}") from None
        return cls(name, seconds, actuator or None)

    @property
    def kind(self) -> Kind:
        """What `EVENTS` says of it."""
        return EVENTS[self.name]
