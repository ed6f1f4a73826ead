"""Bumpless transfer between mappings, and commands of actuators out of use."""

from dataclasses import replace

import control
import numpy as np
import pytest

from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.detector import pointing_angles
from ftc import (
    DirectDrive,
    Goal,
    LocalGeometry,
    LoopShape,
    Measurement,
    PrioritizedController,
    PrioritizedMapping,
    Stage,
    compensator,
    steps,
)
from ftc.control import DisplacementForm, UnstableLoop
from ftc.controller import ControllerState
from ftc.fdi.fault_model import FaultModel
from prioritized import ConstrainedSystem
from tests.ftc.hexapod import (
    DESIRED,
    EQUAL,
    FADE,
    LSB_PERCENT,
    controller,
    displaced_state,
    jacobian,
    pointing_of,
    pulled,
    reading,
    steady,
)
from tests.ftc.small_stage import PERIOD_S, stage

GOALS = {
    "W_b": Goal(joint_weight=(2.0, 1.0, 2.0, 1.0, 2.0, 1.0)),
    "W_e, one locked": Goal(secondary_weight=(10.0, 10.0, 1.0, 1.0), locked_at={2: -4e-6}),
    "locked off centre": Goal(joint_weight=(1.0,) * 6, locked_at={0: 4e-6}),
    "W_e, two locked": Goal(secondary_weight=(10.0, 10.0, 1.0, 1.0), locked_at={1: -3e-6, 3: 1e-6}),
}
WITHOUT_2 = replace(EQUAL, locked_at={2: 0.0})
ALL = np.ones(6)


@pytest.mark.parametrize("form", ["absolute", "gauss_newton"])
@pytest.mark.parametrize("name", GOALS)
def test_a_change_of_the_mapping_is_bumpless_and_keeps_the_task(name, form):
    after, state = controller(GOALS[name], form), displaced_state(form)
    survivors = [k for k in range(6) if k not in GOALS[name].locked_at]
    sent, bare = state.inputs[survivors], steady(after, state, 1).inputs[survivors]
    if form == "absolute" or "locked" not in name:
        assert np.abs(bare - sent).max() > 20 * LSB_PERCENT
    state = first = steady(after, after.transfer(state), 1)
    # The first tick of the fade, and the quantization of the converters.
    assert np.abs(first.inputs[survivors] - sent).max() <= 1.5 * LSB_PERCENT
    if form != "absolute":
        return

    def surviving_m(state):
        return after.drives.displacements(state.inputs)[survivors]

    moved, J_m = [], jacobian()[np.ix_(MAJOR, survivors)]
    for _ in range(FADE):
        state = steady(after, state, 1)
        moved.append(surviving_m(state) - surviving_m(first))
    # Quantization of six struts, 10 nm each at most, through J_m.
    assert np.abs(moved @ J_m.T).max() < 6e-8
    for later in (state, steady(after, state, FADE)):
        own = after.mapping.displacements(later.previous_command.demand, later.pose)[survivors]
        np.testing.assert_allclose(surviving_m(later), own, atol=1.1e-8)
    if name != "locked off centre":  # the weakest of all struts is healthy
        assert np.abs(surviving_m(first) - own).max() > 1e-7


def test_a_transfer_during_a_transfer_and_with_a_dither_is_bumpless():
    first, second, third = map(controller, (EQUAL, GOALS["W_b"], GOALS["W_e, one locked"]))
    state = steady(second, second.transfer(displaced_state()), 100)
    then = steady(third, third.transfer(state), 1)
    assert np.delete(np.abs(then.inputs - state.inputs), 2).max() <= 2 * LSB_PERCENT
    shaken = np.array([2e-6, -1e-6, 3e-6, 0.0, 1e-6, -2e-6])
    state = pulled(first, shaken)
    then = steady(second, second.transfer(state), 1, shaken)
    assert np.abs(then.inputs - state.inputs).max() <= 1.5 * LSB_PERCENT


