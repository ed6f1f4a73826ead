"""Laws of the loop beside `test_hostile.py`: durations, gaps, frozen arrays, clocks, memory."""

import pickle
import time
from dataclasses import FrozenInstanceError, is_dataclass
from typing import Any

import control
import numpy as np
import pytest

from ftc import ControlTask, Goal, GuardedController, Measurement, OracleController, SensorCheck
from ftc.fdi import Dither, NominalModel, monitor
from ftc.fdi.diagnosis import FdiConfig
from tests.ftc.small_stage import DESIRED, LOADED, READ, STILL, N, stage


@pytest.mark.parametrize("duration_s", [1e6, 1e100, -1.0, 1e-200, -1e-200])
@pytest.mark.parametrize("name", ["period_s", "step_s", "step_limit_s", "sample_s"])
def test_a_duration_without_end_or_length_is_refused_at_once(name, duration_s):
    s, given = stage(), {name: duration_s}
    with pytest.raises(ValueError, match=rf"{name} must [^\n]*\Z"):
        if name == "step_limit_s":
            GuardedController("own", lambda task: s.plain, s.task, **given)
        elif name == "sample_s":
            FdiConfig(**given)
        else:
            NominalModel(**s.model | given)


def test_a_monitor_that_would_not_come_to_an_end_is_refused():
    with pytest.raises(ValueError, match="config must have samples of at most 10000 ticks"):
        monitor(stage().nominal, config=FdiConfig(sample_s=3600.0))


def masked(vector: np.ndarray) -> np.ma.MaskedArray:
    """The first number hidden."""
    return np.ma.array(vector, mask=np.arange(len(vector)) == 0)


NOT_READ = {
    "masked": masked(READ.output),
    "short": READ.output[:1],
    "text": "text",
    "objects": np.array([1, "a"], dtype=object),
    "huge": 1e200 * READ.output,
}


@pytest.mark.parametrize("output", NOT_READ)
@pytest.mark.parametrize("kind", ["supervisor", "guarded"])
def test_what_is_no_numbers_is_missing_as_a_gap_is(kind, output):
    """Neither used as data nor an error: the commands are held, and that is said."""
    controller, sent = getattr(stage(), kind), []
    for each in (np.full(2, np.nan), NOT_READ[output]):
        state = controller.step(controller.start(), DESIRED, READ)
        state = controller.step(state, DESIRED, Measurement(each, READ.displacement))
        sent.append((state.inputs.tolist(), state.sensors.task.missing))
    assert sent[0] == sent[1]
    assert sent[0][1] == 1


def test_without_a_sensor_check_a_gap_is_refused():
    pilot = stage().plain
    for gap in (np.full(2, np.nan), masked(READ.output)):
        with pytest.raises(ValueError, match=r"measurement\.output must "):
            pilot.step(pilot.start(), DESIRED, Measurement(gap, READ.displacement))


def copied(value: Any) -> Any:
    """With arrays that may be written to."""
    if isinstance(value, control.StateSpace):
        return control.ss(*(np.array(getattr(value, part)) for part in "ABCD"))
    if isinstance(value, tuple) and any(isinstance(each, np.ndarray) for each in value):
        return tuple(copied(each) for each in value)
    return value.copy() if isinstance(value, np.ndarray | dict) else value


def arrays(value: Any) -> list[np.ndarray]:
    """All that are held."""
    if isinstance(value, control.StateSpace):
        return [getattr(value, part) for part in "ABCD"]
    if isinstance(value, tuple):
        return [found for each in value for found in arrays(each)]
    return [value] if isinstance(value, np.ndarray) else []


def made_of(kind: type) -> dict[str, Any]:
    s, ones = stage(), np.ones(N)
    given = {
        NominalModel: s.model | LOADED,
        ControlTask: vars(s.task),
        OracleController: s.oracle,
        Dither: {"amplitude": 1.0, "frequency_hz": 1.0, "direction": ones},
        Goal: {"joint_weight": ones, "locked_at": {0: 1.0}, "effectiveness": {1: 0.5}},
        SensorCheck: {"period_s": 1e-3, "limits": np.ones(2)},
    }
    return {key: copied(value) for key, value in given[kind].items()}


@pytest.mark.parametrize(
    "kind", [NominalModel, ControlTask, OracleController, Dither, Goal, SensorCheck]
)
def test_what_is_frozen_does_not_change_with_what_it_was_made_of(kind):
    def kept() -> dict[str, bytes]:
        return {key: pickle.dumps([arrays(value), str(value)]) for key, value in vars(held).items()}

    given = made_of(kind)
    held = kind(**given)
    before = kept()
    for value in given.values():
        for array in arrays(value):
            array[:] = 7.0
        if isinstance(value, dict):
            value.clear()
    assert kept() == before
    assert is_dataclass(held)
    for key, value in vars(held).items():
        with pytest.raises(FrozenInstanceError):
            setattr(held, key, value)
        for array in arrays(value):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0.0


def test_no_clock_is_read(monkeypatch):
    """Time goes by ticks: a clock that goes backwards changes nothing."""

    def flight() -> list[list[float]]:
        rng, sent = np.random.default_rng(0), []
        for controller in (stage().supervisor, stage().guarded, stage().pilot()):
            state = controller.start()
            for _ in range(20):
                read = Measurement(READ.output + 1e-3 * rng.normal(size=2), READ.displacement)
                state = controller.step(state, DESIRED, read)
                sent.append(state.inputs.tolist())
        return sent

    usual, hands = flight(), iter(range(10**9, 0, -1000))
    for clock in ("time", "monotonic", "perf_counter"):
        monkeypatch.setattr(time, clock, lambda: next(hands))
    assert flight() == usual


def test_a_state_does_not_grow_with_its_ticks():
    """What is kept of thousands of ticks is what is kept of hundreds of samples."""
    supervisor = stage().supervisor
    rng, state, sizes = np.random.default_rng(0), supervisor.start(), []
    for tick in range(6000):
        read = Measurement(1e-3 * rng.normal(size=2), STILL)
        state = supervisor.step(state, DESIRED, read)
        if tick in (2999, 5999):
            sizes.append(len(pickle.dumps((state.watch, state.sensors, state.controller))))
    assert sizes[1] == pytest.approx(sizes[0], rel=0.01)
