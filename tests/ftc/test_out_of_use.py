"""An actuator that is taken out of use: its command stays or fades, and the others take over."""

from dataclasses import replace

import control
import numpy as np
import pytest

from ftc import (
    DirectDrive,
    Goal,
    LocalGeometry,
    Measurement,
    PrioritizedController,
    PrioritizedMapping,
)
from ftc.control import DisplacementForm
from ftc.controller import ControllerState
from ftc.fdi import Dither, Fault, fault_model
from prioritized import ConstrainedSystem
from tests.ftc.test_handover import (
    BENCH,
    DESIRED,
    DITHER,
    EQUAL,
    LSB_PERCENT,
    MAJOR,
    PILOT,
    RIG,
    SOUND,
    J,
    Script,
    controller,
    diagnosis,
    pulled,
    steady,
    supervised,
)

WITHOUT_2 = replace(EQUAL, locked_at={2: 0.0})
ALL = np.ones(6)
FADE = round(BENCH.handover_s / BENCH.control_period_s)
LOST = {"locked": Goal(EQUAL.joint_weight, locked_at={2: -4e-6}), "without force": WITHOUT_2}


def moving(pilot, state: ControllerState, ticks: int) -> list[ControllerState]:
    """States while the detector reads errors of another size at each tick."""
    rng, states = np.random.default_rng(0), []
    for _ in range(ticks):
        reading = DESIRED * rng.uniform(0.8, 1.2)
        state = pilot.step(state, DESIRED, Measurement(reading, np.zeros(6)), 1e-6 * J[0])
        states.append(state)
    return states


@pytest.mark.parametrize(
    ("name", "form"),
    [
        *((name, form) for name in LOST for form in ("absolute", "gauss_newton")),
        ("without force", "incremental"),  # a lock off centre has no incremental form
    ],
)
def test_a_command_that_is_kept_stays_to_the_bit(name, form: DisplacementForm):
    """Whatever the others do, for longer than a handover takes; a second transfer keeps it, too."""
    before, after = controller(EQUAL, form), controller(LOST[name], form)
    state = pulled(before)
    later = moving(after, after.transfer(state, keeps=ALL), FADE + 20)
    later += moving(after, after.transfer(later[-1], keeps=ALL), 5)
    assert abs(state.inputs[2]) > 20 * LSB_PERCENT
    assert all(each.inputs[2] == state.inputs[2] for each in later)
    assert np.ptp([each.inputs[0] for each in later]) > 20 * LSB_PERCENT


@pytest.mark.parametrize("form", ["absolute", "gauss_newton", "incremental"])
def test_another_falls_to_zero_as_half_a_cosine(form: DisplacementForm):
    before, after = controller(EQUAL, form), controller(WITHOUT_2, form)
    kept = moving(after, after.transfer(pulled(before), keeps=ALL), 50)[-1]
    fading = moving(after, after.transfer(kept), FADE + 10)
    expected = 0.5 * (1 + np.cos(np.pi * np.minimum(np.arange(FADE + 10) / FADE, 1)))
    found = np.array([each.inputs[2] for each in fading]) / kept.inputs[2]
    np.testing.assert_allclose(found, expected, atol=LSB_PERCENT / abs(kept.inputs[2]))
    assert fading[-1].inputs[2] == 0.0


@pytest.mark.parametrize("left", [0.0, 0.3, 1.0])
def test_the_others_take_over_what_a_weak_actuator_still_did(left):
    """Statics: they and what is left of its force cause the same major task, tick by tick."""
    before, after = controller(EQUAL), controller(WITHOUT_2)
    acting = np.where(np.arange(6) == 2, left, 0.0)
    start = pulled(before)
    u = before.drives.displacements(start.inputs)
    lost = np.where(np.arange(6) == 2, (1 - left) * u, 0.0)  # at the very moment of the failure
    caused, state = [], after.transfer(start, lost, acting)
    for _ in range(FADE + 2):
        state = steady(after, state, 1)
        sent = after.drives.displacements(state.inputs)
        caused.append(J[MAJOR] @ np.where(np.arange(6) == 2, left * sent, sent))
    assert state.inputs[2] == 0.0
    # Six struts' last bits, 10 nm each at most, through J_m.
    np.testing.assert_allclose(caused, [J[MAJOR] @ u] * len(caused), atol=8e-8)


