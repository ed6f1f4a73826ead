"""Hierarchies of tasks under limits: against velocity mappings, an oracle, and failures."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Status, Task, lexicographic_least_squares
from tests.lexicographic_oracles import by_active_sets, certificate
from tests.profiles import examples
from tests.random_systems import SEEDS, failures, major_and_rest, of_rank, systems


def arm(rng: np.random.Generator, m: int, n: int) -> ConstrainedSystem:
    """An open chain with this many task rows and actuators."""
    return ConstrainedSystem(of_rank(rng, m, n, min(m, n)), None, list(range(n)))


@given(st.data(), systems(tasks=(2, 5)))
@examples(60)
def test_two_levels_are_a_velocity_mapping(data, drawn):
    """The major task, then goals of rates and secondary velocity side by side; failures too."""
    system, rng = data.draw(failures(drawn.system)), drawn.rng
    kin, n_all = system.kinematics(), len(drawn.system.active)
    m, n = kin.J.shape
    major, rest = major_and_rest(data, m)
    W1, W2 = rng.uniform(0.5, 2, n_all), rng.uniform(0.5, 2, len(rest))
    limits = -rng.uniform(0.1, 1, n_all), rng.uniform(0.1, 1, n_all)
    v, d, v_s = 2 * rng.normal(size=len(major)), rng.normal(size=n), rng.normal(size=len(rest))
    mapping = kin.velocity_mapping(major, None, W1, W2, rate_limits=limits)
    aside = [Task.joints(W1), *([Task(rest, W2)] if rest else [])]
    hierarchy = kin.hierarchy([Task(major), aside], rate_limits=limits)
    expected = mapping.solve(v, d, v_s)
    found = hierarchy.solve([v, [d, v_s] if rest else d])
    np.testing.assert_allclose(found.rates, expected.rates, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.residuals[0], expected.residual, rtol=0, atol=1e-8)
    assert found.status is expected.status


@given(SEEDS, st.integers(2, 4))
@examples(40)
def test_three_levels_are_the_best_of_every_active_set(seed, n):
    rng = np.random.default_rng(seed)
    kin = arm(rng, 3, n).kinematics()
    lower, upper = -rng.uniform(0.1, 0.5, n), rng.uniform(0.1, 0.5, n)
    W, W1 = rng.uniform(0.5, 2, 2), rng.uniform(0.5, 2, n)
    levels = [Task([0]), Task([1, 2], W), Task.joints(W1)]
    targets = [rng.normal(size=1), rng.normal(size=2), rng.normal(size=n)]
    found = kin.hierarchy(levels, rate_limits=(lower, upper)).solve(targets)
    J = kin.J
    problem = [
        (J[:1], targets[0]),
        (W[:, None] * J[1:], W * targets[1]),
        (np.diag(W1), W1 * targets[2]),
    ]
    x = by_active_sets(problem, lower, upper)
    np.testing.assert_allclose(found.rates, x, rtol=0, atol=1e-7)
    for residual, A, target in zip(
        found.residuals, (J[:1], J[1:], np.eye(n)), targets, strict=True
    ):
        np.testing.assert_allclose(residual, target - A @ x, rtol=0, atol=1e-7)


@pytest.mark.parametrize("seed", range(30))
def test_many_levels_meet_the_conditions_of_an_optimum(seed):
    """Five levels of a redundant chain; those that repeat rows of earlier ones among them."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 13))
    kin = arm(rng, 6, n).kinematics()
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    rows = [rng.choice(6, rng.integers(1, 3), replace=False).tolist() for _ in range(5)]
    targets = [rng.normal(size=len(each)) for each in rows]
    found = kin.hierarchy([Task(each) for each in rows], rate_limits=limits).solve(targets)
    levels = [(kin.J[each], target) for each, target in zip(rows, targets, strict=True)]
    assert certificate(levels, *limits, found.rates).worst < 1e-9


@given(SEEDS, st.integers(2, 6), st.booleans())
def test_an_interval_is_met_after_the_levels_before_it(seed, n, first):
    """As intervals of lexicographic least squares on the rows of the mechanism."""
    rng = np.random.default_rng(seed)
    kin = arm(rng, 3, n).kinematics()
    low = rng.normal(size=2)
    interval, v = (low, low + rng.uniform(0, 0.5, 2)), rng.normal(size=1)
    levels, targets = [Task([0]), Task([1, 2], interval=True)], [v, interval]
    problem: list[Any] = [(kin.J[:1], v), (kin.J[1:], *interval)]
    order = slice(None, None, -1 if first else 1)
    found = kin.hierarchy(levels[order], rate_limits=(-0.4, 0.4)).solve(targets[order])
    expected = lexicographic_least_squares(problem[order], -0.4, 0.4)
    np.testing.assert_allclose(found.rates, expected.x, rtol=0, atol=1e-9)
    lacking = found.residuals[0 if first else 1]
    np.testing.assert_allclose(
        lacking, np.clip(kin.J[1:] @ found.rates, *interval) - kin.J[1:] @ found.rates, atol=1e-12
    )


