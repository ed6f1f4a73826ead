"""A minimal realization: what no input excites or no output sees plays no part in a loop."""

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftc import LoopShape, compensator
from ftc.control import NoResponse
from ftc.control.compensator import minimal


def plant(seed: int, driven: int, idle: int) -> control.StateSpace:
    """Decaying motions that are driven and seen, and integrators that are one or the other only.

    The states are mixed by a random transformation of moderate condition.
    """
    draw = np.random.default_rng(seed)
    n = driven + 2 * idle
    A = np.zeros((n, n))
    A[:driven, :driven] = draw.uniform(-1, 1, (driven, driven)) - 3 * np.eye(driven)
    A[driven : driven + idle, :driven] = draw.uniform(-1, 1, (idle, driven))  # driven, not seen
    A[:driven, driven + idle :] = draw.uniform(-1, 1, (driven, idle))  # seen, not driven
    B, C = np.zeros((n, 2)), np.zeros((2, n))
    B[:driven], C[:, :driven] = draw.uniform(-1, 1, (driven, 2)), draw.uniform(-1, 1, (2, driven))
    T = np.linalg.qr(draw.standard_normal((n, n)))[0] @ np.diag(draw.uniform(0.5, 2.0, n))
    T_inverse = np.linalg.inv(T)
    return control.ss(T @ A @ T_inverse, T @ B, C @ T_inverse, 0)


@given(st.integers(0, 999), st.integers(1, 5), st.integers(0, 3), st.sampled_from([1e-9, 1e9]))
def test_motions_without_an_end_that_the_loop_does_not_see_are_gone(seed, driven, idle, unit):
    """The response stays, and every pole that is left decays, whatever the unit of the inputs."""
    whole = plant(seed, driven, idle)
    part = minimal(whole)
    assert part.nstates <= driven
    assert part.poles().real.max(initial=-1.0) < 0
    assert idle or part is whole
    for w in np.geomspace(0.1, 100.0, 15):
        np.testing.assert_allclose(part(1j * w), whole(1j * w), atol=1e-6)
    scaled = minimal(control.ss(whole.A, unit * whole.B, whole.C, 0))
    assert scaled.nstates == part.nstates
    np.testing.assert_allclose(scaled(1j), unit * part(1j), rtol=1e-6, atol=1e-9 * unit)


def test_an_unstable_motion_that_is_seen_and_driven_stays():
    """A pendulum that stands upright is for the loop to hold."""
    upright = control.ss([[0, 1], [4, 0]], [[0], [1]], [[1, 0]], 0)
    np.testing.assert_allclose(sorted(minimal(upright).poles().real), [-2, 2], atol=1e-9)


def test_a_channel_that_does_not_respond_is_refused():
    dead = control.ss([[0.0, 1.0], [-4.0, -1.0]], [[0.0], [0.0]], [[1.0, 0.0]], 0)
    with pytest.raises(NoResponse, match=r"plant must respond at 2\.0 Hz, got a gain of 0"):
        compensator(dead, LoopShape(2.0, 8.0, 0.7), 1e-3)
