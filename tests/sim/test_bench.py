"""Bench: hysteresis of springs, delayed commands, friction forces, log."""

import copy

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import Bench, Body, Failure, Plant, Pose
from sim.plant import MaxwellSlip, Reading, TaskSensor
from tests.sim.machines import settled

PERIOD_S = 1e-3


def chain(seed: int, n: int = 3, m: int = 5) -> MaxwellSlip:
    rng = np.random.default_rng(seed)
    return MaxwellSlip(rng.uniform(0.1, 10, (n, m)), rng.uniform(0.01, 3, (n, m)))


def driven(slip: MaxwellSlip, path: np.ndarray) -> np.ndarray:
    """Return the forces (N, n) along displacements (N, n) from zero."""
    stretch, forces = np.zeros(slip.slip.shape), []
    for by in np.diff(path, axis=0, prepend=0.0):
        stretch = slip.moved(stretch, by)
        forces.append(slip.force(stretch))
    return np.array(forces)


def cycle(amplitude: float, steps: int, n: int) -> np.ndarray:
    """Return a displacement to the amplitude, then once to the other side and back."""
    ends = np.array([0.0, amplitude, -amplitude, amplitude])
    return np.tile(np.interp(np.arange(3 * steps + 1) / steps, range(4), ends)[:, None], n)


