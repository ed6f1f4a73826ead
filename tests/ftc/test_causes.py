"""What is as sudden as a failure, but none, is called what it is: a monitor of carts on springs."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ftc.fdi import Cause, monitor
from ftc.fdi.monitor import MonitorState
from tests.ftc.test_outside_hypotheses import BEGIN, CONFIG, HZ, NOMINAL, SOUND, TICK_S, TICKS

WIDE = replace(CONFIG.uncertainty, command=1e3, supply=0.3, scale=0.3)
ALONE = replace(WIDE, command=0.0, supply=0.0, scale=0.0)
MONITORS = {
    of: monitor(NOMINAL, config=replace(CONFIG, uncertainty=each))
    for of, each in (
        ("all", WIDE),
        ("failures alone", replace(WIDE, command=0.0, supply=0.0, scale=0.0)),
    )
}


def flown(of: str, seed: int, commands: Callable, readings: Callable) -> list[MonitorState]:
    """States of a monitor of carts whose commands and readings become others.

    Both are functions of time since then and of what they would be.
    """
    rng, watching = np.random.default_rng(seed), MONITORS[of]
    phase, size = rng.uniform(0, 2 * np.pi, 3), rng.uniform(4e-3, 8e-3, 3)
    x, u, states = np.zeros(6), np.zeros(3), [watching.start()]
    for tick in range(TICKS):
        since_s = (tick - BEGIN) * TICK_S
        read = SOUND.C @ x if since_s < 0 else readings(since_s, SOUND.C @ x)
        y = read + rng.standard_normal(3)
        states.append(watching.step(states[-1], NOMINAL.noise * y, u))
        u = size * np.sin(2.2 * tick * TICK_S * np.array([1.0, 0.8, 1.3]) + phase)
        u = u + 2e-3 * np.sin(2 * np.pi * HZ * tick * TICK_S)
        x = SOUND.A @ x + SOUND.B @ (u if since_s < 0 else commands(since_s, u))
    return states


def as_it_is(_: float, signal: np.ndarray) -> np.ndarray:
    return signal


EVENTS = {
    "offset": (Cause("offset", 1), lambda _, u: u + np.array([0, 0.02, 0]), as_it_is),
    "drift": (Cause("offset", 2), lambda s, u: u + s * np.array([0, 0, 0.1]), as_it_is),
    "supply": (Cause("supply"), lambda _, u: 0.5 * u, as_it_is),
    "scale": (Cause("scale"), as_it_is, lambda _, y: 1.6 * y),
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", EVENTS)
def test_a_cause_that_is_no_failure_is_named_and_no_actuator_is(name, seed):
    cause, *event = EVENTS[name]
    states = flown("all", seed, *event)
    assert all(state.diagnosis is None for state in states)
    assert states[-1].causes[0] == cause


@pytest.mark.parametrize("seed", [5, 9, 10])
def test_without_these_hypotheses_a_supply_that_fails_accuses_an_actuator(seed):
    """So the law above can fail: by failures alone, half of what all do is one's weakness."""
    _, *event = EVENTS["supply"]
    assert any(state.diagnosis for state in flown("failures alone", seed, *event))
    assert not any(state.diagnosis for state in flown("all", seed, *event))
