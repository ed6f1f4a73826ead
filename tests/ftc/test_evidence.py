"""What is compiled of the evidence, against sums of numpy; and what a step leaves as it was."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from argument_checks.records import changed
from ftc.fdi import Uncertainty
from ftc.fdi.bank import EXTRA, Evidence, hypothesis_bank
from ftc.fdi.observer import Parameters
from kernels import lib, pointer
from tests.cart_runs import ONSETS, Record, carts, sample_of

WRONG = Uncertainty(0.1, 0.1, 0.2, 0.05, delay_s=2e-3, command=30.0, supply=0.2, scale=0.4)
ARRAYS = ("X", "memory", "information", "score", "energy")
P, ORDER = 2, 3
seeds = pytest.mark.parametrize("seed", range(3))


def filters(seed: int) -> np.ndarray:
    """Of all hypotheses but the last, and of that, (2, q + 1, p)."""
    return np.random.default_rng([seed, 1]).uniform(0.1, 1.0, (2, ORDER + 1, P))


def stepped(seed: int, *, keeps: bool, weighs: bool = True) -> list[tuple[Evidence, list]]:
    """Evidence after each sample, and copies of its arrays made then."""
    rng = np.random.default_rng(seed)
    record = Record.of(carts(seed), 2, seed)
    bank = hypothesis_bank(record.nominal, (), WRONG, 2)
    rows, s = bank.believed.M.shape[:2]
    prior = Parameters.prior(rows - 1, P, WRONG)
    memory = rng.normal(size=(ORDER + 1, rows, P))
    state = bank.start(ONSETS, prior, np.zeros((rows, s)), memory)
    plain, decoupled = filters(seed)
    found, before = [], np.zeros(record.u.shape[1])
    for sample, (u, y) in enumerate(zip(record.u, record.y, strict=True)):
        v = np.concatenate([u, before, [1.0]])
        given = sample_of(sample, v, y, is_whole=weighs), 1.5, plain, decoupled
        state = bank.step(state, *given, keeps=keeps)
        found.append((state, [getattr(state, name).copy() for name in ARRAYS]))
        before = u
    return found


@seeds
def test_a_step_leaves_the_evidence_before_it_and_gives_the_same_in_place(seed):
    """Whoever keeps a state may step from it again."""
    kept, in_place = (stepped(seed, keeps=keeps) for keeps in (True, False))
    for (state, then), (_, other) in zip(kept, in_place, strict=True):
        for name, array, same in zip(ARRAYS, then, other, strict=True):
            np.testing.assert_array_equal(getattr(state, name), array)
            np.testing.assert_array_equal(same, array)


@seeds
def test_each_sample_adds_the_products_of_its_whitened_regressors(seed):
    """Of those that are stepped; from its onset on, to what the first hypothesis has."""
    weights = filters(seed)
    states = [state for state, _ in stepped(seed, keeps=True)]
    R = states[0].score.shape[-1]
    J, lower = R - P - EXTRA, np.tril_indices(R)
    for sample, (old, new) in enumerate(pairwise(states), 1):
        H, K = old.energy.shape
        for h, k in np.ndindex(H, K):
            sound = h in (0, H - 1)
            if (sound and k) or (not sound and ONSETS[k] > sample):
                continue
            g, b = (0, 0) if not sound and ONSETS[k] == sample else (h, k)
            filter_ = weights[int(h == H - 1)]
            memory = new.memory[h, k]
            np.testing.assert_array_equal(memory[:-1], old.memory[g, b, 1:])
            white = np.einsum("qp,qrp->rp", filter_[::-1], memory)
            offsets = np.diag(filter_.sum(axis=0))
            rows = np.concatenate([white[1 : 1 + J], offsets, white[1 + J :]])
            added = {
                "information": (rows @ rows.T)[lower],
                "score": rows @ white[0],
                "energy": white[0] @ white[0],
            }
            for name, each in added.items():
                expected = getattr(old, name)[g, b] + each
                tiny = 1e-12 * np.abs(expected).max()
                found = getattr(new, name)[h, k]
                np.testing.assert_allclose(found, expected, rtol=1e-12, atol=tiny, err_msg=name)


@seeds
def test_a_sample_that_is_no_evidence_adds_none(seed):
    for state, _ in stepped(seed, keeps=True, weighs=False):
        for name in ARRAYS[2:]:
            assert not getattr(state, name).any()


def test_a_changed_record_is_the_one_that_dataclasses_make():
    state, _ = stepped(0, keeps=True)[-1]
    after = changed(state, samples=7, gain=0.5)
    assert type(after) is Evidence and vars(after) == vars(replace(state, samples=7, gain=0.5))
    assert state.samples != 7


def integrated(information: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse (R, 3) for three right-hand sides, and half of the log of the determinant."""
    R = len(spread)
    solved, log_det = np.eye(R)[None, None, :, :3].copy(), np.empty((1, 1))
    given = pointer(information[np.tril_indices(R)]), pointer(spread)
    room = pointer(np.empty(R * (2 * R + 1)))
    lib.integrate_out(1, R, *given, room, pointer(solved), pointer(log_det))
    return solved[0, 0], log_det[0, 0]


@seeds
def test_what_is_integrated_out_is_the_inverse_and_the_determinant_of_lapack(seed):
    rng = np.random.default_rng(seed)
    rows, spread = rng.normal(size=(9, 30)), np.tril(rng.normal(size=(9, 9)))
    S = np.eye(9) + spread.T @ rows @ rows.T @ spread
    solved, log_det = integrated(rows @ rows.T, spread)
    np.testing.assert_allclose(solved, np.linalg.inv(S)[:, :3], rtol=1e-9, atol=1e-12)
    assert log_det == pytest.approx(np.linalg.slogdet(S)[1] / 2, rel=1e-12)


@seeds
def test_information_that_rounding_made_indefinite_leaves_finite_numbers(seed):
    """Regressors a trillion times the noise: 1 is lost beside their squares, and pivots are not."""
    rows = 1e12 * np.random.default_rng(seed).normal(size=(9, 2))
    information = rows @ rows.T
    assert np.linalg.eigvalsh(np.eye(9) + information)[0] < 0
    solved, log_det = integrated(information, np.eye(9))
    assert np.isfinite(solved).all() and log_det > 0
