"""Supervisor: reconfiguration, confirmation and withdrawal of diagnoses."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fjh.rig import Rig
from fjh.rig.events import Event
from fjh.rig.hexapod.rig import hexapod_rig
from ftc import Goal, Measurement
from ftc.fdi import Cause, Diagnosis, Fault, fault_model
from sim import Failure
from tests.ftc.hexapod import (
    DESIRED,
    DITHER,
    LSB_PERCENT,
    Script,
    diagnosis,
    pointing_of,
    reading,
    supervised,
    supervisor,
)

FADE = 500
"""Ticks of a handover."""


def goal_of(state) -> Goal:
    return state.current.mapping.goal


def after(state) -> int:
    """Return the number of confirmed failures of this state's monitor."""
    return state.monitor.after


def displacements(states) -> np.ndarray:
    """Return the commanded displacements (N, 6)."""
    drives = supervisor().first.drives
    return np.array([drives.displacements(state.inputs) for state in states])


def test_a_supervisor_reports_a_lost_task():
    controller = supervisor()
    locked = [Fault(k, "locked") for k in (0, 3, 1)]
    assert controller.is_possible(locked)
    # Struts 3 and 6 act in the same direction.
    assert not controller.is_possible([*locked, Fault(4, "locked")])
    assert controller.is_possible([Fault(k, "weak", 0.5) for k in range(6)])


def test_the_last_confirmed_diagnosis_of_an_actuator_is_active():
    weak, locked = diagnosis(Fault(1, "weak", 0.5)), diagnosis(Fault(1, "locked"), 3e-6)
    assert replace(supervisor().start(), confirmed=(weak, locked)).active_diagnoses == [locked]


def test_isolated_failures_reconfigure_and_confirmed_ones_remain():
    """The goal after a second failure has both, and the monitor continues from the first."""
    isolated = diagnosis(Fault(1, "locked"), 3e-6)
    settled, other = replace(isolated, confirmed=True), diagnosis(Fault(4, "free"), 1e-6)
    healthy, first, known, both = supervised(None, isolated, settled, other)
    assert healthy.current is supervisor().first and healthy.diagnoses == ()
    assert goal_of(first).locked_at == goal_of(known).locked_at == {1: 3e-6}
    assert (first.confirmed, first.diagnoses, after(first)) == ((), (isolated,), 0)
    assert (known.confirmed, known.diagnoses, after(known)) == ((settled,), (isolated, settled), 1)
    assert goal_of(both).locked_at == {1: 3e-6, 4: 0.0}
    assert (both.confirmed, both.active_diagnoses) == ((settled,), [settled, other])
    assert [state.ticks for state in (healthy, first, known, both)] == [1, 2, 3, 4]


def test_a_withdrawn_diagnosis_restores_the_controller():
    isolated = diagnosis(Fault(1, "locked"), 3e-6)
    _, withdrawn = supervised(isolated, None)
    assert goal_of(withdrawn) == supervisor().first.mapping.goal
    assert (withdrawn.diagnoses, withdrawn.confirmed, after(withdrawn)) == ((isolated,), (), 0)


def test_the_others_compensate_at_once_for_an_isolated_actuator():
    (commanded_m,) = displacements(supervised(None))
    (now_m,) = displacements(supervised(diagnosis(Fault(2, "free"), float(commanded_m[2]))))
    assert now_m[2] == commanded_m[2] and abs(commanded_m[2]) > 1e-6
    now_m[2] = 0.0  # the failed actuator loses its command
    np.testing.assert_allclose(pointing_of(now_m), pointing_of(commanded_m), atol=6e-8)


def test_without_a_diagnosis_the_supervisor_is_its_controller_to_the_bit():
    controller = supervisor(DITHER)
    state = replace(controller.start(), monitor=Script((None,) * 9))
    alone = controller.first.start()
    for tick in range(9):
        seen = reading(DESIRED * (0.5 + tick / 9))
        state = controller.step(state, DESIRED, seen)
        alone = controller.first.step(alone, DESIRED, seen, DITHER.at(tick * 1e-3))
        np.testing.assert_array_equal(state.inputs, alone.inputs)


def test_commands_are_constant_while_the_task_is_lost():
    """The task is lost with four locked struts, after confirmation of the last one."""
    locked = [diagnosis(Fault(k, "locked"), confirmed=True) for k in (0, 3, 1)]
    last = diagnosis(Fault(4, "locked"))
    again = diagnosis(Fault(0, "weak", 1.0), confirmed=True)
    states = supervised(*locked, last, replace(last, confirmed=True), None, again, None)
    assert [state.task_lost for state in states] == [False] * 4 + [True] * 2 + [False] * 2
    assert states[3].current is states[2].current
    for state in states[4:6]:
        np.testing.assert_array_equal(state.inputs, states[3].inputs)
        assert state.current is states[2].current
    assert states[4].confirmed[-1].fault == last.fault and states[4].monitor_state.diagnosis is None
    assert [after(state) for state in states] == [1, 2, 3, 3, 4, 4, 5, 5]
    assert set(goal_of(states[7]).locked_at) == {1, 3, 4}


