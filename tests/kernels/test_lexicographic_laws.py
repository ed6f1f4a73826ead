"""Laws of the solver of levels under bounds: what changes nothing, what is the same as what."""

from typing import Any

import numpy as np
import pytest

from tests.kernels.batches import (
    RANK,
    Batch,
    Found,
    Known,
    assert_alike,
    enumerated,
    kernel,
    random_batch,
    sizes,
    times,
    unlimited,
)

COUNT = 150


@pytest.fixture(scope="module")
def drawn() -> tuple[Batch, Known, np.random.Generator]:
    rng = np.random.default_rng(0)
    batch = random_batch(rng, COUNT, 4, (2, 3))
    return batch, enumerated(batch), rng


def test_permuting_unknowns_permutes_x(drawn):
    batch, known, rng = drawn
    order = rng.permutation(4)
    levels = [(A[..., order], b) for A, b in batch.levels]
    other = kernel(Batch(levels, batch.lower[:, order], batch.upper[:, order]))
    assert_alike(batch, other.x[:, np.argsort(order)], known)


def test_a_level_has_no_unit(drawn):
    """Times a power of two no bit changes, times any positive number round-off does."""
    batch, known, rng = drawn
    shape = 2, COUNT
    for factor in (2.0 ** rng.integers(-300, 300, shape), 10 ** rng.uniform(-90, 90, shape)):
        levels = [
            (A * f[:, None, None], b * f[:, None])
            for (A, b), f in zip(batch.levels, factor, strict=True)
        ]
        found = kernel(batch.with_levels(*levels))
        assert_alike(batch, found.x, known)
        if (np.frexp(factor)[0] == 0.5).all():
            assert_same(found, kernel(batch))


def assert_same(found: Found, other: Found) -> None:
    """In every bit."""
    for name, a, b in zip(Found._fields, found, other, strict=True):
        assert a.tobytes() == b.tobytes(), name


def test_an_orthogonal_change_of_the_rows_of_a_level_changes_nothing(drawn):
    batch, known, rng = drawn
    turned = []
    for A, b in batch.levels:
        Q = np.linalg.qr(rng.normal(size=(COUNT, len(b[0]), len(b[0]))))[0]
        turned.append((Q @ A, times(Q, b)))
    assert_alike(batch, kernel(batch.with_levels(*turned)).x, known)


@pytest.mark.parametrize("size", [2.0**-300, 2.0**300, 3e-90, 7e90])
def test_x_scales_with_bounds_and_targets(drawn, size):
    batch, known, _ = drawn
    levels = [(A, b * size) for A, b in batch.levels]
    found = kernel(Batch(levels, batch.lower * size, batch.upper * size))
    assert_alike(batch, found.x / size, known)
    if size in (2.0**-300, 2.0**300):
        assert_same(found._replace(x=found.x / size), kernel(batch))


def test_equal_bounds_are_kept_exactly(drawn):
    batch, *_ = drawn
    equal = batch.lower == batch.upper
    assert equal.sum() > 20
    np.testing.assert_array_equal(kernel(batch).x[equal], batch.lower[equal])


def test_a_batch_has_the_bits_of_its_problems_one_by_one(drawn):
    """And one pair of bounds for all is as good as a pair for each."""
    batch, *_ = drawn
    common = Batch(batch.levels, batch.lower[:1], batch.upper[:1])
    same = Batch(
        batch.levels, *(np.repeat(side[:1], COUNT, 0) for side in (batch.lower, batch.upper))
    )
    assert_same(kernel(common), kernel(same))
    whole = kernel(batch)
    for k in range(0, COUNT, 5):
        only = slice(k, k + 1)
        levels = [(A[only], b[only]) for A, b in batch.levels]
        alone = kernel(Batch(levels, batch.lower[only], batch.upper[only]))
        assert_same(alone, Found(*(each[only] for each in whole)))


def test_the_answer_does_not_depend_on_what_is_in_the_room_for_work(drawn):
    batch, *_ = drawn
    weights = [np.array(each) for each in ([1.0, 2.0, 3.0, 4.0], [1.0, 1.0, 0.0, 0.0])]
    kinds: list[dict[str, Any]] = [{}, {"beside": True}, {"damping": [0.1, 0.2]}]
    kinds += [{"weight": each} for each in weights]
    for others in kinds:
        assert_same(kernel(batch, room=np.nan, **others), kernel(batch, room=1e300, **others))


def test_running_out_of_steps_leaves_x_within_the_bounds_and_says_so(drawn):
    batch, *_ = drawn
    whole, unfinished = kernel(batch), 0
    for most in range(6):
        found = kernel(batch, most=most)
        assert np.isfinite(found.x).all()
        np.testing.assert_array_equal(found.ended, whole.steps <= most)
        np.testing.assert_array_equal(found.x[found.ended], whole.x[found.ended])
        assert (found.steps <= most).all()
        unfinished += np.count_nonzero(~found.ended)
    assert unfinished > COUNT


def right_singular(A: np.ndarray) -> np.ndarray:
    """Rows V^T of the singular values that are not zero, padded by zero rows."""
    _, sigma, Vt = np.linalg.svd(A, full_matrices=False)
    return Vt * (sigma > 1e-8 * sigma.max(axis=1, keepdims=True))[..., None]


