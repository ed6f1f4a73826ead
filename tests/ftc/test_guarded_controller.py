"""Somebody else's controller in the loop: each way to fail ends in a sentence, none in a hang."""

import contextlib
import re
import signal
import time
from dataclasses import replace
from typing import Any, NamedTuple

import control
import numpy as np
import pytest

from ftc import ControlTask, DirectDrive, Goal, GuardedController, LoopRun, Measurement, run_loop
from ftc.fdi import NominalModel

PERIOD_S, TICKS, BAD = 1e-3, 20, 7
J = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
_I, _O = np.eye(3), np.zeros((3, 3))
PLANT = control.ss(
    np.block([[_O, _I], [-100 * _I, -20 * _I]]), np.vstack([_O, 100 * _I]), np.hstack([J, 0 * J]), 0
)
NOMINAL = NominalModel(PLANT, np.eye(3, 6), np.full(2, 1e-3), PERIOD_S, PERIOD_S)
TASK = ControlTask(
    NOMINAL, J, (0, 1), Goal(), DirectDrive(), (np.full(3, -1.0), np.full(3, 1.0)), np.ones(2)
)
REFERENCE = np.random.default_rng(0).normal(size=(TICKS, 2))


class State(NamedTuple):
    """Time, and what is sent."""

    tick: int
    inputs: Any


class Proportional:
    """What goes out is a function of what comes in; at one tick it does something else."""

    def __init__(self, task: ControlTask) -> None:
        self.gain = np.linalg.pinv(task.major_jacobian)

    def start(self) -> State:
        """At rest."""
        return State(0, np.zeros(3))

    def step(self, state: State, reference: np.ndarray, measurement: Measurement) -> Any:
        """As the error is."""
        inputs = self.gain @ (reference - measurement.output)
        return self.bad(inputs) if state.tick == BAD else State(state.tick + 1, inputs)

    def bad(self, inputs: np.ndarray) -> Any:
        """Of the tick BAD."""
        return State(BAD + 1, inputs)


