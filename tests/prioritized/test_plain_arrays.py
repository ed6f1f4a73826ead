"""Arguments that are plain arrays skip most checks: neither results nor refusals change."""

import pickle
from collections.abc import Callable
from copy import copy, deepcopy
from typing import Any

import numpy as np
import pytest

from prioritized import lexicographic_least_squares, velocity_mapping
from prioritized._mapping.lexicographic import Solution

RNG_SEEDS = range(40)


def random_levels(rng: np.random.Generator) -> tuple[list[tuple[Any, Any]], Any, Any]:
    """One to four levels of any rank, in any order of memory, and bounds, some infinite."""
    n = int(rng.integers(1, 8))
    levels = []
    for rows in rng.integers(1, 6, size=rng.integers(1, 5)):
        rank = int(rng.integers(1, min(rows, n) + 1))
        A = rng.normal(size=(rows, rank)) @ rng.normal(size=(rank, n))
        levels.append((np.asfortranarray(A) if rng.random() < 0.5 else A, rng.normal(size=rows)))
    lower, upper = -rng.uniform(0.0, 1.0, size=n), rng.uniform(0.0, 1.0, size=n)
    lower[rng.random(n) < 0.3] = -np.inf
    upper[rng.random(n) < 0.3] = np.inf
    return levels, lower, upper


def checked(levels: Any, lower: Any = None, upper: Any = None) -> Solution:
    """Every level in a list, which takes the way through all checks."""
    lists: list[Any] = [list(level) for level in levels]
    return lexicographic_least_squares(lists, lower, upper)


@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_levels_have_the_same_solution_however_they_are_given(seed):
    levels, lower, upper = random_levels(np.random.default_rng(seed))
    for bounds in ((lower, upper), (None, upper), (lower, None), (None, None)):
        plain, other = lexicographic_least_squares(levels, *bounds), checked(levels, *bounds)
        np.testing.assert_allclose(plain.x, other.x, rtol=0, atol=1e-12 * (1 + abs(other.x).max()))
        np.testing.assert_array_equal(plain.active, other.active)
        assert plain.status is other.status
        assert plain.levels == len(plain.residuals) == len(levels)
        for left, same in zip(plain.residuals, other.residuals, strict=True):
            np.testing.assert_allclose(left, same, rtol=0, atol=1e-11 * (1 + abs(other.x).max()))


def test_levels_are_copied():
    """What changes afterwards does not change the residuals of a solution."""
    A, b = np.eye(2), np.ones(2)
    found = lexicographic_least_squares([(A, b)], np.zeros(2), np.full(2, 0.5))
    A[:], b[:] = 7.0, 7.0
    np.testing.assert_allclose(found.residuals[0], [0.5, 0.5])


def test_true_is_no_row_though_row_1_was_taken_before():
    """They are equal, and what was looked up is found again."""
    J, w = np.random.default_rng(0).normal(size=(3, 3)), np.ones(3)
    velocity_mapping(J, [1], [0], w)
    for major, secondary in (([True], [0]), ([1], [False]), ([1.0], [0])):
        with pytest.raises((TypeError, ValueError), match=r"major|secondary"):
            velocity_mapping(J, major, secondary, w)


def test_limits_of_a_mapping_are_its_own():
    """Neither what was given nor what it shows changes them."""
    J, w, lower = np.random.default_rng(0).normal(size=(3, 3)), np.ones(3), -np.ones(3)
    mapping = velocity_mapping(J, [0], None, w, rate_limits=(lower, np.ones(3)))
    lower[:] = -9.0
    limiting = mapping._limiting
    assert limiting is not None
    np.testing.assert_array_equal(limiting.box, [[-1.0] * 3, [1.0] * 3])
    with pytest.raises(ValueError, match="read-only"):
        limiting.box[0][:] = -9.0
    assert abs(mapping(np.array([50.0]))).max() <= 1.0


A, B = np.ones((2, 3)), np.ones(2)
HOSTILE = {
    "NaN in A": [(A * np.nan, B)],
    "infinite b": [(A, B * np.inf)],
    "large A": [(A * 1e130, B)],
    "small A": [(A * 1e-130, B)],
    "smaller than any square": [(A * 1e-200, B)],
    "large b": [(A, B * 1e130)],
    "b too long": [(A, np.ones(3))],
    "b of two axes": [(A, np.ones((2, 1)))],
    "another width": [(A, B), (np.ones((2, 4)), B)],
    "a vector": [(A, B), (np.ones(3), np.ones(3))],
    "numbers": [(np.array(1.0), np.array(1.0))],
    "booleans": [(A > 0, B)],
    "complex": [(A + 0j, B)],
    "masked": [(np.ma.masked_greater(A, 0), B)],
    "three axes": [(np.ones((2, 3, 3)), B)],
}