def damped(
    A: np.ndarray, b: np.ndarray, V: np.ndarray, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    zero = np.zeros(V.shape[:2])
    return np.concatenate([A, damping * V], axis=1), np.concatenate([b, zero], axis=1)


def of_rank_two(rng: np.random.Generator, count: int, n: int, k: int) -> np.ndarray:
    return rng.normal(size=(count, k, 2)) @ rng.normal(size=(count, 2, n))


@pytest.mark.parametrize("size", [1.0, 1e5])
def test_damping_a_level_appends_rows_damping_times_its_right_singular_vectors(size):
    """Of its rows on what the levels before leave; under bounds, for the first level."""
    rng, n = np.random.default_rng(0), 6
    A, b = size * of_rank_two(rng, 100, n, 3), size * rng.normal(size=(100, 3))
    A2, b2 = of_rank_two(rng, 100, n, 2), rng.normal(size=(100, 2))
    side = rng.uniform(0.01, 0.3, (100, n))
    V = right_singular(A)
    V2 = right_singular(A2 @ (np.eye(n) - V.mT @ V))
    batch = Batch([(A, b)], -side, side)
    first = damped(A, b, V, 0.3 * size)
    expected = kernel(batch.with_levels(first)).x
    np.testing.assert_allclose(kernel(batch, damping=[0.3 * size]).x, expected, atol=1e-9)
    assert abs(kernel(batch).x - expected).max() > 1e-2
    batch = unlimited(batch.with_levels((A, b), (A2, b2)))
    found = kernel(batch, damping=[0.3 * size, 0.2]).x
    second = damped(A2, b2, V2, 0.2)
    np.testing.assert_allclose(found, kernel(batch.with_levels(first, second)).x, atol=1e-9)
    # The first level is met within the bounds, the second is held back by them.
    met = A, times(A, 0.3 * side)
    batch = Batch([met, (A2, b2)], -side, side)
    found = kernel(batch, damping=[0.0, 0.2]).x
    np.testing.assert_allclose(found, kernel(batch.with_levels(met, second)).x, atol=1e-9)
    assert (abs(found) == side).any(axis=1).mean() > 0.5
    assert abs(kernel(batch).x - found).max() > 1e-2


def unit_last(batch: Batch) -> Batch:
    """The size of the last level one, that of zero rows zero."""
    *first, (A, b) = batch.levels
    size = np.where(sizes(A) > 0, sizes(A), 1.0)
    return batch.with_levels(*first, (A / size[:, None, None], b / size[:, None]))


def test_the_norm_beside_the_last_level_is_the_identity_stacked_on_it(drawn):
    batch = unit_last(drawn[0])
    first, (A, b) = batch.levels
    identity = np.broadcast_to(np.eye(4), (COUNT, 4, 4))
    stacked = batch.with_levels(first, damped(A, b, identity, 1.0))
    assert_alike(stacked, kernel(batch, beside=True).x, enumerated(stacked))


WEIGHTS = [
    [1.0, 0.0, 0.0, 0.0],
    [1.0, 1.0, 1.0, 0.0],
    [0.5, 1.0, 2.0, 3.0],
    [0.01, 1.0, 1.0, 100.0],
]


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize("weight", WEIGHTS)
def test_a_weighted_norm_is_its_rows_after_the_last_level_or_in_it(drawn, weight, beside):
    batch, w = unit_last(drawn[0]), np.array(weight)
    wanted = np.random.default_rng(0).normal(size=batch.lower.shape)
    rows, goal = np.broadcast_to(np.diag(w), (COUNT, 4, 4)), w * wanted
    first, (A, b) = batch.levels
    last = [(np.concatenate([A, rows], axis=1), np.concatenate([b, goal], axis=1))]
    more = batch.with_levels(first, *(last if beside else [(A, b), (rows, goal)]))
    found, known = kernel(batch, weight=w, wanted=wanted, beside=beside).x, enumerated(more)
    clear = known.gap > 100
    weighed = np.linalg.norm(w * (found - known.x), axis=1) / (1 + np.linalg.norm(goal, axis=1))
    assert (weighed <= 1e-10 * known.condition)[clear].all()
    for k in range(2 - beside):
        (got, size), (best, _) = batch.residuals(k, found), batch.residuals(k, known.x)
        assert (np.abs(got - best) <= 1e-10 * known.condition * size)[clear].all()


def test_the_gap_is_at_least_one_and_below_that_of_the_singular_values():
    """And not below for nothing: within 20 of it. Where it is large, the rank is right."""
    rng, n = np.random.default_rng(0), 5
    sigma = 10.0 ** rng.uniform(-13, 0, (500, n))
    sigma[:, 0] = 1.0
    U, V = (np.linalg.qr(rng.normal(size=(500, n, n)))[0] for _ in range(2))
    A, b = (U * sigma[:, None]) @ V.mT, rng.normal(size=(500, n))
    found = kernel(unlimited(Batch([(A, b)], b, b)))
    least = RANK * sizes(A)[:, None]
    true = np.maximum(sigma / least, least / sigma).min(axis=1)
    assert (found.gap >= 1).all()
    assert (found.gap <= 1.01 * true).all()
    assert (found.gap >= true / 20).all()
    inverse = np.where(sigma > least, 1 / sigma, 0.0)
    x = times(V, inverse * times(U.mT, b))
    # What is left out, up to RANK of the size, turns the others.
    large = inverse.max(axis=1)
    off = np.linalg.norm(found.x - x, axis=1) / np.linalg.norm(x, axis=1)
    assert (off < 10 * RANK * large**2 + 1e-13 * large)[true > 1.01].all()
