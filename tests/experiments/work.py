"""Runs without computation, for the processes that tests start; each imports this module."""

import os
import signal
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Run:
    """Parameters of a run."""

    number: int
    seed: int = 0


TEN = [Run(number) for number in range(10)]


def row(run: Run) -> dict[str, Any]:
    """Return numbers that are hard to write, and missing cells."""
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


def failing(run: Run) -> dict[str, Any]:
    if run.number == 6:
        raise ValueError("no such\n number")
    return row(run)


def square(number: int) -> tuple[int, set[int]]:
    """Return the square and the numbers of threads of all libraries."""
    from threadpoolctl import threadpool_info

    return number**2, {library["num_threads"] for library in threadpool_info()}


def refuse(what: str) -> None:
    raise ValueError(what)


def unprintable() -> object:
    return lambda: None


def kill_itself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def wait_for_a_signal() -> None:
    signal.pause()
