"""One mapping takes over from another in flight: no strut command steps, no pointing is lost."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import StrutMapping, controller_for
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.fault_tolerance import HEAVE
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc import Goal, Measurement, PrioritizedController, goal_after
from ftc.control import DisplacementForm
from ftc.controller import BumplessTransfer
from ftc.fdi import Diagnosis, Dither, Fault, fault_model
from ftc.reconfiguration import lost_displacement
from sim import NOMINAL, Failure

BENCH, RIG = TestbedConfig(), hexapod_rig()
DITHER = Dither(0.5e-6, 20.0, HEAVE)
EQUAL = Goal(joint_weight=(1.0,) * 6)
J = np.linalg.inv(hexapod(RIG.model).inverse_jacobian(NOMINAL))
DESIRED = np.array([6e-5, -3e-5])
LSB_PERCENT = 100 / 2**15
SOUND = RIG.nominal
PILOT = RIG.supervisor(None)

GOALS = {
    "W_b": Goal(joint_weight=(2.0, 1.0, 2.0, 1.0, 2.0, 1.0)),
    "W_e, one locked": Goal(secondary_weight=(10.0, 10.0, 1.0, 1.0), locked_at={2: -4e-6}),
    "locked off centre": Goal(joint_weight=(1.0,) * 6, locked_at={0: 4e-6}),
    "W_e, two locked": Goal(secondary_weight=(10.0, 10.0, 1.0, 1.0), locked_at={1: -3e-6, 3: 1e-6}),
}


def controller(goal: Goal, form: DisplacementForm = "absolute") -> PrioritizedController:
    return controller_for(RIG.control.testbed, goal, jacobian="constant", form=form)


def steady(pilot, state, ticks: int, secondary_reference=None):
    """The compensators see no error: what they ask stands still."""
    for _ in range(ticks):
        state = pilot.step(state, DESIRED, Measurement(DESIRED, np.zeros(6)), secondary_reference)
    return state


def pulled(pilot, secondary_reference=None):
    """Some way out, by an error that lasts a tenth of a second."""
    state = pilot.start()
    for _ in range(100):
        state = pilot.step(
            state, DESIRED, Measurement(0.7 * DESIRED, np.zeros(6)), secondary_reference
        )
    return steady(pilot, state, 200, secondary_reference)


@pytest.mark.parametrize("form", ["absolute", "gauss_newton"])
@pytest.mark.parametrize("name", GOALS)
def test_no_surviving_strut_steps_when_the_mapping_changes(name, form):
    before, after = controller(EQUAL, form), controller(GOALS[name], form)
    state = pulled(before)
    survivors = [k for k in range(6) if k not in GOALS[name].locked_at]
    sent = state.inputs[survivors]
    bumpless = steady(after, after.transfer(state), 1).inputs[survivors]
    bare = steady(after, state, 1).inputs[survivors]
    # The first tick of the fade, and the converters' last bit.
    assert np.abs(bumpless - sent).max() <= 1.5 * LSB_PERCENT
    if form == "absolute" or "locked" not in name:
        assert np.abs(bare - sent).max() > 20 * LSB_PERCENT


@pytest.mark.parametrize("name", GOALS)
def test_what_is_left_of_the_former_mapping_fades_without_moving_the_pointing(name):
    before, after = controller(EQUAL), controller(GOALS[name])
    start = after.transfer(pulled(before))
    survivors = [k for k in range(6) if k not in GOALS[name].locked_at]

    def surviving_m(state):
        return after.drives.displacements(state.inputs)[survivors]

    first = steady(after, start, 1)
    pointing = J[np.ix_(MAJOR, survivors)] @ surviving_m(first)
    state = first
    for _ in range(round(BENCH.handover_s / BENCH.control_period_s)):
        state = steady(after, state, 1)
        now = J[np.ix_(MAJOR, survivors)] @ surviving_m(state)
        # Six struts' last bits, 10 nm each at most, through J_m.
        np.testing.assert_allclose(now, pointing, atol=6e-8)
    for later in (state, steady(after, state, round(BENCH.handover_s / BENCH.control_period_s))):
        own = after.mapping.displacements(later.asked.demand, later.pose)[survivors]
        np.testing.assert_allclose(surviving_m(later), own, atol=1.1e-8)
    if name != "locked off centre":  # the least of all struts is the least of those left, too
        assert np.abs(surviving_m(first) - own).max() > 1e-7


def test_the_former_secondary_motion_fades_as_half_a_cosine():
    """It begins and ends with no rate, so that no mode of the machine is struck."""
    after, secondary_reference = (
        controller(GOALS["W_b"]),
        np.array([1.0, 0, 0, -1.0, 0, 0]) * 1e-6,
    )
    still = np.zeros(6)
    start = BumplessTransfer(np.zeros(2), secondary_reference, still, still, np.zeros(2))
    for part, left in ((0.0, 1.0), (0.25, 0.5 + 0.125**0.5), (0.5, 0.5), (0.75, 0.5 - 0.125**0.5)):
        owed = replace(start, age_s=part * BENCH.handover_s)
        state = steady(after, replace(after.start(), bumpless_transfer=owed), 1)
        np.testing.assert_allclose(
            state.asked.secondary_reference, left * secondary_reference, atol=1e-20
        )
    for part in (1.0, 1.5):  # and does not come back
        owed = replace(start, age_s=part * BENCH.handover_s)
        state = steady(after, replace(after.start(), bumpless_transfer=owed), 1)
        np.testing.assert_array_equal(state.asked.secondary_reference, 0.0)


def test_a_handover_of_a_handover_owes_both():
    first, second, third = (
        controller(goal) for goal in (EQUAL, GOALS["W_b"], GOALS["W_e, one locked"])
    )
    state = steady(second, second.transfer(pulled(first)), 100)
    then = steady(third, third.transfer(state), 1)
    step = np.abs(then.inputs - state.inputs)
    assert np.delete(step, 2).max() <= 2 * LSB_PERCENT


def test_the_dither_goes_through_a_handover():
    secondary_reference = np.array([2e-6, -1e-6, 3e-6, 0.0, 1e-6, -2e-6])
    before, after = controller(EQUAL), controller(GOALS["W_b"])
    state = pulled(before, secondary_reference)
    then = steady(after, after.transfer(state), 1, secondary_reference)
    assert np.abs(then.inputs - state.inputs).max() <= 1.5 * LSB_PERCENT


def test_what_a_limp_strut_is_about_to_lose_the_others_make_up_for_at_once():
    before, after = controller(EQUAL), controller(Goal(EQUAL.joint_weight, locked_at={2: 0.0}))
    state = pulled(before)
    commanded_m = before.drives.displacements(state.inputs)
    lost_displacements = np.zeros(6)
    lost_displacements[2] = commanded_m[2]
    then = steady(after, after.transfer(state, lost_displacements), 1)
    now_m = after.drives.displacements(then.inputs)
    now_m[2] = 0.0
    np.testing.assert_allclose(J[MAJOR] @ now_m, J[MAJOR] @ commanded_m, atol=6e-8)


def test_a_weak_coil_that_is_known_is_commanded_the_more():
    weak = replace(EQUAL, effectiveness={4: 0.5})
    sound, aware = controller(EQUAL), controller(weak)
    secondary_reference = np.zeros(6)
    wanted = pulled(sound).inputs
    asked = pulled(aware).inputs
    np.testing.assert_allclose(asked[4], 2 * wanted[4], atol=2 * LSB_PERCENT)
    others = [0, 1, 2, 3, 5]
    np.testing.assert_allclose(asked[others], wanted[others], atol=LSB_PERCENT)
    state = sound.start()
    np.testing.assert_array_equal(
        sound.step(state, DESIRED, Measurement(DESIRED, secondary_reference)).inputs, 0.0
    )


def test_the_controller_reckons_with_what_a_weak_coil_holds_and_not_with_its_command():
    """Twice the command at half the strength is the same displacement, pose and handover."""
    sound, aware = controller(EQUAL), controller(replace(EQUAL, effectiveness={4: 0.5}))
    expected, state = pulled(sound), pulled(aware)
    # Six struts' last bits, 20 nm each at most, through J.
    found = state.pose.translation_m, pointing_angles(state.pose.rotation)
    same = expected.pose.translation_m, pointing_angles(expected.pose.rotation)
    np.testing.assert_allclose(found[0], same[0], atol=4e-8)
    np.testing.assert_allclose(found[1], same[1], atol=2e-7)
    assert np.abs(state.inputs[4] - expected.inputs[4]) > 20 * LSB_PERCENT
    owed = aware.transfer(state).bumpless_transfer
    assert owed is not None
    np.testing.assert_allclose(owed.demand, 0, atol=2e-7)
    np.testing.assert_allclose(owed.secondary_reference, 0, atol=4e-8)


@pytest.mark.long
def test_in_flight_the_switch_to_the_locked_mapping_is_not_felt():
    """Lock of strut 1 at 3 s, told at once, off centre: nothing but the lock itself."""
    failures, path = [Failure(0, "locked", 3.0)], BENCH.spiral_rad(3.3)
    fault_unaware = RIG.fly(RIG.controller(EQUAL), path, failures=failures)
    stuck_m = float(fault_unaware.displacement[3000, 0])
    told = RIG.reconfigured(EQUAL, Goal(EQUAL.joint_weight, locked_at={0: stuck_m}), 3.0)
    run = RIG.fly(told, path, failures=failures)
    error = 1e6 * np.linalg.norm(run.error, axis=1)
    assert error[3000:].max() < 1.3 * error[2500:3000].max()
    step = np.abs(np.diff(run.inputs[2990:3010], axis=0))[:, 1:]
    assert step.max() < 5 * LSB_PERCENT


# --- the supervisor


def diagnosis(fault: Fault, displacement_m=0.0, alarm=0, tick=10) -> Diagnosis:
    kinds = (fault.kind,)
    return Diagnosis(fault, kinds, 1.0, 1.0, displacement_m, alarm, alarm, tick, confirmed=False)


def test_what_stands_is_what_was_settled_last_and_what_is_being_confirmed():
    weak, locked = diagnosis(Fault(1, "weak", 0.5)), diagnosis(Fault(1, "locked"), 3e-6)
    other = diagnosis(Fault(4, "free"))
    state = PILOT.start()
    assert state.standing == []
    state = replace(state, confirmed=(weak, locked))
    assert state.standing == [locked]
    assert replace(state, watch=replace(state.watch, diagnosis=other)).standing == [locked, other]


def test_the_reconfigured_goal_says_what_is_known_of_each_strut():
    known = [
        diagnosis(Fault(0, "locked"), 3e-6),
        diagnosis(Fault(2, "free"), 9e-6),
        diagnosis(Fault(5, "weak", 0.6), 1e-6),
    ]
    goal = goal_after(EQUAL, known, SOUND, "locked")
    assert goal.locked_at == {0: 3e-6, 2: 0.0} and goal.effectiveness == pytest.approx({5: 0.6})
    assert goal.joint_weight == EQUAL.joint_weight
    commanded_m = np.full(6, 2e-6)
    locked, free, weak = (
        lost_displacement(SOUND, each, [each.fault], commanded_m) for each in known
    )
    np.testing.assert_array_equal(locked, 0.0)
    assert free[2] == pytest.approx(2e-6, rel=1e-2)  # no more than it was commanded
    assert weak[5] == 0.0  # it is already where it will be, or further


def test_a_weak_coil_is_commanded_more_with_care():
    """Twice as much at the most; what has less than half of its force is left alone."""
    commanded_m = np.full(6, 8e-6)
    most = diagnosis(Fault(5, "weak", 0.501), 4e-6)
    assert goal_after(EQUAL, [most], SOUND, "locked").effectiveness == pytest.approx({5: 0.501})
    np.testing.assert_array_equal(
        lost_displacement(SOUND, replace(most, confirmed=True), [most.fault], commanded_m), 0.0
    )
    gone = diagnosis(Fault(5, "weak", 0.4), 4e-6)
    assert goal_after(EQUAL, [gone], SOUND, "locked").locked_at == {5: 0.0}
    lost = lost_displacement(SOUND, gone, [gone.fault], commanded_m)
    assert lost[5] == pytest.approx(4e-6 - 0.4 * 8e-6, rel=1e-2)


def test_a_supervisor_is_a_pure_function_and_says_when_the_task_is_lost():
    pilot = RIG.supervisor(DITHER)
    state = pilot.start()
    measurement = Measurement(np.zeros(2), np.zeros(6))
    once, again = (pilot.step(state, DESIRED, measurement) for _ in range(2))
    np.testing.assert_array_equal(once.inputs, again.inputs)
    assert state.ticks == state.watch.ticks == 0
    locked = [Fault(k, "locked") for k in (0, 3, 1)]
    assert pilot.is_possible(locked)
    assert not pilot.is_possible([*locked, Fault(4, "locked")])  # struts 3 and 6 pull alike
    assert pilot.is_possible([Fault(k, "weak", 0.5) for k in range(6)])


def test_an_alarm_that_is_not_confirmed_leaves_no_trace_in_the_commands():
    """The detector jumps for a twentieth of a second: no strut is named, to the bit."""
    pilot, model = RIG.supervisor(DITHER), fault_model(SOUND)
    state, alone, rng = pilot.start(), pilot.first.start(), np.random.default_rng(0)
    x = np.zeros(len(model.A))
    for tick in range(1150):
        shock = 30 * rng.standard_normal(2) * (1000 <= tick < 1050)
        seen = (model.C @ x + rng.standard_normal(2) + shock) * SOUND.noise
        measurement = Measurement(seen, np.zeros(6))
        state = pilot.step(state, DESIRED, measurement)
        alone = pilot.first.step(alone, DESIRED, measurement, DITHER.at(tick * 1e-3))
        np.testing.assert_array_equal(state.inputs, alone.inputs)
        x = model.A @ x + model.B @ pilot.first.drives.displacements(alone.inputs)
    assert state.watch.alarm_ticks and state.watch.alarm_ticks[0] >= 1000
    assert (state.diagnoses, state.confirmed) == ((), ())
    assert state.current is pilot.first


@dataclass(frozen=True)
class Script:
    """A monitor that says what it is told to, tick after tick, and counts whom it came after."""

    says: tuple[Diagnosis | None, ...]
    after: int = 0
    nominal, ticks = SOUND, 1

    def step(self, watch, measured, commanded_m):
        """The next that it says."""
        return replace(watch, ticks=watch.ticks + 1, diagnosis=self.says[watch.ticks])

    def believing(self, watch):
        """Itself, one failure later."""
        return replace(self, after=self.after + 1), replace(watch, diagnosis=None)


def supervised(*says: Diagnosis | None):
    """The supervisor's states, tick by tick, under a monitor that says this."""
    pilot, begun = PILOT, PILOT.start()
    states = [replace(begun, controller=pulled(begun.current), monitor=Script(says))]
    for _ in says:
        states.append(pilot.step(states[-1], DESIRED, Measurement(DESIRED, np.zeros(6))))
    return states[1:]


