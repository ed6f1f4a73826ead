"""Whether readings are usable: numbers within range that change from tick to tick.

Limit checking (Isermann, Fault-Diagnosis Systems, 2006, chapter 7), and a test of the noise: a
sensor that has some hardly ever reads the same twice, bit by bit. One that does has repeated its
last reading, which a loop can use once more, or is stuck. A bias, another scale or more noise
cannot be seen from the sensor itself: the offsets that the diagnosis tracks take up a bias.
"""

from dataclasses import dataclass, replace
from math import hypot, nan
from operator import eq, gt
from typing import Any

import numpy as np

import argument_checks as check
from argument_checks import Array
from argument_checks.records import changed
from ftc.controller import Measurement

_STUCK_S, _FEWEST = 35e-3, 5
"""A row that repeats for so long is stuck; so is one at the end of what its sensor can show. A bus
or a driver that is late repeats for some tens of milliseconds, in which a loop is better off with
the old reading. Not before so many readings: in a slow loop one late reading is no stuck sensor."""

_GAP_S = 20e-3
"""A longer gap is a loss. Commands that are held for so long are late by half of it, by 29 degrees
in a loop of 8 Hz: about as much as loops can bear (34 degrees: `LARGEST_PEAK`)."""


@dataclass(frozen=True)
class SensorState:
    """What is known of a sensor after a tick.

    Counts are of ticks so far.

    Attributes:
        last: Latest reading of numbers, one a row; NaN before the first.
        sent: Inputs of the drives before that reading, shape (n,); None before the first.
        repeats: Of each row, ticks since it last changed while the commands did.
        ticks: All.
        gap_ticks: Without a usable reading, up to now; 0: this one is usable.
        lost: Whether the gap is longer than a short one, or a row is stuck.
        since: The tick at which the present gap, or the last one, began.
        cause: What was wrong with the latest reading that was not usable.
        missing: Whose readings were no numbers, of another shape, or beyond range.
        repeated: Whose readings repeated all rows, or one that is stuck.
        held_ticks: Without a usable reading.
        losses: At which the sensor was lost.
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
    unusable_ticks: int = 0
    losses: int = 0

    @property
    def usable(self) -> bool:
        """Whether the latest reading is."""
        return not self.gap_ticks

    @property
    def new(self) -> bool:
        """Whether it also says something new, and no row repeats the reading before."""
        return not self.gap_ticks and not any(self.repeats)

    @property
    def failed(self) -> bool:
        """Whether a reading was missing or repeated so far."""
        return self.unusable_ticks > 0 or self.repeated > 0

    def sentence(self, period_s: float, name: str, instead: str) -> str:
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

    After a gap of 20 ms the sensor is lost; a row that repeats for 35 ms, and for 5 readings, is
    stuck. The next usable reading is used at once: to wait for more of them leaves the loop open
    for longer than the sensor does.

    Attributes:
        period_s: Between readings.
        limits: Largest size of each row, such as several times what the sensor can show; None is
            none.
        noisy: Whether noise changes each reading. Not so for a sensor whose noise is below its
            resolution, or that is slower than the loop, nor in a simulation without noise, where a
            machine at rest repeats itself.
    """

    period_s: float
    limits: tuple[float, ...] | None = None
    noisy: bool = True

    def __post_init__(self) -> None:
        check.number("period_s", self.period_s, *check.SECONDS)
        check.flag("noisy", self.noisy)
        if self.limits is not None:
            most = check.instance("limits", self.limits, tuple, list, np.ndarray)
            _, limits = check.limits("limits", (0.0, most), len(most))
            vars(self)["limits"] = tuple(limits.tolist())

    def start(self, rows: int) -> SensorState:
        """Before the first reading of so many rows, as many as limits; none for no sensor."""
        if check.integer("rows", rows) and self.limits is not None and rows != len(self.limits):
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
        last, repeats, repeated = state.last, (0,) * len(state.last), state.repeated
        seen = _numbers(reading, len(last))
        if seen is None or (self.limits is not None and any(map(gt, map(abs, seen), self.limits))):
            cause = "gives no numbers" if seen is None else "reads beyond its range"
            after = changed(state, ticks=state.ticks + 1, missing=state.missing + 1)
            return self._without(state, after, cause)
        if self.noisy and any(map(eq, seen, last)):
            # A row begins to while the commands change. After a loss they do not, and one that
            # repeats is no usable one.
            before = state.sent
            moved = state.lost or (before is not None and before.tobytes() != sent.tobytes())
            rows = zip(state.repeats, map(eq, seen, last), strict=True)
            repeats = tuple(count + 1 if same and (count or moved) else 0 for count, same in rows)
            repeated += all(repeats)
        read = {"last": seen, "sent": sent, "repeats": repeats, "repeated": repeated}
        after = changed(state, **read, ticks=state.ticks + 1, gap_ticks=0, lost=False)
        if any(repeats) and (state.lost or self._is_stuck(repeats)):
            return self._without(state, after, "repeats one value")
        return after

    def _without(self, before: SensorState, after: SensorState, cause: str) -> SensorState:
        """The state after a reading that is not used."""
        gap, longest = before.gap_ticks + 1, max(after.repeats)
        lost = before.lost or self._is_stuck(after.repeats) or gap > self._ticks(_GAP_S)
        return replace(
            after,
            gap_ticks=gap,
            lost=lost,
            since=before.since if before.gap_ticks else after.ticks - max(longest, 1),
            cause=cause,
            unusable_ticks=before.unusable_ticks + 1,
            losses=before.losses + (lost and not before.lost),
        )

    def _is_stuck(self, repeats: tuple[int, ...]) -> bool:
        return max(repeats) >= max(self._ticks(_STUCK_S), _FEWEST)

    def _ticks(self, time_s: float) -> int:
        return max(1, round(time_s / self.period_s))


