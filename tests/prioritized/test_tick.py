"""Test that a tick equals the general solver, or returns None."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Hierarchy, Kinematics, Status, Task, Tick
from tests.profiles import examples
from tests.random_systems import (
    SEEDS,
    RandomSystem,
    failures,
    major_and_secondary,
    of_rank,
    systems,
)

SURE = Status.EXACT, Status.LEAST_SQUARES, Status.LIMITED


@dataclass(frozen=True)
class TickCase:
    """Levels of a mechanism, their targets, and limits of all velocities."""

    system: ConstrainedSystem
    hierarchy: Hierarchy
    targets: list[np.ndarray]
    limits: tuple[np.ndarray, np.ndarray]

    def tick(self) -> np.ndarray | None:
        """Solve by the compiled method, with all targets one after the other."""
        tick = self.hierarchy.tick(self.system.kinematics())
        there = self.system.J_T, self.system.J_C, np.concatenate(self.targets)
        return None if tick is None else tick(*there, self.limits)

    def assert_is(self, result: np.ndarray) -> None:
        """Compare with the general solver, with limits of passive velocities as inequality rows."""
        kin, (lower, upper) = self.system.kinematics(), self.limits
        moving, n = kin.system.joints.moving, len(kin.actuators)
        moving = moving[np.isfinite(lower[moving])]
        rows = kin.velocities(np.eye(n)).T[moving], lower[moving], upper[moving]
        box = lower[kin.active], upper[kin.active]
        posed = self.hierarchy.at(kin, rate_limits=box, rate_rows=rows)
        solution = posed.solve(self.targets)
        assert solution.status in SURE
        expected = kin.velocities(solution.rates)
        np.testing.assert_allclose(result, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def limits(rng: np.random.Generator, kin: Kinematics, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Return limits around zero, infinite for some, mostly for passive ones."""
    N = kin.system.J_T.shape[1]
    lower, upper = (size * rng.uniform(0.2, 2.0, N) for _ in range(2))
    free = rng.random(N) < 0.2
    free[kin.passive] = rng.random(len(kin.passive)) < 0.8
    lower[free] = upper[free] = np.inf
    return -lower, upper


def tick_case(
    rng: np.random.Generator, system: ConstrainedSystem, rows: list[list[int]], size: float
) -> TickCase:
    """Return levels of task rows, then rates or none, weighted or not."""
    kin, n = system.kinematics(), len(system.active)
    levels = [
        Task(each, rng.uniform(0.5, 2, len(each)) if rng.random() < 0.5 else None) for each in rows
    ]
    targets = [rng.normal(size=len(each)) for each in rows]
    if rng.random() < 0.7:
        retained = rng.random(n) < rng.choice([0.5, 0.9])
        weight = rng.uniform(0.5, 2, n) * retained if rng.random() < 0.5 else None
        levels.append(Task.joints(weight))
        targets.append(rng.normal(size=len(kin.active)))
    metrics = None, None, rng.uniform(0.5, 2, n), rng.normal(size=(n, n))
    metric = metrics[int(rng.integers(4))]
    hierarchy = kin.hierarchy(levels, tie_metric=metric)
    return TickCase(system, hierarchy, targets, limits(rng, kin, size))


def regular(rng: np.random.Generator) -> ConstrainedSystem:
    """Return loops that determine the passive velocities and may tie rates; a full-rank task."""
    p, q, m, more = (int(rng.integers(*ends)) for ends in ((0, 5), (0, 3), (1, 5), (0, 4)))
    n = m + q + more
    q = q if p else 0
    J_C = of_rank(rng, p + q, p + n, p + q)
    J_C[:, :p] = of_rank(rng, p + q, p, p)
    order = rng.permutation(p + n)
    J_T, J = rng.normal(size=(m, p + n)), np.empty_like(J_C)
    J[:, order] = J_C
    return ConstrainedSystem(J_T, J, order[p:])


def in_levels(rng: np.random.Generator, m: int) -> list[list[int]]:
    rows = rng.permutation(m)
    return [each.tolist() for each in np.split(rows, sorted({rng.integers(0, m), 0})[1:])]


def tied(rng: np.random.Generator, redundant: int) -> ConstrainedSystem:
    """Return three passive velocities and five actuators, two of them tied by dependent rows."""
    J_C = of_rank(rng, 5, 8, 5)
    J_C[:, :3] = of_rank(rng, 5, 3, 3)
    rows = rng.permutation(np.vstack([J_C, rng.normal(size=(redundant, 5)) @ J_C]))
    return ConstrainedSystem(rng.normal(size=(4, 8)), rows, [3, 4, 5, 6, 7])


def ticked(posed, system: ConstrainedSystem, *inputs: np.ndarray) -> np.ndarray | None:
    """Return all velocities by the compiled method of a mapping or a hierarchy, or None."""
    tick = posed.tick(*([system.kinematics()] if isinstance(posed, Hierarchy) else []))
    free = np.full(system.J_T.shape[1], np.inf)
    there = system.J_T, system.J_C, np.concatenate(inputs), (-free, free)
    return None if tick is None else tick(*there)


