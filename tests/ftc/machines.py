"""Random mechanisms on springs and servos, and motions that try them."""

from functools import cache

import control
import numpy as np

from ftc.fdi import Dither, NominalModel, Uncertainty

LOOSE = Uncertainty(gain=0.03, stiffness=0.03, damping=0.2, delay_s=1e-3)


@cache
def mechanism(seed: int, *, servo: bool = False, n: int = 3, outputs: int = 2) -> NominalModel:
    """Well damped masses on springs, or on servos, more of them than actuators at odd seeds."""
    rng = np.random.default_rng(seed)
    k = n + seed % 2
    half = rng.normal(size=(k, k))
    M = np.eye(k) + 0.1 * half @ half.T
    c = np.linalg.qr(rng.normal(size=(k, k)))[0][:n]
    spring = rng.uniform(2000.0, 6000.0, size=n)
    damper = 0.6 * np.sqrt(spring)
    K = c.T * spring @ c + 500.0 * np.eye(k)
    D = c.T * damper @ c + 20.0 * np.eye(k)
    A = np.block([[np.zeros((k, k)), np.eye(k)], [-np.linalg.solve(M, np.hstack([K, D]))]])
    B = np.vstack([np.zeros((k, n)), np.linalg.solve(M, c.T * spring)])
    C = np.hstack([rng.normal(size=(outputs, k)), np.zeros((outputs, k))])
    return NominalModel(
        plant=control.ss(A, B, C, 0),
        displacement=np.hstack([c, np.zeros((n, k))]),
        noise=rng.uniform(0.5, 2.0, size=outputs) * 1e-5,
        period_s=2e-3,
        step_s=1e-3,
        feedback=np.hstack([c, c * (damper / spring)[:, None]]) if servo else None,
    )


@cache
def twins() -> NominalModel:
    """Two equal masses, one sensor of their sum, and a third that it does not see."""
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-4000.0 * np.eye(3), -30.0 * np.eye(3)]])
    B = np.vstack([np.zeros((3, 3)), 4000.0 * np.eye(3)])
    C = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    return NominalModel(control.ss(A, B, C, 0), np.eye(3, 6), np.array([1e-5]), 2e-3, 1e-3)


def random_dither(seed: int, n: int = 3, hz: float = 10.0) -> Dither:
    rng = np.random.default_rng([seed, 1])
    return Dither(1e-3, hz, tuple(rng.uniform(0.5, 1.0, size=n) * rng.choice([-1, 1], size=n)))