@pytest.mark.parametrize(("kind", "is_retained"), [("locked", True), ("free", False)])
def test_a_locked_actuator_keeps_its_command_and_a_free_one_loses_it(kind, is_retained):
    """The inputs do not jump when the lock opens or the force returns."""
    isolated = diagnosis(Fault(2, kind), 3e-6)
    confirmed = replace(isolated, confirmed=True)
    script = (*(None,) * 5, *(isolated,) * FADE, confirmed, *(None,) * FADE)
    command = displacements(supervised(*script))[:, 2]
    assert abs(command[4]) > 1e-6
    assert np.abs(np.diff(command[5:])).max() < 0.01 * abs(command[4]) + 1e-8
    assert command[-1] == (command[5] if is_retained else 0.0)


@pytest.mark.parametrize("confirmed", [False, True])
def test_a_recovered_actuator_is_used_after_confirmation(confirmed):
    again = diagnosis(Fault(2, "weak", 1.0))
    last = replace(again, confirmed=True) if confirmed else None
    *_, waits, last = supervised(diagnosis(Fault(2, "free"), confirmed=True), again, last)
    assert waits.current.mapping.unused[2] and last.current.mapping.unused[2] != confirmed
    assert bool(last.active_diagnoses) != confirmed


def test_an_actuator_out_of_use_gets_a_quarter_of_the_dither():
    """A recovery is detected by this motion with little disturbance of the task."""
    failed = diagnosis(Fault(2, "free"), confirmed=True)
    about = replace(DITHER, offset=(1e-5,) * 6)
    script = (*(None,) * 5, failed, *(None,) * (FADE + 100))
    last = displacements(supervised(*script, dither=about))[-100:, 2]
    assert np.ptp(last) == pytest.approx(2 * 0.25 * DITHER.amplitude, rel=0.1)
    assert abs(last.mean()) < 1e-8


def pointing(*script: Diagnosis | None) -> np.ndarray:
    """Return the pointing (N, 2) of the linear healthy machine with scripted diagnoses."""
    nominal, controller = hexapod_rig().nominal, supervisor()
    model, x = fault_model(nominal), np.zeros(12)
    state, seen = replace(controller.start(), monitor=Script(script)), []
    for _ in script:
        y = nominal.noise * (model.C @ x)
        state = controller.step(state, DESIRED, reading(y))
        x = model.A @ x + model.B @ controller.first.drives.displacements(state.inputs)
        seen.append(y)
    return np.array(seen)


@cache
def undisturbed(ticks: int) -> np.ndarray:
    return pointing(*(None,) * ticks)


@pytest.mark.parametrize("strut", [1, *(pytest.param(k, marks=pytest.mark.long) for k in (2, 5))])
def test_a_wrong_diagnosis_hardly_moves_the_pointing(strut):
    """The pointing moves by less than 2 urad; the fading command corresponds to 30 or more."""
    wrong = diagnosis(Fault(strut, "free"))
    script = (None,) * 600 + (wrong,) * 400 + (replace(wrong, confirmed=True),) + (None,) * 600
    change = 1e6 * np.abs(pointing(*script) - undisturbed(len(script)))
    assert 0 < change.max() < 2


def test_the_status_describes_diagnosis_and_reaction():
    start, locked = supervisor().start(), Diagnosis.known(Fault(2, "locked"), 1e-6)
    again = Diagnosis.known(Fault(2, "weak", 1.0))
    confirmed = replace(start, confirmed=(locked,))
    assert replace(start, confirmed=(locked, again)).status == start.status

    def with_monitor(state, **changed):
        return replace(state, monitor_state=replace(state.monitor_state, **changed))

    unconfirmed = replace(locked, confirmed=False, kinds=("locked", "free"))
    for state, text in (
        (start, "assumed healthy"),
        (confirmed, "strut3 is locked; the other actuators perform the task"),
        (with_monitor(start, diagnosis=unconfirmed), "strut3 is locked or free, not yet confirmed"),
        (replace(confirmed, task_lost=True), "the major task is lost"),
        (replace(confirmed, rejected=locked), "expected to give a smaller error"),
        (with_monitor(confirmed, diagnosis=replace(again, confirmed=False)), "seems to work again"),
        (with_monitor(start, relearns=3), "learned as part of the machine"),
        (with_monitor(start, causes=(None,)), "by a slow disturbance, which is no failure"),
        (with_monitor(start, causes=(Cause("offset", 3),)), "an offset of the command of strut4"),
        (with_monitor(start, causes=(Cause("supply"),)), "a change of the gain of all commands"),
        (with_monitor(start, causes=(Cause("scale"),)), "a change of the scale of all sensors"),
    ):
        assert text in state.status