def test_the_command_of_a_known_weak_actuator_is_scaled():
    """A doubled command at half the force gives the same displacement, pose and transfer."""
    aware = controller(replace(EQUAL, effectiveness={4: 0.5}))
    expected, state = displaced_state(), pulled(aware)
    twice = expected.inputs * [1, 1, 1, 1, 2, 1]
    np.testing.assert_allclose(state.inputs, twice, atol=2 * LSB_PERCENT)
    assert abs(state.inputs[4]) > 40 * LSB_PERCENT
    # Quantization of six struts, 20 nm each at most, through J.
    result, same = state.pose, expected.pose
    np.testing.assert_allclose(result.translation_m, same.translation_m, atol=4e-8)
    angles = pointing_angles(result.rotation), pointing_angles(same.rotation)
    np.testing.assert_allclose(*angles, atol=2e-7)
    transfer = aware.transfer(state).bumpless_transfer
    assert transfer is not None
    np.testing.assert_allclose(transfer.demand, 0, atol=2e-7)
    np.testing.assert_allclose(transfer.secondary_reference, 0, atol=4e-8)


LOST = {"locked": Goal(EQUAL.joint_weight, locked_at={2: -4e-6}), "without force": WITHOUT_2}


def moving(controller, state: ControllerState, ticks: int) -> list[ControllerState]:
    """Return the states while the detector reads random errors."""
    rng, states = np.random.default_rng(0), []
    for _ in range(ticks):
        seen = reading(DESIRED * rng.uniform(0.8, 1.2))
        state = controller.step(state, DESIRED, seen, 1e-6 * jacobian()[0])
        states.append(state)
    return states


@pytest.mark.parametrize(
    ("name", "form"),
    [
        *((name, form) for name in LOST for form in ("absolute", "gauss_newton")),
        ("without force", "incremental"),  # locks off centre have no incremental form
    ],
)
def test_a_retained_command_stays_to_the_bit(name, form: DisplacementForm):
    """The command does not depend on the other commands, the time, or a second transfer."""
    after, state = controller(LOST[name], form), displaced_state(form)
    later = moving(after, after.transfer(state, retained=ALL), FADE + 20)
    later += moving(after, after.transfer(later[-1], retained=ALL), 5)
    assert abs(state.inputs[2]) > 20 * LSB_PERCENT
    assert all(each.inputs[2] == state.inputs[2] for each in later)
    assert np.ptp([each.inputs[0] for each in later]) > 20 * LSB_PERCENT


@pytest.mark.parametrize("form", ["absolute", "gauss_newton", "incremental"])
def test_another_command_fades_as_half_a_cosine(form: DisplacementForm):
    after = controller(WITHOUT_2, form)
    retained_state = moving(after, after.transfer(displaced_state(form), retained=ALL), 50)[-1]
    fading = moving(after, after.transfer(retained_state), FADE + 10)
    expected = 0.5 * (1 + np.cos(np.pi * np.minimum(np.arange(FADE + 10) / FADE, 1)))
    result = np.array([each.inputs[2] for each in fading]) / retained_state.inputs[2]
    np.testing.assert_allclose(result, expected, atol=LSB_PERCENT / abs(retained_state.inputs[2]))
    assert fading[-1].inputs[2] == 0.0


@pytest.mark.parametrize("remaining", [0.0, 0.3, 1.0])
def test_the_others_take_over_the_remaining_effect_of_a_weak_actuator(remaining):
    """The weak one and the others produce the same static task at each tick of the transfer."""
    after, start, second = controller(WITHOUT_2), displaced_state(), np.arange(6) == 2
    u = after.drives.displacements(start.inputs)
    lost = np.where(second, (1 - remaining) * u, 0.0)  # at the onset of the failure
    caused, state = [], after.transfer(start, lost, np.where(second, remaining, 0.0))
    for _ in range(FADE + 2):
        state = steady(after, state, 1)
        sent = after.drives.displacements(state.inputs)
        caused.append(pointing_of(np.where(second, remaining * sent, sent)))
    assert state.inputs[2] == 0.0
    np.testing.assert_allclose(caused, [pointing_of(u)] * len(caused), atol=8e-8)