@given(st.data(), systems(tasks=(1, 5), actives=(1, 5)), st.integers(-18, 0), st.floats(0.1, 10.0))
@examples(300)
def test_a_tick_equals_the_general_solver_or_returns_none(
    data, sample: RandomSystem, nearness, size
):
    """Check any ranks and failures, near-singular poses, and limits that may be infeasible."""
    first, rng = sample.system, sample.rng
    J_T = first.J_T.copy()
    J_T[-1] = J_T[0] + 10.0**nearness * rng.normal(size=J_T.shape[1])
    system = data.draw(failures(ConstrainedSystem(J_T, first.J_C, first.active)))
    levels = [each for each in major_and_secondary(data, len(J_T)) if each]
    posed = tick_case(rng, system, levels, size)
    result = posed.tick()
    if result is not None:
        posed.assert_is(result)
        assert not result[system.stuck].any()


@pytest.mark.parametrize("count", [40, pytest.param(200, marks=pytest.mark.long)])
@pytest.mark.parametrize("size", [0.3, 3.0, np.inf])
def test_a_tick_solves_well_conditioned_problems(size, count):
    """Require a result for 90 % of regular mechanisms, and 95 % of those with tied rates."""
    answered = np.zeros(2)
    for seed in range(count):
        rng = np.random.default_rng(seed)
        system = regular(rng)
        posed = tick_case(rng, system, in_levels(rng, len(system.J_T)), size)
        result = posed.tick()
        if result is not None:
            answered[0] += 1
            posed.assert_is(result)
        system = tied(rng, seed % 3)
        mapping = system.kinematics().velocity_mapping([0, 1], [2], np.ones(5), [1.0])
        inputs = rng.normal(size=2), rng.normal(size=5), rng.normal(size=1)
        result = ticked(mapping, system, *inputs)
        if result is not None:
            answered[1] += 1
            general, most = mapping.solve(*inputs).rates, np.abs(result).max()
            np.testing.assert_allclose(result[system.active], general, atol=1e-9 * most)
    assert (answered >= [0.9 * count, 0.95 * count]).all()


@given(SEEDS, st.floats(3.0, 17.0), st.floats(-3.0, 3.0))
@examples(200)
def test_a_nearly_redundant_loop_row_has_the_decided_rank(seed, nearness, unit):
    """Check that J_C has the decided rank where the compiled method returns a result."""
    rng = np.random.default_rng(seed)
    exact = tied(rng, 1)
    J_C = 10.0**unit * exact.J_C
    J_C[-1] += 10.0**-nearness * np.abs(J_C[-1]).max() * rng.normal(size=8)
    system = ConstrainedSystem(exact.J_T, J_C, exact.active)
    kin = system.kinematics()
    mapping = kin.velocity_mapping([0], joint_weight=np.ones(5))
    inputs = rng.normal(size=1), rng.normal(size=5)
    result = ticked(mapping, system, *inputs)
    if result is None:
        assert nearness < 14.0
        return
    count = len(kin.active_constraint)
    assert count in (2, 3)
    np.testing.assert_allclose(
        result[system.active],
        mapping.solve(*inputs).rates,
        rtol=0,
        atol=1e-8 * np.abs(result).max(),
    )
    assert mapping.status in SURE


@given(SEEDS)
def test_a_separate_body_is_at_rest_unless_it_is_part_of_the_task(seed):
    """Check a cube with passive velocities in no row, and a task on the cube."""
    rng = np.random.default_rng(seed)
    alone = tied(rng, 1)
    v, desired = 0.1 * rng.normal(size=1), rng.normal(size=5)
    J_T, J_C = (np.hstack([A, np.zeros((len(A), 6))]) for A in (alone.J_T, alone.J_C))
    combined = ConstrainedSystem(J_T, J_C, alone.active)
    result = []
    for system in (alone, combined):
        mapping = system.kinematics().velocity_mapping([0], joint_weight=np.ones(5))
        result.append(ticked(mapping, system, v, desired))
    assume(result[0] is not None)
    np.testing.assert_allclose(result[1], np.append(result[0], np.zeros(6)), atol=1e-12)
    tick = combined.kinematics().velocity_mapping([0], joint_weight=np.ones(5)).tick()
    assert tick is not None
    N, posed = J_T.shape[1], np.concatenate([v, desired])
    lower, upper = np.full(N, -np.inf), np.full(N, np.inf)
    lower[-1] = 0.1  # the cube cannot move
    assert tick(J_T, J_C, posed, (lower, upper)) is None
    J_T[0, -1] = 1.0
    assert tick(J_T, J_C, posed, (-upper, upper)) is None


ARM = ConstrainedSystem([[1.0, 0.5, 0.2], [0.0, 1.0, 0.7]], None, [0, 1, 2])


FREELY = -np.full(3, np.inf), np.full(3, np.inf)