@cache
def rig(seed: int | None = None) -> Rig:
    return Rig.hexapod() if seed is None else Rig.hexapod(mismatch="all", seed=seed)


@pytest.mark.long
def test_a_recovered_actuator_is_used_again_without_a_step():
    path, opens = rig(3).path("circle", duration_s=6.0), [Event("lock_released", 1.3, 1)]
    run = rig(3).fly(rig(3).supervisor(), path, events=opens)
    isolated = run.diagnoses[0]
    assert isolated.actuator == "strut2" and isolated.withdrawn_s is not None
    assert 2.4 < isolated.withdrawn_s < 3.4  # a second to confirm it
    assert 1 not in [each.fault.actuator for each in run.state.active_diagnoses]
    assert not run.state.current.mapping.unused[1]
    back = round(isolated.withdrawn_s / rig(3).period_s)
    steps = np.abs(np.diff(run.inputs, axis=0)).max(axis=1)
    assert steps[back - 1 : back + 2].max() < 3 * np.quantile(steps[: back - 200], 0.99)


@pytest.mark.long
def test_a_calibration_lets_an_early_failure_be_isolated():
    """A lock 0.3 s after the start is isolated within 0.3 s; otherwise it would be learned."""
    own = rig(5)
    controller = own.supervisor()
    learned = own.fly(controller, own.path("circle", duration_s=2.0), seed=1).state
    path, lock = own.path("circle", duration_s=1.2), [Failure(3, "locked", 0.3)]
    seen = own.fly(controller.calibrated(learned), path, failures=lock).diagnoses
    assert [each.actuator for each in seen] == ["strut4"] and seen[0].time_s < 0.6
    assert not own.fly(controller, path, failures=lock).diagnoses
    again = own.fly(controller.calibrated(learned), path)
    assert not again.diagnoses and not again.state.monitor_state.alarm_ticks
    with pytest.raises(ValueError, match=r"^state must be of a run without a failure, longer than"):
        controller.calibrated(controller.start())
    failed = [Failure(3, "locked", 1.1)]
    run = own.fly(controller, own.path("circle", duration_s=1.5), failures=failed)
    with pytest.raises(ValueError, match=r"got: strut4 is locked"):
        controller.calibrated(run.state)


@cache
def controllers():
    """Return supervisors of the same and of another goal."""
    other = rig().supervisor(goal=Goal(joint_weight=(2.0, 1.0, 2.0, 1.0, 2.0, 1.0)))
    return {"same goal": rig().supervisor(), "another goal": other}


@cache
def after_a_lock():
    """Return a state 0.15 s after a lock, and reference and reading of the next tick."""
    path = rig().path("circle", duration_s=1.05)
    run = rig().fly(controllers()["same goal"], path, failures=[Failure(3, "locked", 0.9)])
    assert [each.fault.actuator for each in run.state.active_diagnoses] == [3]
    return run.state, path[-1], reading(run.measured[-1])


@pytest.mark.parametrize("name", ["same goal", "another goal"])
def test_a_supervisor_takes_over_the_diagnoses_without_a_jump(name):
    """The reference is the tick of the previous supervisor."""
    controller, (state, reference, seen) = controllers()[name], after_a_lock()
    transferred = controller.transfer(state)
    for each in ("active_diagnoses", "diagnoses", "confirmed", "withdrawn", "ticks", "task_lost"):
        assert getattr(transferred, each) == getattr(state, each), each
    assert transferred.monitor_state is state.monitor_state and transferred.sensors is state.sensors
    assert 3 in goal_of(transferred).locked_at
    assert goal_of(transferred).joint_weight == controller.first.mapping.goal.joint_weight
    change = controller.step(transferred, reference, seen).inputs
    change = change - controllers()["same goal"].step(state, reference, seen).inputs
    # The first tick of the fade, and the quantization of the converters.
    assert np.abs(np.delete(change, 3)).max() <= 2 * LSB_PERCENT


def test_after_a_controller_the_spectrum_is_learned_without_a_step():
    path, controller = rig().path("circle", duration_s=0.3), rig().controller()
    run, other = rig().fly(controller, path), controllers()["another goal"]
    taken_over = other.transfer(run.state)
    assert taken_over.is_learning and taken_over.ticks == 0
    assert not taken_over.diagnoses and not taken_over.active_diagnoses
    assert taken_over.current is other.first
    seen = Measurement(run.measured[-1], np.zeros(6))
    continued = controller.step(run.state, path[-1], seen).inputs
    change = other.step(taken_over, path[-1], seen).inputs - continued
    assert np.abs(change).max() <= 1.5 * LSB_PERCENT
