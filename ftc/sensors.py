"""Sensor validation: usable readings are numbers within range that change from tick to tick.

Limit checking (Isermann, Fault-Diagnosis Systems, 2006, chapter 7), and a test for noise: a noisy
sensor hardly ever gives the same reading twice, bit by bit. If it does, it has repeated its last
reading, which a loop can use once more, or is stuck. A bias, another scale or more noise is not
detected here; the sensor offsets that the diagnosis tracks include a bias.
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
"""Time [s] and number of readings after which a repeated row counts as stuck (or saturated). A late
bus or driver repeats readings for some tens of milliseconds, in which a loop does better with the
old reading; in a slow loop one late reading is no stuck sensor."""

_GAP_S = 20e-3
"""Longest gap that is not a loss [s]. Commands held that long are late by half of it, 29 degrees in
a loop of 8 Hz: about the phase margin of the loops (34 degrees: `LARGEST_PEAK`)."""


@dataclass(frozen=True)
class SensorState:
    """State of a sensor check after a tick; counts are numbers of ticks so far.

    Attributes:
        last: Latest numeric reading, one number a row; NaN before the first.
        sent: Drive inputs before that reading, shape (n,); None before the first.
        repeats: Ticks since each row last changed while the commands did.
        ticks: Number of readings.
        gap_ticks: Length of the present gap without a usable reading; 0: no gap.
        lost: Whether the gap is longer than 20 ms, or a row is stuck.
        since: Tick at which the present or last gap began.
        cause: Fault of the latest unusable reading.
        missing: Ticks with a reading that was not numeric, of another shape, or out of range.
        repeated: Ticks with a reading that repeated all rows.
        unusable_ticks: Ticks without a usable reading.
        losses: Ticks at which the sensor became lost.
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
        """Return whether the latest reading is usable."""
        return not self.gap_ticks

    @property
    def new(self) -> bool:
        """Return whether the latest reading is usable and no row repeats the previous one."""
        return not self.gap_ticks and not any(self.repeats)

    @property
    def failed(self) -> bool:
        """Return whether a reading was missing or repeated so far."""
        return self.unusable_ticks > 0 or self.repeated > 0

    def sentence(self, period_s: float, name: str, instead: str) -> str:
        """Describe the sensor's state, and what is done `instead` of using it."""
        counts = ((self.missing, "missing"), (self.repeated, "repeated"))
        bad = ", ".join(f"{count} {what}" for count, what in counts if count)
        if self.usable:
            past = f" again ({bad}; lost {self.losses} times)" if self.losses else f" ({bad})"
            return f"{name} is usable{past if bad else ''}"
        if not self.lost:
            return f"{name} {self.cause} for {1e3 * self.gap_ticks * period_s:.3g} ms: {instead}"
        return f"{name} {self.cause} (since t = {self.since * period_s:.3f} s): {instead}"