class Still:
    """A machine that does not move, whose sensors have noise."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(1)

    def measure(self) -> Measurement:
        """Noise."""
        return Measurement(1e-3 * self.rng.normal(size=2), np.zeros(3))

    def apply(self, inputs: np.ndarray) -> None:
        """Nothing."""


def failing(bad: Any) -> type[Proportional]:
    return type("Failing", (Proportional,), {"bad": bad})


def run(factory: Any, limit_s: float = 1.0) -> LoopRun:
    return run_loop(Still(), GuardedController("my:own", factory, TASK, limit_s), REFERENCE)


def hang(self: Any, inputs: Any) -> Any:
    while True:
        pass


def hang_and_catch(self: Any, inputs: Any) -> Any:
    while True:
        with contextlib.suppress(Exception):
            time.sleep(10)


def hang_twice(self: Any, inputs: Any) -> Any:
    with contextlib.suppress(BaseException):
        time.sleep(10)
    time.sleep(10)


def divide(self: Any, inputs: Any) -> Any:
    return 1 // 0


def leave(self: Any, inputs: Any) -> Any:
    raise SystemExit(3)


def singular(self: Any, inputs: Any) -> Any:
    return np.linalg.inv(np.zeros((2, 2)))


HERE = "test_guarded_controller.py, line "


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        (divide, rf"raised ZeroDivisionError: .* \({HERE}\d+\)"),
        (singular, rf"raised LinAlgError: Singular matrix \({HERE}\d+\)"),
        (leave, rf"raised SystemExit: 3 \({HERE}\d+\)"),
        (lambda self, u: State(8, np.array([0.0, 1.0, np.nan])), "returned nan for drive 3"),
        (lambda self, u: State(8, [0.0, -np.inf, 1.0]), "returned -inf for drive 2"),
        (lambda self, u: State(8, u[:2]), r"returned shape \(2,\), expected \(3,\)"),
        (lambda self, u: State(8, 1.0), r"returned shape \(\), expected \(3,\)"),
        (lambda self, u: State(8, None), "returned None, expected 3 numbers"),
        (lambda self, u: State(8, u * 1j), "returned array.*, expected 3 numbers"),
        (lambda self, u: u, "raised AttributeError: .*inputs.*"),
        (hang, r"took longer than 0\.05 s"),
        (hang_and_catch, r"took longer than 0\.05 s"),
        (hang_twice, r"took longer than 0\.05 s"),
    ],
)
def test_after_a_failure_the_last_inputs_are_held_and_a_sentence_says_why(bad, sentence):
    """Before it the run is bit for bit that of a controller that does not fail."""
    sound, failed = run(Proportional), run(failing(bad), limit_s=0.05)
    assert sound.state.failure is None
    assert np.array_equal(failed.inputs[:BAD], sound.inputs[:BAD])
    assert (failed.inputs[BAD:] == sound.inputs[BAD - 1]).all()
    assert len(failed.measured) == TICKS
    assert failed.state.failure is not None
    assert re.fullmatch(rf"my:own {sentence}, at 0\.007 s", failed.state.failure)


def no_start(task: ControlTask) -> Any:
    return object()


@pytest.mark.parametrize(
    ("factory", "sentence"),
    [
        (lambda task: task.unknown, "raised AttributeError: .*'unknown'.*, at its start"),
        (no_start, "raised AttributeError: 'object' .*'start'.*, at its start"),
    ],
)
def test_a_controller_that_cannot_be_started_leaves_the_drives_at_zero(factory, sentence):
    done = run(factory)
    assert not done.inputs.any()
    assert re.fullmatch(f"my:own {sentence}", done.state.failure or "")


def test_a_controller_gets_floats_whatever_a_sensor_counts_in():
    class Counting(Still):
        def measure(self) -> Measurement:
            return Measurement(np.array([1, 2]), np.array([True, False, True]))

    class Own(Proportional):
        def step(self, state, reference, measurement):
            assert measurement.output.dtype == measurement.displacement.dtype == float
            return super().step(state, reference, measurement)

    done = run_loop(Counting(), GuardedController("my:own", Own, TASK, 1.0), REFERENCE)
    assert done.state.failure is None and done.inputs.any()


def test_a_controller_alters_neither_the_record_nor_what_it_was_sent():
    """It gets copies, and copies are taken of what it returns."""

    class Overwriting(Proportional):
        sent = np.zeros(3)

        def step(self, state, reference, measurement):
            self.sent[:] = self.gain @ (reference - measurement.output)
            reference[:] = measurement.output[:] = measurement.displacement[:] = 99.0
            return State(0, self.sent)

    kept, done = REFERENCE.copy(), run(Overwriting)
    np.testing.assert_array_equal(done.measured, run(Proportional).measured)
    assert np.array_equal(kept, REFERENCE)
    assert np.array_equal(done.inputs, run(Proportional).inputs)

    class Fails(Overwriting):
        calls = 0

        def step(self, state, reference, measurement):
            state = super().step(state, reference, measurement)
            self.calls += 1
            if self.calls > BAD:
                self.sent[:] = np.nan
            return state

    held = run(Fails).inputs
    assert (held[BAD:] == done.inputs[BAD - 1]).all()


def test_the_clock_is_stopped_between_steps():
    """However long a run takes: only single steps are limited."""
    slow = failing(lambda self, u: time.sleep(0.1) or State(BAD, u))  # at all ticks from BAD on
    before = signal.getsignal(signal.SIGALRM)
    assert run(slow, limit_s=1.0).state.failure is None
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"J": J[:, :2]}, r"J must have shape \(any, 3\)"),
        ({"major": (0, 2)}, r"major must lie in 0\.\.1"),
        ({"major": (0,)}, "major must have a row for each of the 2 outputs of nominal, got 1"),
        ({"limits": (np.ones(3), np.zeros(3))}, "limits must be a lower and an upper limit"),
        ({"reference_limit": np.ones(3)}, "reference_limit must have shape"),
        ({"nominal": PLANT}, "nominal must be a NominalModel"),
    ],
)
def test_a_task_that_does_not_fit_together_is_refused(change, said):
    with pytest.raises((ValueError, TypeError), match=said):
        replace(TASK, **change)