def failures_before(state) -> int:
    """After how many settled failures this state's monitor watches."""
    return state.monitor.after


def test_what_is_named_is_flown_around_and_what_is_settled_is_known_for_good():
    """Another strut after it: both are flown around, and the monitor goes on from the first."""
    named = diagnosis(Fault(1, "locked"), 3e-6)
    settled, other = replace(named, confirmed=True), diagnosis(Fault(4, "free"), 1e-6)
    sound, first, known, both = supervised(None, named, settled, other)
    assert sound.current is PILOT.first and sound.diagnoses == ()
    assert first.current.mapping.goal.locked_at == {1: 3e-6}
    assert (first.confirmed, first.diagnoses, failures_before(first)) == ((), (named,), 0)
    assert known.current.mapping.goal.locked_at == {1: 3e-6}
    assert (known.confirmed, known.diagnoses, failures_before(known)) == (
        (settled,),
        (named, settled),
        1,
    )
    assert both.current.mapping.goal.locked_at == {1: 3e-6, 4: 0.0}
    assert (both.confirmed, both.standing) == ((settled,), [settled, other])
    assert [state.ticks for state in (sound, first, known, both)] == [1, 2, 3, 4]


def test_a_diagnosis_that_is_withdrawn_is_flown_around_no_longer():
    named = diagnosis(Fault(1, "locked"), 3e-6)
    first, withdrawn = supervised(named, None)
    assert first.current.mapping.goal.locked_at == {1: 3e-6}
    assert withdrawn.current.mapping.goal == PILOT.first.mapping.goal
    assert (withdrawn.diagnoses, withdrawn.confirmed) == ((named,), ())
    assert failures_before(withdrawn) == 0