@given(st.integers(0, 10**6), st.floats(0.01, 10.0), st.integers(1, 60))
def test_a_closed_cycle_dissipates_what_its_friction_does(seed, amplitude, steps):
    """The work lost is friction times slip; steps in one direction may have any length."""
    slip = chain(seed)
    path = cycle(amplitude, steps, 3)
    closed = slice(steps, None)
    force, x = driven(slip, path)[closed], path[closed]
    # Elements stretch, then slip between two steps, so the force is no trapezoid.
    k, s = slip.stiffness, slip.slip
    friction = (4 * k * s * np.maximum(amplitude - s, 0)).sum(axis=1)
    if steps >= 50:
        work = -(0.5 * (force[1:] + force[:-1]) * np.diff(x, axis=0)).sum(axis=0)
        scale = (k * s).sum(axis=1) * amplitude / steps
        assert (np.abs(work - friction) < 4 * scale).all()
    np.testing.assert_allclose(force[0], force[-1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        force[0], -(k * np.minimum(s, amplitude)).sum(axis=1), rtol=1e-9, atol=1e-12
    )


@given(st.integers(0, 10**6))
def test_motion_smaller_than_all_slip_is_that_of_a_spring(seed):
    slip = chain(seed)
    path = np.random.default_rng(seed).uniform(-1, 1, (50, 3)) * slip.slip.min()
    np.testing.assert_allclose(driven(slip, path), -path * slip.stiffness.sum(axis=1), atol=1e-9)


@given(st.integers(0, 10**6))
def test_after_a_turn_the_loop_is_the_first_curve_twice_as_large(seed):
    """Check Masing's rule (1926), which holds for elements in parallel."""
    slip, rise = chain(seed, n=1), np.linspace(0, 4, 41)[:, None]
    first = driven(slip, rise)
    path = np.vstack([rise, rise[-1] - 2 * rise[1:]])
    back = driven(slip, path)[40:] - first[-1]
    # The rule holds at once, since all slipped elements have reversed.
    np.testing.assert_allclose(back, -2 * first, atol=1e-9)


class Blind:
    """Sensors that read no task."""

    def read(self, pose, displacements):
        return Reading(np.zeros(2), displacements.copy())


def simulated(commands: np.ndarray, **options) -> np.ndarray:
    """Simulate commands (N, 6); return displacements (N, 6)."""
    plant = copy.deepcopy(settled(0.25))
    ticks = np.arange(len(commands)) * PERIOD_S
    bench = Bench(plant, Blind(), time_s=ticks, period_s=PERIOD_S, **options)
    for command in commands:
        bench.measure()
        bench.apply(command)
    return bench.displacement


@pytest.mark.parametrize("late", [1, 3])
def test_a_delay_shifts_the_response_by_as_many_ticks(late):
    commands = 1e-5 * np.random.default_rng(late).normal(size=(20, 6))
    at_once = simulated(commands)
    delayed = simulated(commands, delay_ticks=late)
    still = simulated(np.zeros((late + 1, 6)))
    # The plant rests before the first command, up to picometres of settling.
    np.testing.assert_array_equal(delayed[: late + 1], still)
    np.testing.assert_allclose(delayed[late:], at_once[:-late], atol=1e-11)
    assert np.abs(delayed[1:] - at_once[1:]).max() > 1e-6


def test_the_plant_keeps_its_last_command_until_the_first_one_arrives(model):
    """Pending commands do not change with the caller's buffer."""
    plant, constant, buffer = Plant(model), np.full(6, 2e-5), np.full(6, 1e-5)
    plant.settle(0.3, constant)
    bench = Bench(plant, Blind(), time_s=np.zeros(2), period_s=PERIOD_S, delay_ticks=1)
    bench.measure()
    bench.apply(buffer)
    np.testing.assert_array_equal(plant.command, constant)
    np.testing.assert_allclose(plant.displacements(), constant, rtol=1e-2)
    buffer[:] = 0.0
    bench.measure()
    bench.apply(buffer)
    np.testing.assert_array_equal(plant.command, np.full(6, 1e-5))


@pytest.mark.parametrize("machine", ["hexapod", "pulley"])
def test_a_load_along_an_actuator_moves_what_its_own_force_moves(model, machine):
    """Force over stiffness is displacement for any source of force, also along a tendon."""
    stiffness, command, seconds = 126000.0, 1e-5 * np.arange(6.0), 0.05
    if machine == "pulley":
        model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0" timestep="1e-3"/>
          <worldbody><body><joint name="a" stiffness="5" damping="1"/><geom size=".1" mass="1"/>
            <body name="payload" pos=".5 0 0"><joint name="b" stiffness="3" damping="1"/>
              <geom size=".1" mass="1"/></body></body></worldbody>
          <tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="-0.5"/></fixed>
          </tendon><actuator><position tendon="t" kp="50"/></actuator></mujoco>""")
        stiffness, command, seconds = 50.0, np.array([0.02]), 2.0
    loaded, commanded = (Plant(model, base=None, payload=Body("payload")) for _ in range(2))
    loaded.load(stiffness * command)
    loaded.settle(seconds)
    commanded.settle(seconds, command)
    assert np.abs(commanded.displacements()).max() > 1e-6
    np.testing.assert_allclose(loaded.data.qpos, commanded.data.qpos, rtol=1e-6, atol=1e-13)


@pytest.mark.long
def test_forces_updated_once_a_tick_equal_those_of_every_physics_step(model):
    """The forces differ by 3 % of the effect of hysteresis at 4 Hz and 1 % of the stiffness."""
    time_s = np.arange(250) * PERIOD_S
    commands = 2e-5 * np.sin(2 * np.pi * 4 * time_s)[:, None] * np.ones(6)
    slip = MaxwellSlip(np.full((6, 4), 315.0), np.tile([0.3e-6, 1e-6, 5e-6, 2e-5], (6, 1)))
    by_tick = simulated(commands, hysteresis=slip)
    plant = copy.deepcopy(settled(0.25))
    step_s, stretch, fine = model.opt.timestep, np.zeros((6, 4)), []
    before = plant.displacements()
    for command in commands:
        fine.append(plant.displacements())
        for _ in range(round(PERIOD_S / step_s)):
            here = plant.displacements()
            stretch, before = slip.moved(stretch, here - before), here
            plant.load(slip.force(stretch))
            plant.step(command, step_s)
    effect = np.abs(by_tick - simulated(commands)).max()
    assert effect > 5e-8
    assert np.abs(by_tick - fine).max() < 0.05 * effect


def test_hysteresis_of_another_number_of_actuators_is_rejected(model):
    with pytest.raises(ValueError, match="hysteresis must have one row for each of 6"):
        Bench(Plant(model), Blind(), time_s=np.zeros(1), period_s=1e-3, hysteresis=chain(0))


TICKS = 3


def test_a_bench_does_not_change_with_its_arguments(model):
    """Changing the array of times after creation must not inject a failure early."""
    time_s, floor = 2e-3 * np.arange(float(TICKS)), np.zeros((TICKS, 3))
    bench = Bench(
        Plant(model),
        TaskSensor([0, 1], 0.0, 0.0, 0),
        time_s=time_s,
        period_s=2e-3,
        failures=[Failure(0, "loose", 1.0)],
        floor_m_per_s2=floor,
    )
    time_s[:], floor[:] = 9.0, 9.0
    for _ in range(TICKS):
        bench.measure()
        bench.apply(np.zeros(6))
    undisturbed = Plant(model)
    undisturbed.step(np.zeros(6), (TICKS - 1) * 2e-3)
    np.testing.assert_allclose(bench.displacement[-1], undisturbed.displacements(), atol=1e-12)


def test_a_sensor_cannot_change_the_log(model):
    class Greedy:
        def read(self, pose: Pose, displacements: np.ndarray) -> Reading:
            pose.rotation[:] = 0.0
            return Reading(displacements, displacements)

    bench = Bench(Plant(model), Greedy(), time_s=np.zeros(1), period_s=2e-3)
    with pytest.raises(ValueError, match="read-only"):
        bench.measure()
