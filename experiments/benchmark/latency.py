"""Latency of single control ticks in wall time, with Python's garbage collector on and off."""

import gc
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np

from experiments.study.terminal import OnProgress
from sim import Array

Clock = Callable[[], int]
"""In nanoseconds."""
_TURNS = 5  # everything has its turn so often, so that disturbances affect all alike
_WARM_UP = 100  # ticks before each turn that are not kept


@contextmanager
def _frozen() -> Iterator[None]:
    """What exists already is not looked at again by the collector, which stays on."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def _frozen_and_off() -> Iterator[None]:
    with _frozen():
        gc.disable()
        try:
            yield
        finally:
            gc.enable()


COLLECTORS = {
    "on": nullcontext,
    "frozen": _frozen,
    "off": _frozen_and_off,
}
"""Settings of the garbage collector, which is on outside them."""


def latencies(
    ticks: Mapping[str, Callable[[], object]],
    count: int,
    on_progress: OnProgress,
    clocks_ns: tuple[Clock, Clock] = (time.perf_counter_ns, time.thread_time_ns),
) -> list[dict[str, Any]]:
    """Distribution of the time of each single tick, a row for each setting of the collector.

    Args:
        ticks: A call is one tick.
        count: So many of each are timed with each setting, a multiple of the turns.
        on_progress: Is called after each turn.
        clocks_ns: Wall time, since a real-time loop waits for a tick that the operating system
            interrupts; and the processor's time for this thread, without such interruptions.
    """
    taken = {(name, setting): [] for name in ticks for setting in COLLECTORS}
    for turn in range(_TURNS):
        for k, ((name, setting), kept) in enumerate(taken.items(), 1):
            tick = ticks[name]
            with COLLECTORS[setting]():
                _timed(tick, _WARM_UP, clocks_ns)
                kept.append(_timed(tick, count // _TURNS, clocks_ns))
            on_progress(turn * len(taken) + k, _TURNS * len(taken))
    return [
        {"tick": name, "collector": setting} | _distribution(np.hstack(kept))
        for (name, setting), kept in taken.items()
    ]


def _timed(tick: Callable[[], object], count: int, clocks_ns: tuple[Clock, Clock]) -> Array:
    """[Wall time; processor time] of each tick, [us], shape (2, count)."""
    wall_ns, processor_ns = clocks_ns
    taken_us = np.empty((2, count))
    for k in range(count):
        worked = processor_ns()
        begin = wall_ns()
        tick()
        end = wall_ns()
        taken_us[:, k] = 1e-3 * (end - begin), 1e-3 * (processor_ns() - worked)
    return taken_us


def _distribution(taken_us: Array) -> dict[str, float]:
    median, p999 = np.percentile(taken_us[0], [50, 99.9])
    worst, worst_processor = taken_us.max(axis=1)
    return {
        "median_us": float(median),
        "p999_us": float(p999),
        "worst_us": float(worst),
        "worst_processor_us": float(worst_processor),
    }