def test_a_second_failure_while_the_first_one_fades_moves_nothing():
    """The rest of the first command fades with the second, unless both are retained."""
    first, second = controller(WITHOUT_2), controller(replace(EQUAL, locked_at={2: 0.0, 5: 0.0}))
    acting = np.array([0, 0, 0.3, 0, 0, 0.4])
    state = displaced_state()
    half = steady(first, first.transfer(state, acting=acting), FADE // 2 + 1)
    retained_state = steady(second, second.transfer(half, retained=ALL), 2 * FADE)
    last = steady(second, second.transfer(retained_state, acting=acting), FADE + 2)
    states = [half, retained_state, last]
    remaining = np.where(acting, acting, 1.0)
    caused = [pointing_of(remaining * second.drives.displacements(each.inputs)) for each in states]
    np.testing.assert_allclose(caused, [caused[0]] * 3, atol=8e-8)
    assert states[1].inputs[2] == pytest.approx(0.5 * state.inputs[2], abs=0.01 * state.inputs[2])
    assert states[2].inputs[[2, 5]].tolist() == [0.0, 0.0]


def tied_controller(system: ConstrainedSystem, goal: Goal, *form) -> PrioritizedController:
    mapping = PrioritizedMapping(LocalGeometry(system), goal, [0], [1], *form)
    loop = control.ss([[1.0]], [[0.01]], [[5.0]], [[0.0]], 0.01)
    return PrioritizedController([loop], mapping, DirectDrive(), handover_s=1.0)


@pytest.mark.parametrize("form", ["absolute", "incremental"])
def test_an_inadmissible_displacement_fades_once(form):
    """A second transfer during the first one continues it, for actuators tied by a loop."""
    tied = ConstrainedSystem(np.eye(2, 3), np.array([[1.0, -1.0, 0.0]]), np.arange(3))
    controller = tied_controller(tied, Goal((1.0,) * 3), form)
    state = controller.transfer(replace(controller.start(), inputs=np.array([0.5, -0.5, 0.0])))
    difference, still = [], Measurement(np.zeros(1), np.zeros(3))
    for tick in range(160):
        state = controller.transfer(state) if tick == 50 else state
        state = controller.step(state, np.zeros(1), still)
        difference.append(state.inputs[0] - state.inputs[1])
    assert difference[0] == pytest.approx(1.0) and difference[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(np.diff(difference)).max() < 0.02


@pytest.mark.parametrize("seed", range(5))
def test_a_free_actuator_in_closed_loops_is_commanded_to_its_position(seed):
    """The servo then agrees with the others, even if it is healthy or works again."""
    rng = np.random.default_rng(seed)
    C = rng.normal(size=(1, 4))
    system = ConstrainedSystem(rng.normal(size=(2, 4)), C, np.arange(4))
    controller = tied_controller(system, Goal((1.0,) * 4, free=(2,)))
    state = controller.transfer(replace(controller.start(), inputs=rng.normal(size=4)))
    for tick in range(160):
        state = controller.step(state, np.ones(1), Measurement(np.zeros(1), np.zeros(4)))
        if tick == 0:  # its previous command is still fading
            assert abs(C @ state.inputs) > 1e-3
    np.testing.assert_allclose(C @ state.inputs, 0, atol=1e-9)
    assert abs(state.inputs[2]) > 1e-2 and controller.mapping.followed(np.zeros(4)) is not None


def test_the_stepped_loop_is_the_linear_one_of_python_control():
    own, gain = stage(), stage().mapping().major_gain()
    P = control.c2d(own.plant, PERIOD_S, "zoh")
    model = FaultModel(P.A, P.B, P.C, np.eye(P.nstates), np.zeros(P.nstates))
    reference = 1e-3 * np.random.default_rng(0).normal(size=(800, 2)).cumsum(axis=0)
    ticks = steps([Stage(model, gain=gain)], P.C, [own.loop] * 2, reference)
    L = P * control.ss([], [], [], gain, PERIOD_S) * control.append(*[own.loop.discrete] * 2)
    T, time_s = control.feedback(L, np.eye(2)), PERIOD_S * np.arange(len(reference))
    expected = np.asarray(control.forced_response(T, time_s, reference.T).outputs).T
    result = [tick.output for tick in ticks]
    np.testing.assert_allclose(result, expected, rtol=1e-8, atol=1e-12)
    assert np.linalg.norm(reference - expected) < 0.7 * np.linalg.norm(reference)


def test_an_unstable_crossover_is_rejected():
    with pytest.raises(UnstableLoop, match="must leave the loop stable, got 80 Hz"):
        compensator(stage().channel, LoopShape(80.0, 400.0, 0.7), PERIOD_S)
