"""Runs that cost nothing, for the processes that tests start: light, as each imports it."""

import os
import signal
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Drawn:
    """A run."""

    number: int
    seed: int = 0


TEN = [Drawn(number) for number in range(10)]


def row(run: Drawn) -> dict[str, Any]:
    """Numbers that are hard to write, and cells that are missing."""
    rng = np.random.default_rng([run.seed, run.number])
    return {
        "case": run.number,
        "value": np.float64(rng.standard_normal() * 10.0 ** rng.integers(-300, 300)),
        "whole": int(rng.integers(100)) if run.number % 2 else None,
        "flag": bool(run.number % 3),
        "word": "ended" if run.number % 4 else None,
        "nothing": None,
        "infinite": float("inf"),
    }


def failing(run: Drawn) -> dict[str, Any]:
    if run.number == 6:
        raise ValueError("no such\n number")
    return row(run)


def square(number: int) -> tuple[int, set[int]]:
    """And on how many threads it was computed."""
    from threadpoolctl import threadpool_info

    return number**2, {library["num_threads"] for library in threadpool_info()}


def refuse(what: str) -> None:
    raise ValueError(what)


def unprintable() -> object:
    return lambda: None


def fall() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def wait_for_a_signal() -> None:
    signal.pause()
