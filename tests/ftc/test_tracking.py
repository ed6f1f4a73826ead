"""Loops, limits and sensors of `tracking` for MuJoCo models."""

from dataclasses import replace
from functools import cache
from typing import Any

import control
import mujoco
import numpy as np
import pytest
import scipy.optimize

from ftc import Goal, Measurement, TaskLost, Tracking, is_possible, mapping_for, tracking
from ftc.control.compensator import LARGEST_PEAK
from ftc.fdi import Fault, fault_model
from prioritized import ConstrainedSystem
from sim import MODELS, Mechanism, Plant, load_model

POSITION = (3, 4, 5)
PERIOD_S = 1e-3
SEVEN = Goal((1.0,) * 7)


@cache
def robot(name: str) -> mujoco.MjModel:
    return load_model(MODELS / f"{name}.xml", add_locks=True)


@cache
def mechanism(name: str) -> Mechanism:
    return Mechanism(robot(name))


def tracking_of_loops(name: str, major: tuple[int, ...], **options: Any) -> Tracking:
    model = robot(name)
    plant = Plant(model, base=None)
    usual: dict[str, Any] = {
        "noise": 1e-5,
        "period_s": PERIOD_S,
        "step_s": model.opt.timestep,
        "goal": Goal(joint_weight=(1.0,) * len(plant.drives)),
    }
    return tracking(mechanism(name), plant.linear(), major, **(usual | options))


@cache
def arm() -> Tracking:
    return tracking_of_loops("arm", (0, 1))


@cache
def hand(sense: str) -> Tracking:
    return tracking_of_loops("hand", (3, 4), crossover_hz=0.7, sense=sense)


def open_loop(track: Tracking, mapping=None, faults=()) -> control.StateSpace:
    """Return the sampled plant in series with its compensators."""
    model = fault_model(track.nominal, faults)
    gain = (mapping or track.mapping(track.goal)).major_gain()
    plant = control.ss(model.A, model.B @ gain, track.nominal.plant.C, 0, PERIOD_S)
    return plant * control.append(*(loop.discrete for loop in track.loops))


def peak(track: Tracking) -> float:
    """Return the largest singular value of (I + P K)^-1 on the unit circle."""
    z = np.exp(2j * np.pi * np.geomspace(0.1, 100.0, 2000) * PERIOD_S)
    L = np.moveaxis(open_loop(track)(z, squeeze=False), -1, 0)
    return float(np.linalg.norm(np.linalg.inv(np.eye(2) + L), 2, axis=(1, 2)).max())


@pytest.mark.long
def test_the_crossover_is_the_highest_with_a_sensitivity_peak_of_1_7():
    """The peak is smaller below this crossover and too large above it."""
    result = arm().margins[0].crossover_hz
    assert peak(arm()) <= LARGEST_PEAK
    assert peak(tracking_of_loops("arm", (0, 1), crossover_hz=1.05 * result)) > LARGEST_PEAK
    assert peak(tracking_of_loops("arm", (0, 1), crossover_hz=0.95 * result)) < LARGEST_PEAK


def test_the_loops_stay_stable_after_each_possible_lock():
    """Closed-loop eigenvalues are stable, except that of the locked actuator, which is one."""
    tested = 0
    for k in range(7):
        lock = Fault(k, "locked")
        if not is_possible(arm().classified([lock])):
            continue
        tested += 1
        mapping = arm().mapping(replace(SEVEN, locked_at={k: 0.0}))
        closed_loop = control.feedback(open_loop(arm(), mapping, [lock]), np.eye(2))
        assert np.abs(closed_loop.poles()).max() < 1 + 1e-9
    assert tested >= 5


@pytest.mark.parametrize(
    ("name", "major", "options", "message"),
    [  # the first crossover would be NaN
        ("arm", (0, 1), {"crossover_hz": 2e-5}, "the loop of row 0 has no crossover: a motion"),
        ("hand", (3, 5), {}, "cannot do the major task"),
        ("hand", (3, 4), {"sense": "both", "noise": [1e-5] * 4}, "one positive number or 6"),
    ],
)
def test_a_task_that_cannot_be_tracked_is_rejected_with_the_reason(name, major, options, message):
    with pytest.raises((TaskLost, ValueError), match=message):
        tracking_of_loops(name, major, **options)


def settled(mapping, demand: np.ndarray):
    """Iterate Gauss-Newton steps to convergence, checking limits and closed loops."""
    commanded, pose = np.zeros(mapping.actuators), mapping.nominal
    for part in np.linspace(0.1, 1.0, 10):
        for _ in range(6):
            commanded, _ = mapping.tick(part * demand, pose, commanded)
            if mapping.limits is not None:
                assert np.abs(commanded).max() <= mapping.limits[1].max() * (1 + 1e-9)
            pose = mapping.estimate(commanded, pose)
        assert np.abs(pose.gaps).max(initial=0.0) < 1e-9
    return commanded, pose


