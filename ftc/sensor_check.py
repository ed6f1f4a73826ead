"""Whether a reading is usable: numbers within range that change from tick to tick.

Limit checking (Isermann, Fault-Diagnosis Systems, 2006, chapter 7), and a test of the noise: a
sensor that has some hardly ever reads the same twice, bit by bit. One that does has repeated its
last reading, which a loop can use once more, or is stuck. A sensor that is biased, has another
scale or more noise passes all of this: it cannot be seen from itself. The offsets that the
diagnosis tracks take up a bias, and the loop follows it. Where there are encoders, too, they would
show it as a difference from the task; that is not tested here.
"""

from dataclasses import dataclass, replace
from math import hypot, nan
from operator import eq
from typing import Any

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc._records import changed

_FEWEST = 5
"""Ticks that a row repeats before it counts as stuck, at least."""


@dataclass(frozen=True)
class SensorState:
    """What is known of a sensor after a tick.

    Attributes:
        last: Its latest reading of numbers, one a row; NaN before the first.
        sent: Inputs of the drives before that reading, shape (n,); None before the first.
        repeats: Of each row, ticks since it last changed while the commands did.
        ticks: So far.
        gap_ticks: Without a usable reading, up to now; 0: this one is usable.
        lost: Whether the gap is longer than a short one, or a row is stuck.
        since: The tick at which the present gap, or the last one, began.
        cause: What was wrong with the latest reading that was not usable.
        missing: Readings so far that were no numbers, of another shape, or beyond range.
        repeated: Readings so far that repeated all rows, or one that is stuck.
        held_ticks: Ticks so far without a usable reading.
        losses: Times so far that the sensor was lost.
    """

    last: tuple[float, ...]
    sent: Array | None
    repeats: tuple[int, ...]
    ticks: int = 0
    gap_ticks: int = 0
    lost: bool = False
    since: int = 0
    cause: str = ""
    missing: int = 0
    repeated: int = 0
    held_ticks: int = 0
    losses: int = 0

    @property
    def usable(self) -> bool:
        """Whether the latest reading is."""
        return not self.gap_ticks

    @property
    def new(self) -> bool:
        """Whether it also says something new, and no row repeats the reading before."""
        return not self.gap_ticks and not any(self.repeats)

    def sentence(
        self,
        period_s: float,
        name: str = "the task's sensor",
        instead: str = "the commands are held",
    ) -> str:
        """What the sensor does, and what is done `instead` of using it."""
        counts = ((self.missing, "missing"), (self.repeated, "repeated"))
        bad = ", ".join(f"{count} {what}" for count, what in counts if count)
        if self.usable:
            past = f" again ({bad}; lost {self.losses} times)" if self.losses else f" ({bad})"
            return f"{name} is usable{past if bad else ''}"
        if not self.lost:
            return f"{name} {self.cause} for {self.gap_ticks} ticks: {instead}"
        return f"{name} {self.cause} since {self.since * period_s:.3f} s: {instead}"


