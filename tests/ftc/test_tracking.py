"""Laws of `ftc.tracking` and of `sim.Mechanism`: loops, handover, limits, postures."""

from dataclasses import replace
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
from sim import HEXAPOD_MJCF, Bench, Failure, Mechanism, Plant, load_model
from sim.plant import TaskSensor

ARM, HAND, ARMS = (
    load_model(HEXAPOD_MJCF.with_name(f"{name}.xml"), add_locks=True)
    for name in ("arm", "hand", "arms")
)
MAJOR = (3, 4, 5)
PERIOD_S = 1e-3


def closed(model: mujoco.MjModel, major: tuple[int, ...], **options: Any) -> Tracking:
    plant, mechanism = Plant(model, base=None), Mechanism(model)
    goal = Goal(joint_weight=(1.0,) * len(plant.drives))
    usual: dict[str, Any] = {
        "noise": 1e-5,
        "period_s": PERIOD_S,
        "step_s": model.opt.timestep,
        "goal": goal,
    }
    return tracking(mechanism, plant.linear(), major, **(usual | options))


@pytest.fixture(scope="module")
def arm() -> Tracking:
    return closed(ARM, (0, 1))


def loop_matrices(track: Tracking, mapping=None, faults=()) -> tuple[np.ndarray, ...]:
    """Sampled plant x' = A x + B u, y = C x, with u the demands; compensators apart."""
    model = fault_model(track.nominal, faults)
    gain = (mapping or track.mapping(Goal((1.0,) * track.nominal.actuators))).major_gain()
    return model.A, model.B @ gain, np.asarray(track.nominal.plant.C)


def peak(track: Tracking) -> float:
    """Largest singular value of (I + P K)^-1 on the unit circle, by matrices alone."""
    A, B, C = loop_matrices(track)
    largest = 0.0
    for angle in 2 * np.pi * np.geomspace(0.1, 100.0, 2000) * PERIOD_S:
        z = np.exp(1j * angle)
        P = C @ np.linalg.solve(z * np.eye(len(A)) - A, B)
        K = np.diag([complex(np.squeeze(loop.discrete(z))) for loop in track.loops])
        S = np.linalg.inv(np.eye(len(P)) + P @ K)
        largest = max(largest, float(np.linalg.norm(S, 2)))
    return largest


@pytest.mark.long
def test_the_crossover_is_the_highest_with_a_sensitivity_peak_of_1_7(arm):
    """Below it all loops are further from instability, above it nearer than allowed."""
    found = arm.margins[0].crossover_hz
    assert peak(arm) <= LARGEST_PEAK
    assert peak(closed(ARM, (0, 1), crossover_hz=1.05 * found)) > LARGEST_PEAK
    assert peak(closed(ARM, (0, 1), crossover_hz=0.95 * found)) < LARGEST_PEAK


def test_the_loops_stay_stable_after_each_lock_that_leaves_the_task_possible(arm):
    """Closed-loop eigenvalues; that of the locked actuator, which stands, is one."""
    tried = 0
    for k in range(7):
        lock = Fault(k, "locked")
        if not is_possible(arm.classified([lock])):
            continue
        tried += 1
        A, B, C = loop_matrices(arm, arm.mapping(Goal((1.0,) * 7, locked_at={k: 0.0})), [lock])
        K = control.append(*(loop.discrete for loop in arm.loops))
        whole = np.block([[A - B @ K.D @ C, B @ K.C], [-K.B @ C, K.A]])
        moves = np.sort(np.abs(np.linalg.eigvals(whole)))
        assert moves[-1] < 1 + 1e-9
    assert tried >= 5


def test_a_crossover_below_all_frequencies_that_are_looked_at_is_refused():
    """It would be NaN, and a dither that is to lie above it, too."""
    with pytest.raises(TaskLost, match=r"the loop of row 0 has no crossover: a motion"):
        closed(ARM, (0, 1), crossover_hz=2e-5)


def test_a_task_that_the_actuators_cannot_do_is_refused():
    with pytest.raises(TaskLost, match="cannot do the major task"):
        closed(HAND, (3, 5))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"period_s": 0.0}, "period_s"),
        ({"period_s": np.nan}, "period_s"),
        ({"noise": np.nan}, "noise"),
        ({"noise": -1.0}, "noise"),
        ({"noise": [1e-5] * 3}, "noise"),
        ({"crossover_hz": -1.0}, "crossover_hz"),
        ({"crossover_hz": np.inf}, "crossover_hz"),
    ],
)
def test_arguments_of_the_wrong_shape_or_size_are_named(changed, said):
    with pytest.raises(ValueError, match=said):
        closed(ARM, (0, 1), **({"crossover_hz": 0.7} | changed))


