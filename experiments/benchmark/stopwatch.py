"""Timing by turns in one process, so that noise of the machine hits all alike."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim import Array


@dataclass(frozen=True)
class Contender:
    """Something to be timed.

    Attributes:
        name: Of its median.
        call: Called as it is: nothing is wrapped around what is timed.
        arguments: Makes new ones before each sample, which calls once with each; it is not timed.
            Whatever was remembered of former arguments is of no use.
        units: So many of what is counted, control ticks or mappings, are in one call.
        samples: Taken in each round.
    """

    name: str
    call: Callable[..., Any]
    arguments: Callable[[], Sequence[tuple[Any, ...]]]
    units: int = 1
    samples: int = 1


def by_turns(
    contenders: Sequence[Contender],
    rounds: int,
    on_progress: Callable[[int, int], None],
    clock_ns: Callable[[], int] = time.process_time_ns,
) -> dict[str, Array]:
    """Time of one unit by name, [us], shape (rounds, samples).

    Every contender has its turn in every round. A round before the first warms caches and is not
    kept. The clock is the processor's time for this process: on a busy machine long calls are
    interrupted and short ones are not, so that wall time would be unfair to the long.
    """
    taken_us = {each.name: np.empty((rounds, each.samples)) for each in contenders}
    total = (rounds + 1) * len(contenders)
    for turn in range(rounds + 1):
        for k, each in enumerate(contenders):
            sampled_us = [_sample_us(each, clock_ns) for _ in range(each.samples)]
            if turn > 0:
                taken_us[each.name][turn - 1] = sampled_us
            on_progress(turn * len(contenders) + k + 1, total)
    return taken_us


def _sample_us(contender: Contender, clock_ns: Callable[[], int]) -> float:
    call, given = contender.call, contender.arguments()
    start_ns = clock_ns()
    for arguments in given:
        call(*arguments)
    return (clock_ns() - start_ns) / (1e3 * contender.units * len(given))