@dataclass(frozen=True)
class SensorCheck:
    """The rule by which a reading is usable.

    Without a usable reading the controller's state and its commands stay as they are. After a short
    gap the sensor is lost; the next usable reading is used at once, as a controller that checks
    nothing would: to wait for more of them leaves the loop open for longer than the sensor does.

    Attributes:
        period_s: Between readings.
        limits: Largest size of each row, such as several times what the sensor can show; None is
            none.
        noisy: Whether noise changes each reading. Not so for a sensor whose noise is below its
            resolution, nor in a simulation without noise, where a machine at rest repeats itself.
        stuck_s: A row that repeats for so long is stuck, though not before 5 readings; one at the
            end of what its sensor can show repeats as well. A bus or a driver that is late repeats
            for some tens of milliseconds, in which a loop is better off with the old reading.
        gap_s: A longer gap is a loss.

    Raises:
        ValueError, TypeError: Of another kind than that, or a time longer than a day.
    """

    period_s: float
    limits: tuple[float, ...] | None = None
    noisy: bool = True
    stuck_s: float = 35e-3
    gap_s: float = 20e-3

    def __post_init__(self) -> None:
        check.duration("period_s", self.period_s)
        for name in ("stuck_s", "gap_s"):
            check.duration(name, getattr(self, name), least=0.0)
        check.flag("noisy", self.noisy)
        if self.limits is not None:
            most = check.instance("limits", self.limits, tuple, list, np.ndarray)
            _, limits = check.limit_vectors("limits", (0.0, most), len(most))
            vars(self)["limits"] = tuple(limits.tolist())

    def start(self, rows: int) -> SensorState:
        """Before the first reading of so many rows; none, if the sensor is not used.

        Raises:
            ValueError: Not so many as there are limits.
        """
        if check.index("rows", rows) and self.limits is not None and rows != len(self.limits):
            raise ValueError(f"rows must be as many as limits, {len(self.limits)}, got {rows}")
        return SensorState((nan,) * rows, None, (0,) * rows)

    def step(self, state: SensorState, reading: Any, sent: Array) -> SensorState:
        """The state after a reading; whatever that is, nothing is raised.

        Args:
            state: Before it.
            reading: What should be a vector of as many finite numbers as there are rows.
            sent: Inputs that the drives have had since the reading before, shape (n,). Only
                while these change does a reading have to.
        """
        last, repeats, repeated = state.last, state.repeats, state.repeated
        seen = numbers(reading, len(last))
        if seen is None or self._is_beyond(seen):
            cause = "gives no numbers" if seen is None else "reads beyond its range"
            after = replace(state, ticks=state.ticks + 1, missing=state.missing + 1)
            return self._without(state, after, cause)
        if self.noisy and any(map(eq, seen, last)):
            repeats = _repeats(state, seen, sent)
            repeated += all(repeats)
        elif any(repeats):
            repeats = (0,) * len(last)
        read = {"last": seen, "sent": sent, "repeats": repeats, "repeated": repeated}
        usable = {"ticks": state.ticks + 1, "gap_ticks": 0, "lost": False}
        after = changed(state, **read, **usable)
        if any(repeats) and (state.lost or self._is_stuck(repeats)):
            return self._without(state, after, "repeats one value")
        return after

    def _without(self, before: SensorState, after: SensorState, cause: str) -> SensorState:
        """The state after a reading that is not used."""
        gap, longest = before.gap_ticks + 1, max(after.repeats)
        lost = before.lost or self._is_stuck(after.repeats) or gap > self._ticks(self.gap_s)
        return replace(
            after,
            gap_ticks=gap,
            lost=lost,
            since=before.since if before.gap_ticks else after.ticks - max(longest, 1),
            cause=cause,
            held_ticks=before.held_ticks + 1,
            losses=before.losses + (lost and not before.lost),
        )

    def _is_stuck(self, repeats: tuple[int, ...]) -> bool:
        return max(repeats) >= self._ticks(self.stuck_s, _FEWEST)

    def _is_beyond(self, seen: tuple[float, ...]) -> bool:
        limits = self.limits
        return limits is not None and any(
            abs(value) > limit for value, limit in zip(seen, limits, strict=True)
        )

    def _ticks(self, time_s: float, fewest: int = 1) -> int:
        return max(fewest, round(time_s / self.period_s))


def _repeats(state: SensorState, seen: tuple[float, ...], sent: Array) -> tuple[int, ...]:
    """Of each row, the ticks that it has repeated; it begins to while the commands change.

    After a loss they do not, and a row that repeats is no usable one.
    """
    before = state.sent
    moved = state.lost or (before is not None and before.tobytes() != sent.tobytes())
    return tuple(
        count + 1 if now == then and (count or moved) else 0
        for count, now, then in zip(state.repeats, seen, state.last, strict=True)
    )


def numbers(reading: Any, rows: int) -> tuple[float, ...] | None:
    """The numbers of a reading; None where they are not `rows` moderate ones in a vector."""
    try:
        seen = tuple(reading.tolist())
        return seen if len(seen) == rows and hypot(*seen) < check.LARGEST else None
    except (AttributeError, TypeError, ValueError, OverflowError):
        return None