@pytest.mark.parametrize("major", [(), (0, 0), (6,), (-1,), (0.5,)])
def test_rows_that_are_none_are_named(major):
    with pytest.raises((ValueError, TypeError), match="major"):
        closed(ARM, major)


def serial_arm(seed: int, joints: int = 7) -> mujoco.MjModel:
    """Hinges with random axes and links, each with a servo."""
    rng = np.random.default_rng(seed)
    inner = '<site name="payload" pos="0.1 0 0"/>'
    for k in reversed(range(joints)):
        axis, pos = (" ".join(map(str, rng.normal(size=3))) for _ in range(2))
        pos = " ".join(f"{0.3 * float(part):.6f}" for part in pos.split())
        inner = (
            f'<body pos="{pos}"><joint name="j{k}" axis="{axis}"/>'
            f'<geom size="0.05" mass="1"/>{inner}</body>'
        )
    servos = "".join(f'<position name="j{k}" joint="j{k}" kp="100" kv="5"/>' for k in range(joints))
    option = '<option gravity="0 0 0"/>'
    return mujoco.MjModel.from_xml_string(
        f"<mujoco>{option}<worldbody>{inner}</worldbody><actuator>{servos}</actuator></mujoco>"
    )


def settled(mapping, demand: np.ndarray, commanded: np.ndarray, pose):
    """Gauss-Newton steps until they end."""
    for _ in range(30):
        commanded = mapping.displacements(demand, pose, commanded)
        pose = mapping.estimate(commanded, pose)
    return commanded, pose


@pytest.mark.parametrize("seed", range(6))
def test_when_a_lock_off_centre_is_told_the_major_task_stays_where_it_is(seed):
    """Its displacement is in the task already: counted again it would move it at first order."""
    mechanism, goal, every = Mechanism(serial_arm(seed)), Goal((1.0,) * 7), np.arange(7)
    before = mapping_for(mechanism, goal, MAJOR)
    demand = np.array([2e-3, -1e-3, 1.5e-3])
    commanded, pose = settled(before, demand, np.zeros(7), mechanism.nominal)
    k = int(np.abs(commanded).argmax())
    after = mapping_for(mechanism, replace(goal, locked_at={k: commanded[k]}), MAJOR)
    told = after.displacements(demand, pose, commanded)
    told[k] = commanded[k]
    moved = mechanism.task(mechanism.moved(pose, told, every)) - mechanism.task(pose)
    # What is left is of second order in the step.
    assert np.abs(moved[3:]).max() < 0.02 * np.abs(demand).max()
    # The oracle: what the lock's own displacement does, counted twice, by finite differences.
    alone = np.zeros(7)
    alone[k] = commanded[k]
    twice = mechanism.task(mechanism.moved(pose, commanded + alone, every)) - mechanism.task(pose)
    assert np.abs(moved[3:]).max() < 0.1 * np.abs(twice[3:]).max()


LIMIT = 1e-2


def limited(bound: float) -> Any:
    """The arm's mapping within symmetric limits."""
    limits = (np.full(7, -bound), np.full(7, bound))
    return mapping_for(Mechanism(ARM), Goal((1.0,) * 7), MAJOR, limits)


def settled_within(mapping, demand: np.ndarray):
    commanded, pose = np.zeros(7), mapping.nominal
    for part in np.linspace(0.1, 1.0, 10):
        for _ in range(6):
            commanded, _ = mapping.tick(part * demand, pose, commanded)
            assert np.abs(commanded).max() <= mapping.limits[1].max() * (1 + 1e-9)
            pose = mapping.estimate(commanded, pose)
    return commanded, pose


def test_limits_that_do_not_bind_change_nothing():
    demand = np.array([1e-3, -2e-3, 1e-3])
    mapping = limited(1.0)
    commanded, pose = np.zeros(7), mapping.nominal
    for _ in range(3):
        free = mapping.displacements(demand, pose, commanded)
        found, residual = mapping.tick(demand, pose, commanded)
        np.testing.assert_allclose(found, free, atol=1e-12)
        np.testing.assert_allclose(residual, 0.0, atol=1e-12)
        commanded, pose = free, mapping.estimate(free, pose)


def test_an_actuator_without_a_limit_beside_one_that_has_one_goes_on_as_before():
    """An infinite limit is none: many arms have joints that turn without end."""
    goal, demand = Goal((1.0,) * 7), np.array([1e-3, -2e-3, 1e-3])
    wide = np.array([np.inf, 1.0, np.inf, 1.0, np.inf, 1.0, np.inf])
    mapping = mapping_for(Mechanism(ARM), goal, MAJOR, (-wide, wide))
    found, _ = mapping.tick(demand, mapping.nominal, np.zeros(7))
    free = mapping.displacements(demand, mapping.nominal, np.zeros(7))
    np.testing.assert_allclose(found, free, atol=1e-12)