@dataclass(frozen=True, slots=True)
class Sensors:
    """What is known of the sensors after a tick.

    Attributes:
        task: Of the major task.
        encoders: Of the actuators; without rows where they are not used.
        estimates: Whether the major task is estimated from the encoders.
    """

    task: SensorState
    encoders: SensorState
    estimates: bool = False

    def after(
        self,
        measurement: Any,
        sent: Array,
        of_task: SensorCheck,
        of_encoders: SensorCheck,
        *,
        estimable: bool = False,
    ) -> "Sensors":
        """What is known after a measurement; whatever that is, nothing is raised.

        Args:
            measurement: What should have the attributes of a :class:`ftc.Measurement`.
            sent: Inputs of the drives since the measurement before, shape (n,).
            of_task: When the readings of the task are usable.
            of_encoders: And those of the encoders.
            estimable: Whether encoders can stand in for a task's sensor that is lost.
        """
        task = of_task.step(self.task, getattr(measurement, "output", None), sent)
        encoders = self.encoders
        if encoders.last:
            read = getattr(measurement, "displacement", None)
            encoders = of_encoders.step(encoders, read, sent)
        return Sensors(task, encoders, estimable and task.lost and not encoders.gap_ticks)

    @property
    def failed(self) -> bool:
        """Whether a reading was missing or repeated so far."""
        return self.task.failed or self.encoders.failed

    def sentence(self, period_s: float) -> str:
        """What the sensors read, and what is done about it."""
        if not self.failed:
            return "all readings are usable"
        default = "the commands are held"
        instead = "the task is estimated from the encoders" if self.estimates else default
        text = self.task.sentence(period_s, "the sensor of the task", instead)
        if not self.encoders.failed:
            return text
        waits = "what needs them waits"
        return f"{text}; {self.encoders.sentence(period_s, 'the set of encoders', waits)}"


def numeric_measurement(measurement: Any, rows: int, actuators: int) -> Measurement:
    """Vectors of what should be a measurement: NaN where a reading is none, or a masked one."""
    vectors = []
    for name, size in (("output", rows), ("displacement", actuators)):
        reading = getattr(measurement, name, None)
        if not check.is_plain(reading) or reading.shape != (size,):
            seen = _numbers(reading, size)
            reading = np.full(size, nan) if seen is None else np.array(seen, dtype=float)
        vectors.append(reading)
    return Measurement(*vectors)


def _numbers(reading: Any, rows: int) -> tuple[float, ...] | None:
    """The numbers of a reading; None where they are not `rows` moderate ones in a vector."""
    try:
        seen = tuple(reading.tolist())
        return seen if len(seen) == rows and hypot(*seen) < check.LARGEST else None
    except (AttributeError, TypeError, ValueError, OverflowError):
        return None
