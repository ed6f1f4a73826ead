"""A pilot that takes over in flight: it knows what the former one knew, and nothing steps."""

from dataclasses import replace

import numpy as np
import pytest

from fjh.rig import Rig
from ftc import Goal, Measurement, one_tick, run_loop
from sim import Failure
from tests.ftc.test_handover import LSB_PERCENT

RIG = Rig.hexapod()
PILOT = RIG.supervisor()
OTHER = RIG.supervisor(goal=Goal(joint_weight=(2.0, 1.0, 2.0, 1.0, 2.0, 1.0)))
TICKS = 40


@pytest.fixture(scope="module")
def flown():
    """Half a second after a strut was locked: the state of a supervisor, and a tick that follows.

    The same tick for everybody, so that what differs is of the pilots.
    """
    path = RIG.path("circle", duration_s=1.5)
    run = RIG.fly(PILOT, path, failures=[Failure(3, "locked", 1.0)])
    assert [each.fault.actuator for each in run.state.standing] == [3]
    return run.state, path[-1], run.measured[-1]


@pytest.mark.parametrize("pilot", [RIG.controller(), PILOT], ids=["controller", "supervisor"])
def test_one_tick_after_the_other_is_the_loop(pilot):
    """Written out here, to the bit; `run_loop` the same."""
    reference, time_s = RIG.path("circle", duration_s=1.0)[:TICKS], np.zeros(TICKS)
    bench, state = RIG.bench(time_s, (), 1), pilot.start()
    measured, inputs = [], []
    for row in reference:
        read = bench.measure()
        state = pilot.step(state, row, read)
        bench.apply(state.inputs)
        measured.append(read.output)
        inputs.append(state.inputs)
    bench, state = RIG.bench(time_s, (), 1), pilot.start()
    for k, row in enumerate(reference):
        state, seen = one_tick(bench, pilot.step, state, row)
        np.testing.assert_array_equal(seen, measured[k])
        np.testing.assert_array_equal(state.inputs, inputs[k])
    looped = run_loop(RIG.bench(time_s, (), 1), pilot, reference)
    np.testing.assert_array_equal(looped.measured, measured)
    np.testing.assert_array_equal(looped.inputs, inputs)


def test_one_tick_passes_on_what_else_the_controller_takes():
    seen = []

    def step(state, reference, measurement, **known):
        seen.append(known)
        return state

    bench, pilot = RIG.bench(np.zeros(1), (), 0), RIG.controller()
    one_tick(bench, step, pilot.start(), np.zeros(2), feedforward=np.ones(2))
    np.testing.assert_array_equal(seen[0]["feedforward"], np.ones(2))


@pytest.mark.parametrize("pilot", [PILOT, OTHER], ids=["same goal", "another goal"])
def test_what_a_supervisor_believes_stays(flown, pilot):
    state, _, _ = flown
    after = pilot.transfer(state)
    for name in ("standing", "diagnoses", "confirmed", "withdrawn", "ticks", "task_lost"):
        assert getattr(after, name) == getattr(state, name), name
    assert after.watch is state.watch and after.sensors is state.sensors
    assert 3 in after.current.mapping.goal.locked_at
    assert after.current.mapping.goal.joint_weight == pilot.first.mapping.goal.joint_weight


@pytest.mark.parametrize("pilot", [PILOT, OTHER], ids=["same goal", "another goal"])
def test_no_surviving_strut_steps_when_a_supervisor_takes_over(flown, pilot):
    """Against the tick that the former one would have done; with a bare mapping they would."""
    state, reference, measured = flown
    measurement = Measurement(measured, np.zeros(6))
    goes_on = PILOT.step(state, reference, measurement).inputs
    taken_over = pilot.step(pilot.transfer(state), reference, measurement).inputs
    survivors = [0, 1, 2, 4, 5]
    # The first tick of the fade, and the converters' last bit.
    assert np.abs(taken_over - goes_on)[survivors].max() <= 2 * LSB_PERCENT
    bare = replace(state, current=pilot.reconfigured(state.standing))
    stepped = np.abs(pilot.step(bare, reference, measurement).inputs - goes_on)[survivors].max()
    assert pilot is PILOT or stepped > 10 * LSB_PERCENT


def test_after_a_controller_the_diagnosis_learns_the_machine_anew_and_no_strut_steps():
    path, pilot = RIG.path("circle", duration_s=0.9), RIG.controller()
    run = RIG.fly(pilot, path)
    after = OTHER.transfer(run.state)
    assert after.is_learning and after.ticks == 0 and not after.diagnoses and not after.standing
    assert after.current is OTHER.first
    measurement = Measurement(run.measured[-1], np.zeros(6))
    goes_on = pilot.step(run.state, path[-1], measurement).inputs
    taken_over = OTHER.step(after, path[-1], measurement).inputs
    assert np.abs(taken_over - goes_on).max() <= 1.5 * LSB_PERCENT
    bare = replace(after, controller=run.state)
    assert np.abs(OTHER.step(bare, path[-1], measurement).inputs - goes_on).max() > LSB_PERCENT * 10


@pytest.mark.parametrize("state", [None, 3, np.zeros(6), "state"])
def test_what_is_no_state_is_refused(state):
    with pytest.raises(TypeError, match=r"^state must be"):
        PILOT.transfer(state)