def test_the_tick_of_a_less_accurate_mechanism_uses_its_tolerance():
    """Check a singular value that is certain for one tolerance and not for the other."""
    J, v, others = np.diag([1.0, 1e-2, 1.0])[:2], np.array([1.0, 1.0]), np.zeros(3)
    fine, rough = (ConstrainedSystem(J, None, range(3), rank_tolerance=t) for t in (1e-10, 0.1))
    mapping = fine.kinematics().velocity_mapping([0, 1])
    there = mapping.at(rough.kinematics())
    assert ticked(mapping, fine, v, others) == pytest.approx(np.array([1.0, 100.0, 0.0]))
    tick = mapping.tick()
    assert tick is not None
    assert tick.at_jacobians(fine, np.concatenate([v, others]), None) == pytest.approx([1, 100, 0])
    result = ticked(there, rough, v, others)
    np.testing.assert_allclose(there(v), [1.0, 0.0, 0.0])
    assert result is None or result == pytest.approx(there(v))


def tick_of(system: ConstrainedSystem, *levels: Task) -> Tick | None:
    return system.kinematics().hierarchy(levels).tick(system.kinematics())


@pytest.mark.parametrize(
    "arguments",
    [
        {"rate_rows": (np.ones((1, 3)), -1.0, 1.0)},
        {"rate_limits": (-1.0, 1.0), "when_limited": "scaled"},
        {},
    ],
)
def test_rows_scaled_tasks_and_intervals_have_no_tick(arguments):
    if arguments:
        assert ARM.kinematics().velocity_mapping([0], **arguments).tick() is None
    else:
        assert tick_of(ARM, Task([0], interval=True), Task.joints()) is None


@pytest.mark.parametrize(
    "levels",
    [
        [Task([0], damping=0.1), Task.joints()],
        [Task([0]), Task([1], damping=0.5)],
        [Task([0]), Task.joints(damping=0.3)],
        [Task.joints(), Task([0])],
        [Task([0]), Task.joints([1.0, 1e-6, 1.0])],
        [Task([0]), Task.joints([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0]])],
        [Task([0]), Task([0, 1]), Task([1])],
        [[Task([0]), Task.joints()], Task([1])],
    ],
)
@pytest.mark.parametrize("size", [0.2, np.inf])
def test_levels_of_all_kinds_equal_the_general_solver(levels, size):
    """Check damping, rates before tasks, small or non-diagonal weights, duplicated tasks."""
    kin, rng, most = ARM.kinematics(), np.random.default_rng(3), np.full(3, size)
    hierarchy = kin.hierarchy(levels)
    count = [sum(part.size for part in level) for level in hierarchy.specs.levels]
    targets = [rng.normal(size=each) for each in count]
    tick = hierarchy.tick(kin)
    assert tick is not None
    result = tick(ARM.J_T, ARM.J_C, np.concatenate(targets), (-most, most))
    parts = [
        t if len(level) == 1 else np.split(t, np.cumsum([part.size for part in level])[:-1])
        for t, level in zip(targets, hierarchy.specs.levels, strict=True)
    ]
    expected = hierarchy.at(kin, rate_limits=(-most, most)).solve(parts).rates
    assert result is not None
    np.testing.assert_allclose(result, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


TIED = ConstrainedSystem([[1.0, 0.0, 0.0]], [[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]], [0, 1])


def test_passive_limits_restrict_rates_and_contradictions_give_none():
    """Check limits that contradict the loops, and a freely swinging joint."""
    tick, narrow = tick_of(TIED, Task([0]), Task.joints()), np.array([5.0, 5.0, 0.1])
    assert tick is not None
    result = tick(TIED.J_T, TIED.J_C, np.array([1.0, 0.0, 0.0]), (-narrow, narrow))
    assert result is not None
    np.testing.assert_allclose(result, [0.1, 0.1, 0.1])
    separated = np.array([1.0, -2.0, -5.0]), np.array([2.0, -1.0, 5.0])
    for system, box in ((TIED, separated), (ARM.with_failures(free=[2]), FREELY)):
        tick = tick_of(system, Task([0]), Task.joints())
        targets = np.append(1.0, np.zeros(len(system.kinematics().actuators)))
        assert tick is not None and tick(system.J_T, system.J_C, targets, box) is None


def test_a_tick_returns_none_if_errors_could_change_a_rank():
    tick = tick_of(ARM, Task([0, 1]), Task.joints())

    class Rounded:
        error_bound = 0.0
        task_units, velocity_units, constraint_units = np.ones(2), np.ones(3), np.ones(0)
        J_T_error, J_C_error = np.zeros((2, 3)), np.zeros((0, 3))

    rounded = ConstrainedSystem(ARM.J_T, None, [0, 1, 2], accuracy=Rounded())
    careful = tick_of(rounded, Task([0, 1]), Task.joints())
    assert tick is not None and careful is not None
    posed = ARM.J_T, ARM.J_C, np.ones(5), FREELY
    assert tick(*posed, 1.0) is not None  # it was stated as exact
    assert careful(*posed, 1e-6) is not None
    assert careful(*posed, 0.5) is None
    assert careful(*posed, np.inf) is None