@dataclass(frozen=True)
class SensorCheck:
    """Rule that decides whether a reading is usable.

    The sensor is lost after a gap of 20 ms; a row is stuck when it repeats for 35 ms and 5
    readings. The next usable reading is used at once.

    Attributes:
        period_s: Time between readings [s].
        limits: Largest absolute value of each row, such as several times the sensor's range; None
            is no limit.
        noisy: Whether noise changes each reading. False for a sensor whose noise is below its
            resolution or that is slower than the loop, and in simulations without noise.
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
        """Return the state before the first reading of `rows` rows; zero rows: no sensor."""
        if check.integer("rows", rows) and self.limits is not None and rows != len(self.limits):
            raise ValueError(f"rows must be as many as limits, {len(self.limits)}, got {rows}")
        return SensorState((nan,) * rows, None, (0,) * rows)

    def step(self, state: SensorState, reading: Any, sent: Array) -> SensorState:
        """Return the state after a reading of any type; an invalid one raises no error.

        Args:
            state: State before the reading.
            reading: Reading, usable if it is a vector of one finite number for each row.
            sent: Drive inputs since the previous reading, shape (n,). A reading has to change only
                while these change.
        """
        last, repeats, repeated = state.last, (0,) * len(state.last), state.repeated
        numbers = _numbers(reading, len(last))
        if numbers is None or (
            self.limits is not None and any(map(gt, map(abs, numbers), self.limits))
        ):
            cause = "gives no numbers" if numbers is None else "reads beyond its range"
            after = changed(state, ticks=state.ticks + 1, missing=state.missing + 1)
            return self._without(state, after, cause)
        if self.noisy and any(map(eq, numbers, last)):
            # A repetition starts only while the commands change. After a loss the commands are
            # held, and a repeated reading is not usable.
            before = state.sent
            moved = state.lost or (before is not None and before.tobytes() != sent.tobytes())
            rows = zip(state.repeats, map(eq, numbers, last), strict=True)
            repeats = tuple(count + 1 if same and (count or moved) else 0 for count, same in rows)
            repeated += all(repeats)
        read = {"last": numbers, "sent": sent, "repeats": repeats, "repeated": repeated}
        after = changed(state, **read, ticks=state.ticks + 1, gap_ticks=0, lost=False)
        if any(repeats) and (state.lost or self._is_stuck(repeats)):
            return self._without(state, after, "repeats one value")
        return after

    def _without(self, before: SensorState, after: SensorState, cause: str) -> SensorState:
        """Return the state after an unusable reading."""
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
    """States of all sensors after a tick.

    Attributes:
        task: State of the sensor of the major task.
        encoders: State of the actuator encoders; without rows if they are not used.
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
        """Return the states after a measurement of any type; invalid readings raise no error.

        Args:
            measurement: Object with the attributes of a :class:`ftc.Measurement`.
            sent: Drive inputs since the previous measurement, shape (n,).
            of_task: Check of the readings of the task.
            of_encoders: Check of the readings of the encoders.
            estimable: Whether encoders can replace a lost sensor of the task.
        """
        task = of_task.step(self.task, getattr(measurement, "output", None), sent)
        encoders = self.encoders
        if encoders.last:
            encoders = of_encoders.step(encoders, getattr(measurement, "displacement", None), sent)
        return Sensors(task, encoders, estimable and task.lost and not encoders.gap_ticks)

    @property
    def failed(self) -> bool:
        """Return whether a reading was missing or repeated so far."""
        return self.task.failed or self.encoders.failed

    def sentence(self, period_s: float) -> str:
        """Describe the states of the sensors and their consequences."""
        if not self.failed:
            return "all readings are usable"
        default = "the commands are held"
        instead = "the task is estimated from the encoders" if self.estimates else default
        text = self.task.sentence(period_s, "the sensor of the task", instead)
        if not self.encoders.failed:
            return text
        waits = "their use is suspended"
        return f"{text}; {self.encoders.sentence(period_s, 'the set of encoders', waits)}"


def numeric_measurement(measurement: Any, rows: int, actuators: int) -> Measurement:
    """Return the readings as float vectors; a missing, masked or invalid one is NaN."""
    vectors = []
    for name, size in (("output", rows), ("displacement", actuators)):
        reading = getattr(measurement, name, None)
        if not check.is_plain(reading) or reading.shape != (size,):
            numbers = _numbers(reading, size)
            reading = np.full(size, nan) if numbers is None else np.array(numbers, dtype=float)
        vectors.append(reading)
    return Measurement(*vectors)


def _numbers(reading: Any, rows: int) -> tuple[float, ...] | None:
    """Return the numbers of a reading; None unless they are a finite vector of `rows`."""
    try:
        numbers = tuple(reading.tolist())
        return numbers if len(numbers) == rows and hypot(*numbers) < check.LARGEST else None
    except (AttributeError, TypeError, ValueError, OverflowError):
        return None
