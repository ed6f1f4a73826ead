"""What happens to the sensors of the major rows."""

import math
from collections import deque

import numpy as np

from experiments.rig.events.target import Effect, Target
from sim import Array


def bias(target: Target, deviations: float, samples: float = math.inf) -> Effect:
    """The zero is off in a drawn direction, for some samples."""
    off = deviations * target.rig.noise * target.direction(len(target.rig.major))
    return Effect(measured=lambda tick, output: output + off if tick < samples else output)


def scaled(_: Target, factor: float) -> Effect:
    """That many times the truth is read."""
    return Effect(measured=lambda _, output: factor * output)


def stuck(target: Target, *, everywhere: bool) -> Effect:
    """A drawn row, or all of them, stays as it is."""
    m1 = len(target.rig.major)
    rows = slice(None) if everywhere else target.rng.integers(m1)
    held = np.empty(m1)

    def measured(tick: int, output: Array) -> Array:
        if tick == 0:
            held[:] = output
        seen = output.copy()
        seen[rows] = held[rows]
        return seen

    return Effect(measured=measured)


def noisy(target: Target, times: float) -> Effect:
    """The noise has that many times its standard deviation."""
    added, draw = target.rig.noise * math.sqrt(times**2 - 1.0), target.rng.standard_normal
    return Effect(measured=lambda _, output: output + added * draw(len(output)))


def missing(target: Target, duration_s: float) -> Effect:
    """Samples are NaN for some time, one at least."""
    ends = target.ticks(duration_s)
    return Effect(measured=lambda tick, output: output * np.nan if tick < ends else output)


def dropped(target: Target, part: float) -> Effect:
    """A part of the samples is NaN."""
    draw = target.rng.random
    return Effect(measured=lambda _, output: output * np.nan if draw() < part else output)


def repeated(target: Target, part: float) -> Effect:
    """A part of the samples repeats the one before."""
    draw, last = target.rng.random, np.empty(len(target.rig.major))

    def measured(tick: int, output: Array) -> Array:
        if tick == 0 or draw() >= part:
            last[:] = output
        return last.copy()

    return Effect(measured=measured)


def late(_: Target, ticks: int) -> Effect:
    """Samples come late; the first one is repeated until then."""
    under_way = deque[Array]()

    def measured(_: int, output: Array) -> Array:
        under_way.append(output)
        return under_way.popleft() if len(under_way) > ticks else under_way[0]

    return Effect(measured=measured)


def hum(target: Target, deviations: float, frequency_hz: float) -> Effect:
    """A sinusoid along a drawn direction is added."""
    peak = deviations * target.rig.noise * target.direction(len(target.rig.major))
    step = 2 * math.pi * frequency_hz * target.rig.period_s
    return Effect(measured=lambda tick, output: output + peak * math.sin(step * tick))