@given(systems(actives=(2, 4)), SEEDS)
@examples(40)
def test_what_is_given_for_all_actuators_is_cut_to_the_survivors(drawn, seed):
    rng, n = np.random.default_rng(seed), len(drawn.system.active)
    kin = drawn.system.with_failures(locked=[0]).kinematics()
    W, limits = rng.uniform(0.5, 2, n), (-rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n))
    R = rng.normal(size=(1, n)), -0.1, 0.1
    wide = kin.hierarchy([Task([0]), Task.joints(W)], rate_limits=limits, rate_rows=R, tie_metric=W)
    cut = kin.hierarchy(
        [Task([0]), Task.joints(W[1:])],
        rate_limits=(limits[0][1:], limits[1][1:]),
        rate_rows=(R[0][:, 1:], *R[1:]),
        tie_metric=W[1:],
    )
    found = wide.solve([rng.normal(size=1), None])
    np.testing.assert_array_equal(found.rates, cut.solve([*found.targets[0], None]).rates)
    assert found.status is not Status.INFEASIBLE
    assert abs(R[0][:, 1:] @ found.rates) < 0.1 + 1e-12
    assert np.all(abs(kin.active_constraint @ found.rates) < 1e-11)


@pytest.mark.parametrize(
    ("target", "more", "status"),
    [
        ([0.5, 0.5], {}, Status.EXACT),
        ([3.0, 0.5], {}, Status.LIMITED),
        ([0.5, 0.5], {"rate_rows": (np.ones((1, 2)), 3.0, 4.0)}, Status.INFEASIBLE),
    ],
)
def test_the_status_is_that_of_the_first_level(target, more, status):
    system = ConstrainedSystem(np.eye(2), None, [0, 1])
    levels = [Task([0, 1]), Task.joints()]
    found = (
        system.kinematics().hierarchy(levels, rate_limits=(-1, 1), **more).solve([target, [9, 9]])
    )
    assert found.status is status
    assert (abs(found.rates) <= 1).all()


def test_a_task_out_of_reach_is_least_squares_and_self_motion_is_named():
    reach = ConstrainedSystem(np.ones((2, 2)), None, [0, 1]).kinematics()
    found = reach.hierarchy([Task([0, 1])], rate_limits=(-9, 9)).solve([[1.0, 0.0]])
    assert found.status is Status.LEAST_SQUARES
    np.testing.assert_allclose(found.residuals[0], [0.5, -0.5], atol=1e-12)
    loose = ConstrainedSystem(np.eye(2), None, [0]).kinematics()
    assert loose.hierarchy([Task([1])]).solve([[1.0]]).status is Status.SELF_MOTION
    assert loose.hierarchy([Task([0])]).solve([[1.0]]).status is Status.EXACT


def test_the_solution_of_the_tick_before_is_a_start():
    rng, steps = np.random.default_rng(0), np.zeros(2)
    for _ in range(20):
        kin = arm(rng, 4, 7).kinematics()
        hierarchy = kin.hierarchy([Task([0, 1]), Task([2, 3])], rate_limits=(-0.3, 0.3))
        targets = [rng.normal(size=2), rng.normal(size=2)]
        begun, moved = hierarchy.solve(targets), [1.01 * each for each in targets]
        cold, warm = hierarchy.solve(moved), hierarchy.solve(moved, start=begun)
        np.testing.assert_allclose(warm.rates, cold.rates, rtol=0, atol=1e-9)
        steps += cold.point.steps[0], warm.point.steps[0]
    assert steps[1] < steps[0]


def test_hierarchies_and_their_solutions_keep_copies():
    W, low, v = np.ones(2), -np.ones(2), np.array([2.0, 0.5])
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    hierarchy = kin.hierarchy([Task([0, 1], W)], rate_limits=(low, 1.0))
    found = hierarchy.solve([v])
    W[:], low[:], v[:] = 5.0, -9.0, 9.0
    np.testing.assert_allclose(hierarchy([[-2.0, 0.5]]), [-1, 0.5], atol=1e-15)
    np.testing.assert_allclose(found.residuals[0], [1.0, 0.0], atol=1e-15)


GOOD: dict[str, Any] = {"levels": [Task([0])]}


@pytest.mark.parametrize(
    ("named", "arguments"),
    [
        ("levels", {"levels": []}),
        ("levels[0]", {"levels": [[]]}),
        ("levels[0]", {"levels": [[0, 1]]}),
        ("levels", {"levels": Task([0])}),
        ("levels[1]", {"levels": [Task([0]), [Task([0], interval=True), Task([1])]]}),
        ("rows of levels[0]", {"levels": [Task([7])]}),
        ("weight of levels[0]", {"levels": [Task([0], np.ones(3))]}),
        ("rate_limits", {"rate_limits": (1.0, 0.0)}),
        ("rate_rows", {"rate_rows": (np.ones((1, 3)), 0.0, 1.0)}),
        ("tie_metric", {"tie_metric": np.ones(3)}),
    ],
)
def test_wrong_levels_are_named_in_one_sentence(named, arguments):
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    with pytest.raises((ValueError, TypeError), match="must") as error:
        kin.hierarchy(**(GOOD | arguments))
    assert str(error.value).startswith(named)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("named", "targets"),
    [
        ("targets", []),
        ("targets", 1.0),
        ("targets[0]", [[1.0, 2.0], [1.0]]),
        ("targets[0]", [[np.nan], [(0, 1)]]),
        ("targets[1]", [[1.0], 1.0]),
        ("targets[1]", [[1.0], (1.0, 0.0)]),
    ],
)
def test_wrong_targets_are_named_in_one_sentence(named, targets):
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    hierarchy = kin.hierarchy([Task([0]), Task([1], interval=True)])
    with pytest.raises((ValueError, TypeError), match="must") as error:
        hierarchy.solve(targets)
    assert str(error.value).startswith(named)
    assert "\n" not in str(error.value)