def test_within_limits_the_steps_end_at_the_optimum_of_the_curved_problem():
    """Least norm of the joints that reach the position within their limits, by SLSQP."""
    mechanism, every = Mechanism(ARM), np.arange(7)
    demand = np.array([2e-3, -4e-3, 3e-3])
    free, _ = settled_within(limited(1.0), demand)
    bound = 0.8 * float(np.abs(free).max())  # so that one at least is held back
    commanded, _ = settled_within(limited(bound), demand)
    assert np.abs(commanded).max() == pytest.approx(bound, rel=1e-9)

    def position(q: np.ndarray) -> np.ndarray:
        return mechanism.task(mechanism.moved(mechanism.nominal, q, every))[list(MAJOR)]

    def slope(q: np.ndarray) -> np.ndarray:
        ends = [[position(q + side * column) for side in (1, -1)] for column in 1e-5 * np.eye(7)]
        return np.array([(up - down) / 2e-5 for up, down in ends]).T

    best = scipy.optimize.minimize(
        lambda q: 1e3 * (q @ q),
        np.zeros(7),
        jac=lambda q: 2e3 * q,
        method="SLSQP",
        bounds=[(-bound, bound)] * 7,
        constraints={"type": "eq", "fun": lambda q: position(q) - demand, "jac": slope},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert best.success
    np.testing.assert_allclose(commanded, best.x, atol=1e-3 * bound)


@pytest.mark.long
@pytest.mark.parametrize("model", [HAND, ARMS], ids=["hand", "arms"])
def test_small_steps_leave_the_loops_closed(model):
    """A Newton step squares the gap: after many it is no larger than one step's remainder."""
    mechanism = Mechanism(model)
    n = len(mechanism.nominal.displacements)
    mapping = mapping_for(mechanism, Goal((1.0,) * n), (3, 4))
    commanded, posture = np.zeros(n), mechanism.nominal
    for angle in np.linspace(0, 2 * np.pi, 1000):
        demand = 1e-3 * np.array([np.sin(angle), 1 - np.cos(angle)])
        commanded = mapping.displacements(demand, posture, commanded)
        posture = mapping.estimate(commanded, posture)
        assert np.abs(posture.gaps).max() < 1e-9
    assert np.abs(mechanism.task(posture)[[3, 4]]).max() < 1e-6


def test_the_posture_is_that_of_the_simulated_machine():
    """At rest without gravity the servos stand where they are commanded."""
    plant, mechanism = Plant(ARM, base=None), Mechanism(ARM)
    commanded = 1e-2 * np.array([1.0, -1.0, 0.5, 1.0, -0.5, 1.0, 0.2])
    for _ in range(4000):
        plant.step(commanded, PERIOD_S)
    there = mechanism.moved(mechanism.nominal, plant.displacements(), np.arange(7))
    np.testing.assert_allclose(there.displacements, plant.displacements(), atol=1e-12)
    np.testing.assert_allclose(there.pose.translation_m, plant.pose().translation_m, atol=1e-12)
    np.testing.assert_allclose(there.pose.rotation, plant.pose().rotation, atol=1e-12)
    np.testing.assert_allclose(mechanism.task(there)[3:], there.pose.translation_m, atol=1e-15)


def straightened(track: Tracking, posture, faults: tuple[Fault, ...] = ()) -> np.ndarray:
    """What the diagnosis sees at a posture."""
    watched = track.supervisor().watched
    assert watched is not None
    task = track.model.task(posture)[list(track.major)]
    measurement = Measurement(task, track.model.displacements(posture))
    return watched(measurement, posture, faults)


@pytest.mark.parametrize("lock", [None, 0], ids=["sound", "locked"])
@pytest.mark.parametrize("sense", ["task", "joints", "both"])
def test_the_diagnosis_sees_closed_loops_as_if_they_were_linear(sense, lock):
    """Commands on curved loops strain linear ones, whose servos share that by their stiffness.

    The oracle minimizes the strain energy of the four servos over the motions that the linear
    loops allow; a locked actuator is a servo a million times as stiff.
    """
    track = closed(HAND, (3, 4), crossover_hz=0.7, sense=sense)
    mapping = track.mapping(Goal((1.0,) * 4))
    posture = settled(mapping, np.array([2e-3, 3e-3]), np.zeros(4), mapping.nominal)[1]
    kinematics = ConstrainedSystem.of(track.model.jacobians(track.model.nominal)).kinematics()
    loops = kinematics.active_constraint
    stiffness, faults = HAND.actuator_gainprm[:, 0].copy(), ()
    if lock is not None:
        stiffness[lock], faults = 1e6 * stiffness[lock], (Fault(lock, "locked"),)
    q = track.model.displacements(posture)
    strained = loops.T / stiffness[:, None]
    linear = q - strained @ np.linalg.solve(loops @ strained, loops @ q)
    assert np.abs(q - linear).max() > 1e-4  # the curvature is not small
    of_task = kinematics.J[list(track.major)] @ linear
    expected = {"task": of_task, "joints": linear, "both": np.append(of_task, linear)}[sense]
    np.testing.assert_allclose(straightened(track, posture, faults), expected, rtol=1e-5, atol=1e-8)


def test_both_sensors_together_are_those_of_each_alone():
    """The task is measured, not computed from the encoders, and each keeps its own noise."""
    noise = np.arange(1.0, 7.0) * 1e-6
    options: dict[str, Any] = {"crossover_hz": 0.7}
    task, joints, both = (
        closed(HAND, (3, 4), sense=sense, noise=part, **options)
        for sense, part in (("task", noise[:2]), ("joints", noise[2:]), ("both", noise))
    )
    np.testing.assert_array_equal(both.watched.noise, noise)
    np.testing.assert_array_equal(both.nominal.noise, task.nominal.noise)
    rows = [task.watched.plant.C, joints.watched.plant.C]
    np.testing.assert_array_equal(both.watched.plant.C, np.vstack(rows))
    assert (joints.nominal.noise != noise[:2]).all()
    with pytest.raises(ValueError, match=r"noise must be one positive number or 6"):
        closed(HAND, (3, 4), sense="both", noise=noise[:4])
    with pytest.raises(ValueError, match="sense must be one of task, joints, both, got 'smell'"):
        closed(HAND, (3, 4), sense="smell")


@pytest.mark.parametrize("weights", [{"joint": 1.0}, {"secondary": 1.0}, {"joint": 1.0, "off": 2}])
def test_the_secondary_gain_is_what_a_reference_moves_without_the_major_task(weights):
    """A small reference at the nominal pose moves the commands by the gain, the task not at all."""
    goal = Goal(
        joint_weight=(weights["joint"],) * 7 if "joint" in weights else None,
        secondary_weight=(1.0,) * 4 if "secondary" in weights else None,
        locked_at={weights["off"]: 0.0} if "off" in weights else {},
    )
    mapping = mapping_for(Mechanism(ARM), goal, (0, 1))
    gain, still = mapping.secondary_gain(), np.zeros(2)
    J_m = ConstrainedSystem.of(Mechanism(ARM).jacobians(mapping.nominal)).kinematics().J[[0, 1]]
    assert np.linalg.matrix_rank(gain, 1e-9) == 5 - ("off" in weights) - ("secondary" in weights)
    np.testing.assert_allclose(J_m @ gain, 0.0, atol=1e-12)
    for wish in 1e-3 * np.eye(7):
        moved = mapping.displacements(still, mapping.nominal, np.zeros(7), None, wish)
        np.testing.assert_allclose(moved, gain @ wish, atol=1e-12)


@pytest.mark.parametrize("wrong", [np.full(7, np.nan), np.zeros(3), np.zeros(0)])
def test_displacements_that_are_none_are_named(wrong):
    mechanism = Mechanism(ARM)
    with pytest.raises(ValueError, match="displacements"):
        mechanism.moved(mechanism.nominal, wrong, np.arange(7))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"time_s": np.array([np.nan])}, "time_s"),
        ({"time_s": np.zeros((2, 2))}, "time_s"),
        ({"period_s": 0.0}, "period_s"),
        ({"period_s": np.nan}, "period_s"),
        ({"failures": [Failure(99, "locked", 0.0)]}, "actuator must lie in 0..6"),
        ({"floor_m_per_s2": np.zeros((5, 3))}, "floor_m_per_s2"),
    ],
)
def test_a_bench_that_cannot_run_is_refused_when_it_is_made(changed, said):
    usual = {"time_s": np.zeros(2), "period_s": PERIOD_S}
    with pytest.raises(ValueError, match=said):
        Bench(Plant(ARM), TaskSensor([0], 0.0, 0.0, 0), **(usual | changed))


@pytest.mark.parametrize("sense", ["task", "joints", "both"])
def test_the_task_is_computed_from_encoders_only_where_these_are_looked_at(sense):
    track = closed(HAND, (3, 4), crossover_hz=0.7, sense=sense)
    assert (track.supervisor().estimate is None) == (sense == "task")


def test_the_reference_is_demanded_at_once_unless_that_is_declined(arm):
    """Before any error was measured: the compensators add what is missing."""
    reference = np.array([1e-3, -2e-3])
    for feedforward in (True, False):
        pilot = closed(ARM, (0, 1), feedforward=feedforward).controller(arm.goal)
        state = pilot.step(pilot.start(), reference, Measurement(reference, np.zeros(2)))
        np.testing.assert_allclose(state.asked.demand, feedforward * reference)
    assert arm.feedforward
