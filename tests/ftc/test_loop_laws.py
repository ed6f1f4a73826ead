"""Laws of the loop in addition to `test_hostile.py`: gaps, frozen arrays, clocks, memory."""

import pickle
import time
from copy import deepcopy
from dataclasses import FrozenInstanceError, is_dataclass, replace
from typing import Any

import control
import numpy as np
import pytest

from ftc import ControlTask, Goal, Measurement, OracleController, SensorCheck
from ftc.fdi import Dither, NominalModel, monitor
from ftc.fdi.diagnosis import FdiConfig
from tests.ftc.small_stage import DESIRED, LOADED, READ, STILL, N, stage


def test_a_monitor_with_endless_samples_is_rejected():
    with pytest.raises(ValueError, match="config must have samples of at most 10000 ticks"):
        monitor(stage().nominal, config=FdiConfig(sample_s=3600.0))


def test_a_plant_with_feedthrough_is_rejected():
    healthy = stage().nominal
    through = np.zeros((2, N))
    through[0, 1] = 1e-3
    plant = control.ss(healthy.plant.A, healthy.plant.B, healthy.plant.C, through)
    with pytest.raises(ValueError, match="no feedthrough"):
        replace(healthy, plant=plant)


def test_without_a_sensor_check_a_gap_is_rejected():
    controller = stage().plain
    for gap in (np.full(2, np.nan), np.ma.array(READ.output, mask=[True, False])):
        with pytest.raises(ValueError, match=r"measurement\.output must "):
            controller.step(controller.start(), DESIRED, Measurement(gap, READ.displacement))


def arrays(value: Any) -> list[np.ndarray]:
    """Return all arrays within a value."""
    if isinstance(value, control.StateSpace):
        return [getattr(value, part) for part in "ABCD"]
    if isinstance(value, tuple):
        return [item for each in value for item in arrays(each)]
    return [value] if isinstance(value, np.ndarray) else []


def made_of(kind: type) -> dict[str, Any]:
    s, ones = stage(), np.ones(N)
    arguments = {
        NominalModel: s.model | LOADED,
        ControlTask: vars(s.task),
        OracleController: s.oracle,
        Dither: {"amplitude": 1.0, "frequency_hz": 1.0, "direction": ones},
        Goal: {"joint_weight": ones, "locked_at": {0: 1.0}, "effectiveness": {1: 0.5}},
        SensorCheck: {"period_s": 1e-3, "limits": np.ones(2)},
    }
    return deepcopy(arguments[kind])


@pytest.mark.parametrize(
    "kind", [NominalModel, ControlTask, OracleController, Dither, Goal, SensorCheck]
)
def test_frozen_objects_do_not_change_with_their_arguments(kind):
    def snapshot() -> dict[str, bytes]:
        return {
            key: pickle.dumps([arrays(value), str(value)]) for key, value in vars(instance).items()
        }

    arguments = made_of(kind)
    instance = kind(**arguments)
    before = snapshot()
    for value in arguments.values():
        for array in arrays(value):
            array[:] = 7.0
        if isinstance(value, dict):
            value.clear()
    assert snapshot() == before
    assert is_dataclass(instance)
    for key, value in vars(instance).items():
        with pytest.raises(FrozenInstanceError):
            setattr(instance, key, value)
        for array in arrays(value):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0.0


def test_no_clock_is_read(monkeypatch):
    """Time is counted in ticks: a clock that runs backwards has no effect."""

    def simulate() -> list[list[float]]:
        rng, sent = np.random.default_rng(0), []
        for controller in (stage().supervisor, stage().guarded, stage().make_controller()):
            state = controller.start()
            for _ in range(20):
                read = Measurement(READ.output + 1e-3 * rng.normal(size=2), READ.displacement)
                state = controller.step(state, DESIRED, read)
                sent.append(state.inputs.tolist())
        return sent

    usual, hands = simulate(), iter(range(10**9, 0, -1000))
    for clock in ("time", "monotonic", "perf_counter"):
        monkeypatch.setattr(time, clock, lambda: next(hands))
    assert simulate() == usual


def test_a_state_does_not_grow_with_its_ticks():
    """The memory after thousands of ticks is that after hundreds of samples."""
    supervisor = stage().supervisor
    rng, state, sizes = np.random.default_rng(0), supervisor.start(), []
    for tick in range(6000):
        read = Measurement(1e-3 * rng.normal(size=2), STILL)
        state = supervisor.step(state, DESIRED, read)
        if tick in (2999, 5999):
            sizes.append(len(pickle.dumps((state.monitor_state, state.sensors, state.controller))))
    assert sizes[1] == pytest.approx(sizes[0], rel=0.01)