@pytest.mark.parametrize("form", ["absolute", "incremental"])
def test_what_no_motion_follows_fades_once_whatever_is_transferred_meanwhile(form):
    """Of actuators tied by a loop: a second handover, half way, continues the first one."""
    tied = ConstrainedSystem(np.eye(2, 3), np.array([[1.0, -1.0, 0.0]]), np.arange(3))
    mapping = PrioritizedMapping(LocalGeometry(tied), Goal((1.0,) * 3), [0], [1], form)
    loop = control.ss([[1.0]], [[0.01]], [[5.0]], [[0.0]], 0.01)
    pilot = PrioritizedController([loop], mapping, DirectDrive(), handover_s=1.0)
    state = pilot.transfer(replace(pilot.start(), inputs=np.array([0.5, -0.5, 0.0])))
    apart, still = [], Measurement(np.zeros(1), np.zeros(3))
    for tick in range(160):
        state = pilot.step(pilot.transfer(state) if tick == 50 else state, np.zeros(1), still)
        apart.append(state.inputs[0] - state.inputs[1])
    assert apart[0] == pytest.approx(1.0) and apart[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(np.diff(apart)).max() < 0.02


def test_a_second_failure_while_the_first_one_fades_moves_nothing():
    """What is left of the first command fades with the second, unless both are kept."""
    first, second = controller(WITHOUT_2), controller(replace(EQUAL, locked_at={2: 0.0, 5: 0.0}))
    acting = np.array([0, 0, 0.3, 0, 0, 0.4])
    state = pulled(controller(EQUAL))
    half = steady(first, first.transfer(state, acting=acting), FADE // 2)
    kept = steady(second, second.transfer(half, keeps=ALL), 2 * FADE)
    states = [half, kept, steady(second, second.transfer(kept, acting=acting), FADE + 2)]
    caused = [
        J[MAJOR] @ (np.where(acting, acting, 1.0) * second.drives.displacements(each.inputs))
        for each in states
    ]
    np.testing.assert_allclose(caused, [caused[0]] * 3, atol=8e-8)
    assert states[1].inputs[2] == pytest.approx(0.5 * state.inputs[2], abs=0.01 * state.inputs[2])
    assert states[2].inputs[[2, 5]].tolist() == [0.0, 0.0]


def pointing(*says) -> np.ndarray:
    """Pointing (N, 2) of the linear sound machine under a monitor that says this, from far out."""
    model, pilot = fault_model(SOUND), PILOT
    state, x = pilot.start(), np.zeros(12)
    state, seen = replace(state, monitor=Script(says)), []
    for _ in says:
        y = SOUND.noise * (model.C @ x)
        state = pilot.step(state, DESIRED, Measurement(y, np.zeros(6)))
        x = model.A @ x + model.B @ pilot.first.drives.displacements(state.inputs)
        seen.append(y)
    return np.array(seen)


@pytest.mark.parametrize("strut", [1, 2, 5])
def test_a_wrong_name_of_a_sound_strut_hardly_moves_the_pointing(strut):
    """By less than 2 urad, where its command, which fades, is worth 30 and more."""
    wrong = diagnosis(Fault(strut, "free"))
    says = (None,) * 600 + (wrong,) * 400 + (replace(wrong, confirmed=True),) + (None,) * 600
    change = 1e6 * np.abs(pointing(*says) - pointing(*(None,) * len(says)))
    assert 0 < change.max() < 2


def sent(*says, dither: Dither | None = None) -> np.ndarray:
    """Displacements (N, 6) commanded under a monitor that says this, from far out."""
    pilot = RIG.supervisor(dither)
    begun = pilot.start()
    state, seen = replace(begun, controller=pulled(begun.current), monitor=Script(says)), []
    for tick in range(len(says)):  # a sensor that repeats itself to the bit is stuck
        reading = DESIRED * (1 + 1e-9 * (tick % 2))
        state = pilot.step(state, DESIRED, Measurement(reading, np.zeros(6)))
        seen.append(pilot.first.drives.displacements(state.inputs))
    return np.array(seen)


@pytest.mark.parametrize(("kind", "keeps"), [("locked", True), ("free", False)])
def test_one_that_stands_keeps_its_command_for_good_and_one_without_force_loses_it(kind, keeps):
    """So that nothing jumps, whenever the lock opens or the force returns."""
    named = diagnosis(Fault(2, kind), 3e-6)
    says = (None,) * 5 + (named,) * FADE + (replace(named, confirmed=True),) + (None,) * FADE
    command = sent(*says)[:, 2]
    assert abs(command[4]) > 1e-6
    assert np.abs(np.diff(command[5:])).max() < 0.01 * abs(command[4]) + 1e-8
    assert command[-1] == (command[5] if keeps else 0.0)


def test_one_that_seems_to_work_again_stays_out_of_use_until_that_is_confirmed():
    failed = replace(diagnosis(Fault(2, "free")), confirmed=True)
    again = diagnosis(Fault(2, "weak", 1.0))
    taken_back = (failed, again, None)
    given_back = (failed, again, replace(again, confirmed=True))
    for says, unused in ((taken_back, True), (given_back, False)):
        *_, waits, last = supervised(*says)
        assert waits.current.mapping.unused[2] and last.current.mapping.unused[2] == unused
        assert bool(last.standing) == unused


def test_one_out_of_use_gets_a_quarter_of_the_dither_and_none_of_the_posture():
    """One that works again is seen by it, and hardly felt before the others know."""
    failed = replace(diagnosis(Fault(2, "free")), confirmed=True)
    about = replace(DITHER, offset=(1e-5,) * 6)
    command = sent(*(None,) * 5, failed, *(None,) * (FADE + 200), dither=about)
    last = command[-200:, 2]
    assert np.ptp(last) == pytest.approx(2 * 0.25 * DITHER.amplitude, rel=0.1)
    assert abs(last.mean()) < 1e-8


@pytest.mark.parametrize("seed", range(5))
def test_one_that_closed_loops_take_along_is_commanded_where_they_take_it(seed):
    """Then its servo and the others agree, whether it is free, sound after all, or works again."""
    rng = np.random.default_rng(seed)
    C = rng.normal(size=(1, 4))
    system = ConstrainedSystem(rng.normal(size=(2, 4)), C, np.arange(4))
    goal = Goal((1.0,) * 4, free=(2,))
    mapping = PrioritizedMapping(LocalGeometry(system), goal, [0], [1])
    loop = control.ss([[1.0]], [[0.01]], [[5.0]], [[0.0]], 0.01)
    pilot = PrioritizedController([loop], mapping, DirectDrive(), handover_s=1.0)
    state = pilot.transfer(replace(pilot.start(), inputs=rng.normal(size=4)))
    for tick in range(160):
        state = pilot.step(state, np.ones(1), Measurement(np.zeros(1), np.zeros(4)))
        if tick == 0:  # before that what it was commanded fades
            assert abs(C @ state.inputs) > 1e-3
    np.testing.assert_allclose(C @ state.inputs, 0, atol=1e-9)
    assert abs(state.inputs[2]) > 1e-2 and mapping.followed(np.zeros(4)) is not None
