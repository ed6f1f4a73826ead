"""Feedforward by the inverse of a linear model: the response is the path."""

from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import toeplitz

from ftc import inverse_feedforward
from ftc.fdi import NominalModel, fault_model
from ftc.feedforward import WEIGHT

PERIOD_S = 2e-3


def modes(frequency: Any, damping: Any, B: np.ndarray, C: np.ndarray) -> NominalModel:
    """Return the model of modes q'' = -w^2 q - 2 zeta w q' + B u, outputs C q, w in rad/s."""
    w, k = np.asarray(frequency, float), len(frequency)
    A = np.block([[np.zeros((k, k)), np.eye(k)], [np.diag(-(w**2)), np.diag(-2 * damping * w)]])
    plant = control.ss(A, np.vstack([0 * B, B]), np.hstack([C, 0 * C]), 0)
    displacement = np.zeros((B.shape[1], 2 * k))
    return NominalModel(plant, displacement, np.ones(len(C)), PERIOD_S, PERIOD_S)


def response(nominal: NominalModel, gain: np.ndarray, demands: np.ndarray) -> np.ndarray:
    """Return the response from rest by python-control."""
    model = fault_model(nominal)
    plant = control.ss(model.A, model.B @ gain, nominal.plant.C, 0, PERIOD_S)
    time_s = np.arange(len(demands)) * PERIOD_S
    return control.forced_response(plant, time_s, demands.T, squeeze=False).outputs.T


def servos(seed: int) -> tuple[NominalModel, np.ndarray]:
    """Return three coupled servos with lags of 0.05 to 0.2 s and two outputs, and their gain."""
    rng = np.random.default_rng(seed)
    w, zeta = rng.uniform(60.0, 100.0, 3), rng.uniform(2.0, 6.0, 3)
    C = rng.normal(size=(2, 3))
    return modes(w, zeta, np.diag(w**2), C), np.linalg.pinv(C)


def circle(turn_s: float = 1.0, ticks: int = 250) -> np.ndarray:
    """Return a circle that starts at rest [m]."""
    time_s = np.arange(ticks) * PERIOD_S
    angle = 2 * np.pi * (time_s - 0.1 * (1 - np.exp(-time_s / 0.1))) / turn_s
    return 1e-3 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])


# Nonminimum phase: a zero at +6.4 rad/s, static gain 1.
BACKWARDS = modes([10.0, 40.0], 1.0, np.array([[100.0], [1600.0]]), np.array([[2.0, -1.0]]))
ONE = np.eye(1)


@given(seed=st.integers(0, 1000))
def test_the_response_to_the_demands_is_the_path(seed):
    """The error is a small part of that of the servos without feedforward."""
    (nominal, gain), path = servos(seed), circle()
    remaining = path - response(nominal, gain, inverse_feedforward(nominal, gain, path))
    lag = path - response(nominal, gain, path)
    assert np.linalg.norm(lag) > 0.15 * np.linalg.norm(path)
    assert np.linalg.norm(remaining) < 0.1 * np.linalg.norm(lag)


@pytest.mark.parametrize("backwards", [False, True])
def test_the_demands_are_the_least_squares_solution(backwards):
    """The reference is a dense least-squares problem over all demands during and after the path."""
    nominal, gain = (BACKWARDS, ONE) if backwards else servos(1)
    path = circle(0.3, 150)[:, : len(gain.T)]
    extended = np.vstack([path, np.tile(path[-1], (450 // len(path.T), 1))])
    ticks, m = extended.shape
    after = [response(nominal, gain, np.eye(1, ticks).T * axis).T for axis in np.eye(m)]
    T = np.block([[toeplitz(h[row], np.zeros(ticks)) for h in after] for row in range(m)])
    weight, target = np.sqrt(WEIGHT), extended.T.ravel()
    rows = np.vstack([T, weight * np.eye(ticks * m)])
    best = np.linalg.lstsq(rows, np.concatenate([target, weight * target]), rcond=None)[0]
    best = best.reshape(m, ticks).T[: len(path)]
    result = inverse_feedforward(nominal, gain, path)
    np.testing.assert_allclose(result, best, atol=5e-4 * np.abs(best).max())


@given(scale=st.floats(1e-6, 1e6), row=st.integers(0, 1))
def test_units_do_not_matter(scale, row):
    """The path is scaled, and one row with its noise is given in other units."""
    (nominal, gain), path = servos(2), circle()
    demands = inverse_feedforward(nominal, gain, path)
    np.testing.assert_allclose(inverse_feedforward(nominal, gain, scale * path), scale * demands)
    unit = np.ones(2)
    unit[row] = scale
    scaled = nominal.measured(unit[:, None] * nominal.plant.C, unit * nominal.noise)
    result, expected = inverse_feedforward(scaled, gain / unit, path * unit), demands * unit
    tiny = 1e-9 * np.abs(expected).max(axis=0).min()
    np.testing.assert_allclose(result, expected, rtol=1e-6, atol=tiny)


def test_unobservable_modes_do_not_matter():
    """A rod that spins about its axis drifts without bound, but is not part of the inverse."""
    path = circle()
    w, zeta = np.array([80.0, 90.0, 0.0]), np.array([3.0, 4.0, 0.0])
    C = np.array([[1.0, 0.2, 0.0], [0.1, 1.0, 0.0]])
    B = np.array([[6400.0, 0.0], [0.0, 8100.0], [50.0, 20.0]])
    spun, still = (
        inverse_feedforward(modes(w[:k], zeta[:k], B[:k], C[:, :k]), np.linalg.inv(C[:, :2]), path)
        for k in (3, 2)
    )
    np.testing.assert_allclose(spun, still, atol=1e-9 * np.abs(still).max())
