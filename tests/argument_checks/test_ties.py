"""Test the rule for ties against integers, which are exact, and canonical bases of subspaces."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from argument_checks.ties import ascending, exceeds, greatest, least, ranks
from prioritized import canonical_basis
from tests.random_systems import SEEDS, bits, orthogonal

ROOT = Path(__file__).parents[2]
FEW = st.lists(st.integers(-3, 3), min_size=1, max_size=12)
"""Numbers with many ties."""


@given(FEW, SEEDS, st.sampled_from([1e-9, 1.0, 1e12]))
def test_the_last_bits_do_not_affect_choices(numbers, seed, unit):
    """Compare with the integers that the numbers were computed from."""
    exact, x = np.array(numbers), bits(np.random.default_rng(seed), unit * np.array(numbers))
    assert greatest(x) == exact.argmax() and least(x) == exact.argmin()
    np.testing.assert_array_equal(ascending(x), np.argsort(exact, kind="stable"))
    np.testing.assert_array_equal(ascending(-x), np.argsort(-exact, kind="stable"))
    np.testing.assert_array_equal(ranks(x), np.unique(exact, return_inverse=True)[1])
    np.testing.assert_array_equal(exceeds(x, x[0]), exact > exact[0])


@given(FEW, SEEDS)
def test_a_second_key_decides_among_equals_and_then_the_order(numbers, seed):
    rng = np.random.default_rng(seed)
    second = rng.integers(0, 3, size=len(numbers))
    result = ascending(bits(rng, np.array(numbers)), bits(rng, second))
    expected = sorted(range(len(numbers)), key=lambda k: (numbers[k], second[k]))
    assert result.tolist() == expected


@given(SEEDS)
def test_cancelled_terms_are_zero_within_a_stated_size(seed):
    noise = 1e-16 * np.random.default_rng(seed).normal(size=6)
    assert greatest(noise, zero=1e-12) == least(noise, zero=1e-12) == 0
    assert ascending(noise, zero=1e-12).tolist() == list(range(6))
    assert not exceeds(noise, 0.0, zero=1e-12).any()


def test_infinite_numbers_equal_themselves_alone_and_nan_is_last():
    x = [1.0, np.inf, -np.inf, np.inf, 1e300]
    assert greatest(x) == 1 and least(x) == 2
    assert ascending([*x, np.nan, 0.0]).tolist() == [2, 6, 0, 4, 1, 3, 5]
    assert greatest([*x, np.nan]) == 5 and not exceeds(np.nan, 0.0) and not exceeds(np.inf, np.inf)
    assert ranks([]).tolist() == []


@given(SEEDS, st.integers(1, 8), st.integers(0, 8))
def test_a_subspace_has_one_basis(seed, N, k):
    """Check random orthonormal bases of one subspace; in a batch, zero columns come last."""
    k, rng = min(k, N), np.random.default_rng(seed)
    columns, turn = orthogonal(rng, N)[:, :k], orthogonal(rng, k)
    basis = canonical_basis(columns)
    np.testing.assert_allclose(canonical_basis(columns @ turn), basis, atol=1e-12)
    np.testing.assert_allclose(basis @ basis.T, columns @ columns.T, atol=1e-14)
    np.testing.assert_allclose(basis.T @ basis, np.eye(k), atol=1e-14)
    padded = np.hstack([np.zeros((N, 1)), columns, np.zeros((N, 1))])
    in_batch = canonical_basis(np.stack([padded, 0 * padded]))
    np.testing.assert_allclose(in_batch[0, :, :k], basis, atol=1e-14)
    assert not in_batch[0, :, k:].any() and not in_batch[1].any()


@pytest.mark.parametrize("basis", [1.0, [1.0, 0.0], [[np.nan]], [[2.0]], [[1.0, 0.5], [0.0, 0.8]]])
def test_an_invalid_basis_raises(basis):
    with pytest.raises(ValueError, match=r"^basis must"):
        canonical_basis(basis)


def test_the_basis_of_everything_is_that_of_the_axes():
    turn = orthogonal(np.random.default_rng(0), 5)
    np.testing.assert_allclose(canonical_basis(turn), np.eye(5), atol=1e-14)


@given(SEEDS, st.integers(2, 8))
def test_equal_coordinates_are_selected_in_order(seed, N):
    """Check the complement of (1, ..., 1), whose coordinates are equivalent."""
    rng = np.random.default_rng(seed)
    columns = np.linalg.svd(bits(rng, np.ones((1, N))))[2][1:].T @ orthogonal(rng, N - 1)
    basis = canonical_basis(columns)
    assert basis[0, 0] == pytest.approx(np.sqrt(1 - 1 / N))
    np.testing.assert_allclose(np.triu(basis, 1), 0.0, atol=1e-12)


def test_no_array_method_bypasses_the_rule_for_ties():
    """Search for array methods such as argmax: ruff bans the numpy functions only."""
    folders = ("argument_checks", "prioritized", "sim", "ftc", "fjh", "experiments")
    files = [file for folder in folders for file in (ROOT / folder).rglob("*.py")]
    method = re.compile(r"(?<!\bnp)\.(argmax|argmin|argsort|argpartition)\(")
    assert [str(file) for file in files if method.search(file.read_text())] == []
