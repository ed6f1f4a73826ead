"""Usable readings: a rule of numbers, ranges and repetitions."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftc import SensorCheck
from ftc.sensors import SensorState

PERIOD_S = 1e-3
CHECK = SensorCheck(PERIOD_S, limits=(10.0, 10.0))
MESSAGES = "the task's sensor", "the commands are held"
STUCK = 35  # in ticks of the usual period
SOON = 10  # ticks of a slower loop, for which random readings repeat now and then


def read(readings: Any, check: SensorCheck = CHECK, moving: bool = True) -> list[SensorState]:
    """Return the states after each reading, with or without changing commands."""
    state, states = check.start(2), []
    for tick, reading in enumerate(readings):
        state = check.step(state, reading, np.full(3, float(tick * moving)))
        states.append(state)
    return states


def noise(ticks: int, seed: int = 0) -> list[Any]:
    return list(np.random.default_rng(seed).normal(size=(ticks, 2)))


NO_NUMBERS = [
    *(None, np.array([np.nan, 0.0]), np.array([0.0, np.inf]), np.zeros(3), np.zeros((2, 1))),
    *(np.array(0.0), np.array(["a", "b"]), np.array([1j, 0j]), np.array([None, None])),
    *([0.0, 0.0], "reading", np.array([0.0, 10.1]), np.array([1, "a"], dtype=object)),
    np.ma.array([0.0, 0.0], mask=[True, False]),
]


@given(st.lists(st.tuples(st.integers(-2, 13), st.integers(0, 9)), max_size=80))
def test_the_sensor_rule_equals_its_definition(spec):
    """The reference evaluates the whole record, whose rows take one of a few values."""
    values = np.random.default_rng(1).normal(size=(10, 2))
    readings = [
        NO_NUMBERS[kind] if kind >= 0 else np.array([values[n % 5, 0], values[n, 1]])
        for kind, n in spec
    ]
    states = read(readings, replace(CHECK, period_s=STUCK / SOON * PERIOD_S))
    missing = [kind >= 0 for kind, _ in spec]
    assert [state.missing for state in states] == np.cumsum(missing, dtype=int).tolist()
    assert [state.unusable_ticks for state in states] == np.cumsum(
        [not state.usable for state in states], dtype=int
    ).tolist()
    lost = False
    for tick, state in enumerate(states):
        numbers = [
            each for each, bad in zip(readings[: tick + 1], missing, strict=False) if not bad
        ]
        runs = [0, 0]
        for row in (0, 1):
            while len(numbers) > runs[row] + 1 and (
                numbers[-1 - runs[row]][row] == numbers[-2 - runs[row]][row]
            ):
                runs[row] += 1
        if not lost:
            assert state.usable == (not missing[tick] and max(runs) < SOON)
        else:
            assert state.usable == (not missing[tick] and max(runs) == 0)
        lost = state.lost


@pytest.mark.parametrize("period_s", [0.5e-3, 1e-3, 2e-3])
def test_a_sensor_is_stuck_or_lost_after_the_same_time_at_any_rate(period_s):
    """Slow loops wait for five repetitions instead."""
    check = SensorCheck(period_s)
    stuck = read([np.ones(2)] * 100, check)
    gone = read([*noise(1), *[None] * 100, *noise(9, seed=1)], check)
    assert gone[-1].usable and gone[-1].losses == 1  # a gap ends with the next reading
    assert sum(state.usable for state in stuck) * period_s == pytest.approx(35e-3, abs=period_s)
    lost_s = sum(not state.lost for state in gone[:101]) * period_s
    assert lost_s == pytest.approx(20e-3, abs=1.5 * period_s)
    slow = read([np.ones(2)] * 8, SensorCheck(0.1))
    assert [state.usable for state in slow] == [True] * 5 + [False] * 3


def test_readings_may_repeat_at_rest_and_without_noise():
    """Constant commands give no information on the sensor."""
    still = [np.zeros(2)] * 100
    assert all(state.usable for state in read(still, moving=False))
    text = read(still)[-1].sentence(PERIOD_S, *MESSAGES)
    assert text == "the task's sensor repeats one value (since t = 0.001 s): the commands are held"
    assert all(state.usable for state in read(still, SensorCheck(PERIOD_S, noisy=False)))


@pytest.mark.parametrize("rows", [[0], [0, 1]])
def test_a_repeated_reading_is_usable_but_not_new(rows):
    """A reading with one repeated row is not new either: the rows are of different times."""
    readings = noise(20)
    readings[10][rows] = readings[9][rows]
    states = read(readings)
    assert all(state.usable for state in states)
    assert [state.new for state in states] == [tick != 10 for tick in range(20)]
    assert states[-1].repeated == (len(rows) == 2)
    if len(rows) == 2:
        assert (
            states[-1].sentence(PERIOD_S, *MESSAGES) == "the task's sensor is usable (1 repeated)"
        )


def test_after_a_loss_a_repeated_reading_is_not_usable():
    """The commands are held and do not change."""
    check, sent = CHECK, np.ones(3)
    state = check.step(check.start(2), np.ones(2), np.zeros(3))
    for reading in [None] * 30 + [np.ones(2)] * 100:
        state = check.step(state, reading, sent)
        assert not state.usable
    assert state.cause == "repeats one value"