def test_the_others_make_up_at_once_for_what_a_named_strut_is_about_to_lose():
    commanded_m = PILOT.first.drives.displacements(supervised(None)[0].inputs)
    (first,) = supervised(diagnosis(Fault(2, "free"), float(commanded_m[2])))
    now_m = PILOT.first.drives.displacements(first.inputs)
    assert now_m[2] == commanded_m[2] and abs(commanded_m[2]) > 1e-6
    now_m[2] = 0.0  # which is all that is left of what it is told
    np.testing.assert_allclose(J[MAJOR] @ now_m, J[MAJOR] @ commanded_m, atol=6e-8)


def test_the_supervisor_dithers_by_its_own_clock():
    pilot = RIG.supervisor(DITHER)
    state = replace(pilot.start(), monitor=Script((None,) * 9))
    for tick in range(9):
        state = pilot.step(state, DESIRED, Measurement(DESIRED, np.zeros(6)))
        np.testing.assert_array_equal(
            state.controller.asked.secondary_reference, DITHER.at(tick * 1e-3)
        )
    for current in (pilot.first, pilot.reconfigured([diagnosis(Fault(1, "locked"))])):
        assert isinstance(current.mapping, StrutMapping) and current.mapping.jacobian == "constant"


def test_when_the_task_is_lost_the_commands_stand_until_a_strut_works_again():
    """Four locked struts leave nothing to point with: that is confirmed before anything stops."""
    locked = [replace(diagnosis(Fault(k, "locked")), confirmed=True) for k in (0, 3, 1)]
    last = diagnosis(Fault(4, "locked"))
    again = replace(diagnosis(Fault(0, "weak", 1.0)), confirmed=True)
    states = supervised(*locked, last, replace(last, confirmed=True), None, again, None)
    assert [state.task_lost for state in states] == [False] * 4 + [True] * 2 + [False] * 2
    assert states[3].current is states[2].current
    for state in states[4:6]:
        np.testing.assert_array_equal(state.inputs, states[3].inputs)
        assert state.current is states[2].current
    assert states[4].confirmed[-1].fault == last.fault and states[4].watch.diagnosis is None
    assert [failures_before(state) for state in states] == [1, 2, 3, 3, 4, 4, 5, 5]
    assert set(states[7].current.mapping.goal.locked_at) == {1, 3, 4}
    assert [state.ticks for state in states] == list(range(1, 9))


@pytest.mark.long
def test_a_second_failure_soon_after_the_first_is_found_too():
    """A fifth of a second later: the first diagnosis is not settled yet."""
    pilot = RIG.supervisor(DITHER)
    failures = [Failure(1, "locked", 7.0), Failure(5, "free", 7.2)]
    path = BENCH.spiral_rad(2.0, begin_s=6.3)
    run = RIG.fly(pilot, path, failures=failures, begin_s=6.3, seed=3)
    state = run.state
    found = {(each.fault.actuator, each.fault.kind) for each in state.standing}
    assert found == {(1, "locked"), (5, "free")}
    assert not state.task_lost and not state.watch.unexplained
    # A lock is no reason for any other strut to step; its own command stays.
    named = next(each.tick for each in state.diagnoses if each.fault.actuator == 1)
    step = np.abs(np.diff(run.inputs, axis=0))
    usual = step[500:600].max()
    assert np.delete(step[named - 1 : named + 1], 1, axis=1).max() < 1.5 * usual
    error = 1e6 * np.linalg.norm(run.error, axis=1)
    assert error[-300:].max() < 1.5 * error[500:700].max()
