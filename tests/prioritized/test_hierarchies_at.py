"""A hierarchy at another pose is the one made there, and its certificate of ranks is one."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Task
from prioritized._mechanism.ordered import Directions, all_exceed
from tests.profiles import examples
from tests.random_systems import SEEDS, failures, major_and_rest, orthogonal, systems


class Measured:
    """Exact entries, in units of rad for some task rows and velocities and of m for the others."""

    error_bound = 0.0
    extremes = ((1.0, 0.4), (1.0, 1.0), (1.0, 0.4))

    def __init__(self, rng: np.random.Generator, m: int, c: int, N: int) -> None:
        self.task_units, self.velocity_units = rng.choice([1.0, 0.4], m), rng.choice([1.0, 0.4], N)
        self.constraint_units = np.ones(c)
        self.J_T_error, self.J_C_error = np.zeros((m, N)), np.zeros((c, N))


def assert_same(found: Any, expected: Any, targets: list[Any]) -> None:
    """Not a bit of their answers differs."""
    a, b = found.solve(targets), expected.solve(targets)
    np.testing.assert_array_equal(a.rates, b.rates)
    np.testing.assert_array_equal(a.packed.A, b.packed.A)
    np.testing.assert_array_equal(a.packed.scales, b.packed.scales)
    assert (a.status, a.gap, str(a)) == (b.status, b.gap, str(b))


@given(st.data(), systems(tasks=(2, 5), actives=(2, 4)), st.integers(-18, 0), st.booleans())
@examples(100)
def test_levels_at_another_pose_are_those_made_there(data, drawn, nearness, in_metres):
    """After other failures, near singular poses, with weights of all actuators, in two units."""
    first, rng, n = drawn.system, drawn.rng, len(drawn.system.active)
    m, N = first.J_T.shape
    J_T = first.J_T.copy()
    J_T[-1] = J_T[0] + 10.0**nearness * rng.normal(size=N)
    loops = first.J_C, first.active
    units = [Measured(rng, m, len(first.J_C), N) if in_metres else None for _ in range(2)]
    here = data.draw(failures(ConstrainedSystem(first.J_T, *loops, accuracy=units[0])))
    there = ConstrainedSystem(J_T, *loops, failures=here.failures, accuracy=units[1])
    if data.draw(st.booleans()):
        there = data.draw(failures(there))
    before, there = here.kinematics(), there.kinematics()
    major, rest = major_and_rest(data, m)
    asked: dict[str, Any] = {
        "levels": [
            Task(major, rng.uniform(0.5, 2, len(major)) if rng.random() < 0.5 else None),
            *([Task(rest, damping=rng.choice([0.0, 0.1]))] if rest else []),
            Task.joints(rng.uniform(0.5, 2, n) if rng.random() < 0.5 else None),
        ]
    }
    if rng.random() < 0.5:
        asked["tie_metric"] = rng.uniform(0.5, 2, n)
    if rng.random() < 0.5:
        asked["rate_rows"] = rng.normal(size=(1, n)), -0.3, 0.3
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    v, d = rng.normal(size=m), rng.normal(size=there.J.shape[1])
    targets = [v[: len(major)], *([v[len(major) :]] if rest else []), d]
    made = before.hierarchy(**asked, rate_limits=limits)
    assert_same(made.at(there), there.hierarchy(**asked, rate_limits=limits), targets)
    narrow = 0.1 * limits[0], 0.1 * limits[1]
    assert_same(
        made.at(before).at(there, rate_limits=narrow),
        there.hierarchy(**asked, rate_limits=narrow),
        targets,
    )


def test_limits_and_rows_elsewhere_are_those_given_there():
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    here = kin.hierarchy([Task([0, 1])], rate_limits=(-1.0, 1.0))
    moved = here.at(kin, rate_rows=(np.eye(2)[:1], -0.5, 0.5))
    np.testing.assert_allclose(moved([[9.0, 9.0]]), [0.5, 1.0], atol=1e-15)
    np.testing.assert_allclose(here([[9.0, 9.0]]), [1.0, 1.0], atol=1e-15)
    again = moved.at(kin, rate_limits=(-0.2, 0.2))
    np.testing.assert_allclose(again([[9.0, 9.0]]), [0.2, 0.2], atol=1e-15)


def test_another_mechanism_is_refused_in_one_sentence():
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    here = kin.hierarchy([Task([0])])
    taller = ConstrainedSystem(np.eye(3, 2), None, [0, 1]).kinematics()
    fewer = ConstrainedSystem(np.eye(2), None, [0]).kinematics()
    for other, error in ((taller, ValueError), (fewer, ValueError), (None, TypeError)):
        with pytest.raises(error, match=r"^kinematics must"):
            here.at(other)  # pyright: ignore[reportArgumentType]


def graded(rng: np.random.Generator, rows: int, n: int) -> np.ndarray:
    """Rows with singular values spread over up to 18 decades, in random directions and sizes."""
    sigma = 10.0 ** -rng.uniform(0, rng.choice([1, 6, 13, 18]), min(rows, n))
    U, V = orthogonal(rng, rows)[:, : len(sigma)], orthogonal(rng, n)[: len(sigma)]
    return 10.0 ** rng.uniform(-3, 3, (rows, 1)) * (U * sigma @ V)


@pytest.mark.parametrize("seed", range(200))
def test_no_rank_is_certified_that_singular_values_deny(seed):
    """The verdict is that of the singular values of every stack of levels, near thresholds too."""
    rng = np.random.default_rng(seed)
    n, counts = int(rng.integers(1, 9)), [1, *rng.integers(0, 4, rng.integers(0, 3)).tolist()]
    J = graded(rng, sum(counts), n)
    levels = np.split(np.eye(sum(counts)), np.cumsum(counts)[:-1])
    scale, clear = float(np.linalg.norm(J)), float(10.0 ** rng.uniform(-12, -2))
    expected = True
    for k in range(len(levels)):
        S = np.concatenate(levels[: k + 1])
        sigma = np.linalg.svd(S @ J, compute_uv=False) / (np.linalg.norm(S) * scale)
        expected = expected and bool(((sigma > clear) | (sigma <= 1e-13)).all())
    assert Directions.of(levels).are_clear(J, scale, clear) == expected


@given(SEEDS, st.integers(1, 8), st.integers(0, 4))
@examples(100)
def test_the_bound_is_below_every_singular_value_and_within_a_factor(seed, rows, extra):
    """By bisection of what it certifies: 1 / |L^-1| in the Frobenius norm, for each part."""
    rng = np.random.default_rng(seed)
    A = graded(rng, rows, rows + extra)
    A *= 1.0 / np.linalg.norm(A, axis=1, keepdims=True)
    for end in {1, rows}:
        least = np.linalg.svd(A[:end], compute_uv=False).min()
        ends = np.array([end])
        assert not all_exceed(A.copy(), ends, np.array([least * (1 + 1e-6) + 1e-14]))
        if least > 1e-10:
            assert all_exceed(A.copy(), ends, np.array([0.99 * least / np.sqrt(end)]))
