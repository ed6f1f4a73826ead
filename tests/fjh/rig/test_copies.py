"""Rigs, pilots and machines are copied, sent to other processes and shared by threads.

Whoever has one flies the same to the bit.
"""

import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from copy import copy, deepcopy
from functools import cache
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

from fjh.rig import Rig, Run
from sim import Bench, Failure
from tests.fjh.rig.test_rig import rig

MADE = ["controller", "supervisor"]
LOGS = ("true", "measured", "inputs", "displacement", "qpos", "closure_m")


def pickled(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


COPIES: dict[str, Callable[[Any], Any]] = {"copied": copy, "deep": deepcopy, "pickled": pickled}


@cache
def pilot(name: str, made: str) -> Any:
    return getattr(rig(name), made)()


def flown(one: Rig, controller: Any, actuator: int = 0, duration_s: float = 0.1) -> Run:
    """A flight with an actuator that is weak from its start, and locks halfway."""
    path = one.path("circle", duration_s=duration_s, turn_s=0.1)
    failures = [Failure(actuator, "weak"), Failure(actuator, "locked", duration_s / 2)]
    return one.fly(controller, path, failures=failures, seed=actuator)


def assert_same(run: Run, other: Run) -> None:
    for name in LOGS:
        np.testing.assert_array_equal(getattr(run, name), getattr(other, name), err_msg=name)
    assert run.status == other.status


@pytest.mark.parametrize("made", MADE)
@pytest.mark.parametrize("name", ["hexapod", pytest.param("arm", marks=pytest.mark.long)])
@pytest.mark.parametrize("how", COPIES)
def test_a_copy_flies_the_same_to_the_bit(how, name, made):
    """The rig, the pilot, both at once; and a run is copied with the state of its pilot."""
    one, other = rig(name), pilot(name, made)
    run, copied = flown(one, other), COPIES[how]
    both: tuple[Rig, Any] = copied((one, other))
    for a_rig, a_pilot in (both, (copied(one), other), (one, copied(other))):
        assert_same(run, flown(a_rig, a_pilot))
    assert_same(run, copied(run))


@pytest.mark.parametrize("how", ["deep", "pickled"])
@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_a_machine_that_is_copied_in_flight_goes_on_as_it_would_have(how, name):
    """Neither shares anything with the other: failures, physics and noise are its own."""
    one = rig(name, "all")
    time_s, n = np.arange(40) * one.period_s, len(one.actuators)
    bench = one.bench(time_s, [Failure(0, "weak", 0.0), Failure(1, "locked", 0.03)], 5)
    for tick in range(20):
        moved(bench, tick, n)
    first, second = COPIES[how](bench), COPIES[how](bench)
    for tick in range(20, 40):
        for each in (first, bench, second):
            moved(each, tick, n)
    for each in (first, second):
        for log in ("qpos", "rotation", "displacement", "actuator_force"):
            np.testing.assert_array_equal(getattr(each, log), getattr(bench, log), err_msg=log)
        assert each.plant.model is not bench.plant.model


def moved(bench: Bench, tick: int, actuators: int) -> None:
    bench.measure()
    bench.apply(1e-3 * np.sin(np.arange(actuators) + 0.5 * tick))


def diagnosed(given: tuple[Rig, Any]) -> Run:
    """A flight in which a failure is named."""
    return flown(*given, duration_s=1.8)


@pytest.mark.long
def test_another_process_flies_what_it_is_sent_and_finds_what_fails():
    given = rig("arm"), pilot("arm", "supervisor")
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        there = pool.submit(diagnosed, given)
        assert_same(there.result(), here := diagnosed(given))
    assert here.diagnoses


@pytest.mark.long
@pytest.mark.usefixtures("switching")
@pytest.mark.parametrize("name", ["arm", "hand", "hexapod"])
def test_threads_that_share_a_rig_fly_as_one_alone(name):
    """And a pilot: each has failures of its own."""
    one, other = rig(name), pilot(name, "supervisor")
    actuators = [0, 1, 0, 1]
    with ThreadPoolExecutor(4) as pool:
        runs = pool.map(lambda actuator: flown(one, other, actuator), actuators)
        for actuator, run in zip(actuators, list(runs), strict=True):
            assert_same(run, flown(one, other, actuator))