@pytest.mark.parametrize("name", HOSTILE)
def test_levels_are_refused_with_the_same_sentence(name):
    levels = HOSTILE[name]
    with pytest.raises(ValueError, match="levels") as expected:
        checked(levels)
    with pytest.raises(ValueError, match="levels") as raised:
        lexicographic_least_squares(levels)
    assert str(raised.value) == str(expected.value)


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        (np.ones(3), np.zeros(3)),
        (np.full(3, np.nan), np.ones(3)),
        (np.full(3, np.inf), np.full(3, np.inf)),
        (np.zeros(2), np.ones(2)),
        (np.zeros(3), np.full(3, 1e130)),
        (np.zeros(3, dtype=bool), np.ones(3)),
        (np.zeros((1, 3)), np.ones((1, 3))),
    ],
)
def test_bounds_are_refused_with_the_same_sentence(lower, upper):
    with pytest.raises(ValueError, match="lower and upper") as expected:
        checked([(A, B)], lower, upper)
    with pytest.raises(ValueError, match="lower and upper") as raised:
        lexicographic_least_squares([(A, B)], lower, upper)
    assert str(raised.value) == str(expected.value)


@pytest.mark.parametrize("other", [(A.astype(int), B), (A.astype("f4"), B), (A.astype(">f8"), B)])
def test_other_numbers_are_taken_as_they_are(other):
    np.testing.assert_array_equal(
        lexicographic_least_squares([other]).x, lexicographic_least_squares([(A, B)]).x
    )


@pytest.mark.parametrize("kind", ["i8", "f4", ">f8"])
def test_a_mapping_takes_other_numbers_than_float64(kind):
    """Integers and other floats go through the checks, and give the same rates."""
    J, w, v = np.array([[1, 2, 0], [0, 1, 3]]), np.array([1, 2, 3]), np.ones(1)
    expected = velocity_mapping(J.astype(float), [0], joint_weight=w.astype(float))(v)
    found = velocity_mapping(J.astype(kind), [0], joint_weight=w.astype(kind))(v)
    np.testing.assert_allclose(found, expected, atol=1e-15)
    np.testing.assert_allclose(
        velocity_mapping(J.astype(float), [0], joint_weight=np.diag(w.astype(float)))(v),
        expected, atol=1e-15,
    )  # fmt: skip


def test_rates_within_limits_are_those_of_the_solution():
    """A call gives the rates of `solve`, with limits that bind or do not."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        J, weight, limit = rng.normal(size=(4, 5)), rng.uniform(0.5, 2.0, 5), rng.uniform(0.1, 3.0)
        limits = (np.full(5, -limit), np.full(5, limit))
        mapping = velocity_mapping(J, [0, 1], joint_weight=weight, rate_limits=limits)
        v, joint = rng.normal(size=2), rng.normal(size=5)
        solution = mapping.solve(v, joint)
        np.testing.assert_allclose(mapping(v, joint), solution.rates, rtol=0, atol=1e-13)
        assert np.all(np.abs(solution.rates) <= limit)


def test_a_mapping_takes_arrays_in_any_order_of_memory():
    rng = np.random.default_rng(1)
    J, w, limits = rng.normal(size=(4, 6)), np.full(6, 2.0), (np.full(6, -0.5), np.full(6, 0.5))

    def strided(A: np.ndarray) -> np.ndarray:
        return np.repeat(A, 2)[::2] if A.ndim == 1 else np.asfortranarray(A)

    plain = velocity_mapping(J, [0, 1], joint_weight=w, rate_limits=limits)
    lower, upper = map(strided, limits)
    other = velocity_mapping(
        strided(J), [0, 1], joint_weight=strided(w), rate_limits=(lower, upper)
    )
    v, desired = rng.normal(size=2), rng.normal(size=6)
    np.testing.assert_array_equal(other(strided(v), strided(desired)), plain(v, desired))


@pytest.mark.parametrize("how", [copy, deepcopy, lambda A: pickle.loads(pickle.dumps(A))])
@pytest.mark.parametrize("weight", [np.full(6, 2.0), np.diag(np.full(6, 2.0)) + 0.1])
def test_a_copy_of_a_mapping_answers_the_same(how: Callable[[Any], Any], weight: np.ndarray):
    J, v = np.random.default_rng(2).normal(size=(4, 6)), np.array([0.3, -0.2])
    mapping = velocity_mapping(J, [0, 1], joint_weight=weight, rate_limits=(-0.1, 0.1))
    rates, copied = mapping(v), how(mapping)
    np.testing.assert_array_equal(copied(v), rates)
    np.testing.assert_array_equal(copied.solve(v).rates, mapping.solve(v).rates)
