"""Guarded controllers: each kind of failure is reported in a sentence and never hangs."""

import contextlib
import re
import signal
import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from ftc import ControlTask, GuardedController, LoopRun, Measurement, run_loop
from tests.ftc.small_stage import Still, stage

TICKS, BAD = 20, 7
REFERENCE = np.random.default_rng(0).normal(size=(TICKS, 2))


class State(NamedTuple):
    """Tick and the inputs to send."""

    tick: int
    inputs: Any


class Proportional:
    """Proportional controller that calls `bad` at one tick."""

    def __init__(self, task: ControlTask) -> None:
        self.gain = np.linalg.pinv(task.major_jacobian)

    def start(self) -> State:
        return State(0, np.zeros(3))

    def step(self, state: State, reference: np.ndarray, measurement: Measurement) -> Any:
        assert measurement.output.dtype == measurement.displacement.dtype == float
        inputs = self.gain @ (reference - measurement.output)
        return self.bad(inputs) if state.tick == BAD else State(state.tick + 1, inputs)

    def bad(self, inputs: np.ndarray) -> Any:
        return State(BAD + 1, inputs)


def failing(bad: Any) -> type[Proportional]:
    return type("Failing", (Proportional,), {"bad": bad})


def run(factory: Any, limit_s: float = 1.0, machine: Any = None) -> LoopRun:
    guarded = GuardedController("my:own", factory, stage().task, limit_s)
    return run_loop(machine or Still(), guarded, REFERENCE)


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


HERE = r"\(test_guarded_controller.py, line \d+\)"


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        (divide, rf"raised ZeroDivisionError: .* {HERE}"),
        (leave, rf"raised SystemExit: 3 {HERE}"),
        (lambda self, u: State(8, np.array([0.0, 1.0, np.nan])), "returned nan for actuator 2"),
        (lambda self, u: State(8, [0.0, -np.inf, 1.0]), "returned -inf for actuator 1"),
        (lambda self, u: State(8, u[:2]), r"returned shape \(2,\), expected \(3,\)"),
        (lambda self, u: State(8, None), "returned None, expected 3 numbers"),
        (lambda self, u: State(8, u * 1j), "returned array.*, expected 3 numbers"),
        (lambda self, u: u, "raised AttributeError: .*inputs.*"),
        (hang, r"took longer than 0\.05 s"),
        (hang_and_catch, r"took longer than 0\.05 s"),
        (hang_twice, r"took longer than 0\.05 s"),
    ],
)
def test_after_a_failure_the_last_inputs_are_held_and_the_reason_is_reported(bad, sentence):
    """The run before the failure equals that of a controller without failure to the bit."""
    healthy, failed = run(Proportional), run(failing(bad), limit_s=0.05)
    assert healthy.state.failure is None
    assert np.array_equal(failed.inputs[:BAD], healthy.inputs[:BAD])
    assert (failed.inputs[BAD:] == healthy.inputs[BAD - 1]).all()
    assert len(failed.measured) == TICKS
    assert failed.state.failure is not None
    assert re.fullmatch(rf"my:own {sentence}, at 0\.007 s", failed.state.failure)


@pytest.mark.parametrize(("factory", "missing"), [(lambda task: task.no, "no"), (id, "start")])
def test_a_controller_that_cannot_be_started_leaves_the_drives_at_zero(factory, missing):
    done = run(factory)
    assert not done.inputs.any()
    sentence = f"my:own raised AttributeError: .*'{missing}'.*, at its start"
    assert re.fullmatch(sentence, done.state.failure or "")


def test_a_controller_gets_floats_for_integer_readings():
    done = run(Proportional, machine=Still(int))
    assert done.state.failure is None and done.inputs.any()


def test_after_a_missing_reading_a_controller_continues():
    """The commands are held and the step is not called only in the tick of the gap."""

    class Blinking(Still):
        ticks = 0

        def measure(self) -> Measurement:
            read, self.ticks = super().measure(), self.ticks + 1
            return replace(read, output=np.full(2, np.nan)) if self.ticks == 6 else read

    usual, blinked = run(Proportional).inputs, run(Proportional, machine=Blinking()).inputs
    np.testing.assert_array_equal(blinked, np.insert(np.delete(usual, 5, 0), 5, usual[4], 0))


@pytest.mark.parametrize("fails", [False, True])
def test_a_controller_alters_neither_the_record_nor_its_arguments(fails):

    class Overwriting(Proportional):
        sent, calls = np.zeros(3), 0

        def step(self, state, reference, measurement):
            self.calls += 1
            self.sent[:] = self.gain @ (reference - measurement.output)
            reference[:] = measurement.output[:] = measurement.displacement[:] = 99.0
            if fails and self.calls > BAD:
                self.sent[:] = np.nan
            return State(0, self.sent)

    expected_reference, done, usual = REFERENCE.copy(), run(Overwriting), run(Proportional)
    np.testing.assert_array_equal(done.measured, usual.measured)
    assert np.array_equal(expected_reference, REFERENCE)
    ticks = np.arange(TICKS)
    expected = usual.inputs[np.minimum(ticks, BAD - 1) if fails else ticks]
    np.testing.assert_array_equal(done.inputs, expected)


def test_the_clock_is_stopped_between_steps():
    """The limit applies to single steps, not to the whole run."""
    slow = failing(lambda self, u: time.sleep(0.03) or State(BAD, u))  # at all ticks from BAD on
    before = signal.getsignal(signal.SIGALRM)
    assert run(slow, limit_s=0.3).state.failure is None
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before


def test_an_inconsistent_task_is_rejected():
    with pytest.raises(ValueError, match="major must have a row for each of the 2 outputs"):
        replace(stage().task, major=(0,))