@pytest.mark.parametrize("locked_at", [{}, {1: 2e-3}, {4: -3e-3}])
def test_the_steps_end_at_the_optimum_of_the_curved_problem(locked_at):
    """The reference is SLSQP with limits; the lock off centre of the task must not count twice."""
    own, every, demand = mechanism("arm"), np.arange(7), np.array([2e-3, -4e-3, 3e-3])
    goal = replace(SEVEN, locked_at=locked_at)
    free, _ = settled(mapping_for(own, goal, POSITION), demand)
    bound = 0.8 * float(np.abs(free).max())  # at least one is at its bound
    box = (np.full(7, -bound), np.full(7, bound))
    commanded, _ = settled(mapping_for(own, goal, POSITION, box), demand)
    assert np.abs(commanded).max() == pytest.approx(bound, rel=1e-9)
    commanded[list(locked_at)] = list(locked_at.values())

    def position(q: np.ndarray) -> np.ndarray:
        return own.task(own.moved(own.nominal, q, every))[list(POSITION)]

    best = scipy.optimize.minimize(
        lambda q: 1e3 * (q @ q),
        np.zeros(7),
        jac=lambda q: 2e3 * q,
        method="SLSQP",
        bounds=[(locked_at.get(k, -bound), locked_at.get(k, bound)) for k in range(7)],
        constraints={"type": "eq", "fun": lambda q: position(q) - demand},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert best.success
    np.testing.assert_allclose(commanded, best.x, atol=1e-3 * bound)


def test_the_posture_is_that_of_the_simulated_machine():
    """Servos at rest without gravity have their commanded displacements."""
    plant, own = Plant(robot("arm"), base=None), mechanism("arm")
    commanded = 1e-2 * np.array([1.0, -1.0, 0.5, 1.0, -0.5, 1.0, 0.2])
    for _ in range(400):
        plant.step(commanded, PERIOD_S)
    there = own.moved(own.nominal, plant.displacements(), np.arange(7))
    np.testing.assert_allclose(there.displacements, plant.displacements(), atol=1e-12)
    np.testing.assert_allclose(there.pose.translation_m, plant.pose().translation_m, atol=1e-12)
    np.testing.assert_allclose(there.pose.rotation, plant.pose().rotation, atol=1e-12)
    np.testing.assert_allclose(own.task(there)[3:], there.pose.translation_m, atol=1e-15)


@pytest.mark.parametrize("lock", [None, 0], ids=["healthy", "locked"])
@pytest.mark.parametrize("sense", ["task", "joints", "both"])
def test_the_diagnosis_outputs_of_closed_loops_are_linear(sense, lock):
    """The reference is the least strain energy of the servos, a lock a million times as stiff."""
    track = hand(sense)
    posture = settled(track.mapping(Goal((1.0,) * 4)), np.array([2e-3, 3e-3]))[1]
    kinematics = ConstrainedSystem.of(track.model.jacobians(track.model.nominal)).kinematics()
    loops = kinematics.active_constraint
    stiffness, faults = robot("hand").actuator_gainprm[:, 0].copy(), ()
    if lock is not None:
        stiffness[lock], faults = 1e6 * stiffness[lock], (Fault(lock, "locked"),)
    q = track.model.displacements(posture)
    strained = loops.T / stiffness[:, None]
    linear = q - strained @ np.linalg.solve(loops @ strained, loops @ q)
    assert np.abs(q - linear).max() > 1e-4  # the curvature is not small
    of_task = kinematics.J[list(track.major)] @ linear
    expected = {"task": of_task, "joints": linear, "both": np.append(of_task, linear)}[sense]
    controller = track.supervisor()
    assert controller.diagnosis_outputs is not None and (controller.estimate is None) == (
        sense == "task"
    )
    task = track.model.task(posture)[list(track.major)]
    seen = controller.diagnosis_outputs(Measurement(task, q), posture, faults)
    np.testing.assert_allclose(seen, expected, rtol=1e-5, atol=1e-8)


def test_two_sensors_have_the_outputs_of_each_alone():
    """The task is measured, not computed from the encoders, and each sensor has its own noise."""
    noise = np.arange(1.0, 7.0) * 1e-6
    task, joints, both = (
        tracking_of_loops("hand", (3, 4), crossover_hz=0.7, sense=sense, noise=part)
        for sense, part in (("task", noise[:2]), ("joints", noise[2:]), ("both", noise))
    )
    np.testing.assert_array_equal(both.diagnosis_model.noise, noise)
    np.testing.assert_array_equal(both.nominal.noise, task.nominal.noise)
    rows = [task.diagnosis_model.plant.C, joints.diagnosis_model.plant.C]
    np.testing.assert_array_equal(both.diagnosis_model.plant.C, np.vstack(rows))
    assert (joints.nominal.noise != noise[:2]).all()


def test_the_reference_is_fed_forward_unless_disabled():
    """The demand contains the reference before any error is measured."""
    reference = np.array([1e-3, -2e-3])
    assert arm().feedforward
    for feedforward in (True, False):
        controller = replace(arm(), feedforward=feedforward).controller(arm().goal)
        state = controller.step(controller.start(), reference, Measurement(reference, np.zeros(2)))
        np.testing.assert_allclose(state.previous_command.demand, feedforward * reference)
