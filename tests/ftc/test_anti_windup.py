"""Anti-windup: integrators stay near the achieved demand, and loops with limits stay stable."""

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftc import DirectDrive, Measurement, PrioritizedController
from ftc.control import circle_margin
from ftc.control.anti_windup import tracking_gain
from tests.ftc.serial import limited, serial
from tests.profiles import examples

SEEDS = st.integers(0, 2**32 - 1)
PERIOD_S = 0.01
INTEGRATOR = control.ss([[1.0]], [[PERIOD_S]], [[5.0]], [[0.0]], PERIOD_S)
"""Integrator 5 / s, discretized by Euler's rule."""


def controller_for(mapping: Any, handover_s: float = 0.0, *, anti_windup: bool = True) -> Any:
    loops = [INTEGRATOR] * 2
    return PrioritizedController(loops, mapping, DirectDrive(), handover_s, anti_windup=anti_windup)


def driven(controller: PrioritizedController, reference: float, ticks: int, state=None):
    """Return the major task (ticks, 2) of a loop with an ideal plant, and the last state."""
    mapping, outputs = controller.mapping, []
    state = controller.start() if state is None else state
    for _ in range(ticks):
        output = mapping.major_motion(state.inputs, mapping.nominal)
        outputs.append(output)
        still = Measurement(output, np.zeros(0))
        state = controller.step(state, np.array([reference, 0.0]), still)
    return np.array(outputs), state


@pytest.mark.parametrize("anti_windup", [True, False])
def test_an_integrator_stays_near_the_achieved_demand(anti_windup):
    """The demand leads by at most the error, since L is about K dt; the task settles in 4 / K."""
    controller = controller_for(limited(serial(3)), anti_windup=anti_windup)
    reached, state = driven(controller, 10.0, 500)
    error = np.linalg.norm([10.0 - reached[-1, 0], reached[-1, 1]])
    ahead = np.linalg.norm(state.previous_command.demand - reached[-1])
    returned, _ = driven(controller, 0.0, 80, state)
    remaining = np.linalg.norm(returned[-1]) / np.linalg.norm(returned[0])
    assert (ahead < 1.05 * error) == anti_windup
    assert remaining < 0.1 if anti_windup else remaining > 0.9


@pytest.mark.parametrize("slowness", [1.0, 7.0])
def test_the_observer_of_an_integrator_is_the_scalar_kalman_filter(slowness):
    """The Riccati equation is c^2 P^2 = b^2 (c^2 P + r), its gain c P / (c^2 P + r)."""
    b, c, r = PERIOD_S, 5.0, slowness**2
    P = (b**2 * c**2 + np.sqrt((b * c) ** 4 + 4 * r * (b * c) ** 2)) / (2 * c**2)
    gain = tracking_gain(INTEGRATOR, slowness)[0]
    assert gain == pytest.approx(c * P / (c**2 * P + r))
    decay_s = -PERIOD_S / np.log(1 - c * gain)
    assert decay_s == pytest.approx(slowness / c, rel=0.01)
    proportional = control.ss([], [], [], [[3.0]], PERIOD_S)
    assert tracking_gain(proportional).shape == (0,)


@given(SEEDS, st.integers(0, 2), st.integers(0, 3))
def test_compensators_with_back_calculation_are_stable(seed, integrators, others):
    """The poles of A - L C are stable, also of double integrators and unstable compensators."""
    rng, order = np.random.default_rng(seed), integrators + others
    A = np.diag(np.concatenate([np.ones(integrators), rng.uniform(-1.1, 0.9, others)]))
    if integrators == 2:
        A[0, 1] = 1.0
    if order:
        B, C = rng.uniform(0.5, 1, (order, 1)), rng.uniform(0.5, 1, (1, order))
        L = tracking_gain(control.ss(A, B, C, 0.3, 0.1))[:, None]
        assert np.abs(np.linalg.eigvals(A - L @ C)).max() < 1


DELAY = control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], PERIOD_S)


@pytest.mark.parametrize("anti_windup", [True, False])
def test_the_circle_margin_of_an_integrator_matches_its_formula(anti_windup):
    """I + H = (z - 1 + b c / z) / (z - 1 + c L), with L = 0 for an integrator that winds up."""
    b_c, c_L = 5.0 * PERIOD_S, 5.0 * tracking_gain(INTEGRATOR)[0] * anti_windup
    z = np.exp(1j * np.pi * np.geomspace(2e-4, 0.998, 100000))
    least = ((z - 1 + b_c / z) / (z - 1 + c_L)).real.min()
    result = circle_margin(DELAY, [INTEGRATOR], anti_windup=anti_windup)
    assert result == pytest.approx(least, abs=1e-3)


@examples(2)
@given(SEEDS)
def test_with_a_positive_circle_margin_two_responses_converge_through_the_limits(seed):
    delay = control.ss(np.zeros((2, 2)), np.eye(2), np.eye(2), np.zeros((2, 2)), PERIOD_S)
    assert circle_margin(delay, [INTEGRATOR] * 2, anti_windup=True) > 0
    controller = controller_for(limited(serial(seed)))
    _, far = driven(controller, 30.0, 30)
    one, _ = driven(controller, 1.0, 200)
    other, _ = driven(controller, 1.0, 200, far)
    np.testing.assert_allclose(one[-1], other[-1], atol=1e-3 * (1 + np.abs(other[0]).max()))


@given(SEEDS)
def test_a_mapping_with_limits_takes_over_without_a_step(seed):
    """The new mapping reproduces previous commands within the limits after a transfer."""
    own, rng = serial(seed), np.random.default_rng(seed)
    mapping, commanded_m = limited(own), 0.4 * rng.uniform(-1, 1, 5)
    controller = controller_for(mapping, handover_s=0.1)
    state = replace(controller.start(), inputs=commanded_m)
    last, new = state.previous_command, controller.transfer(state).bumpless_transfer
    assert new is not None
    demand, secondary = last.demand + new.demand, new.secondary_reference
    result, _ = mapping.tick(demand, own.nominal, secondary_reference=secondary)
    np.testing.assert_allclose(result, commanded_m, atol=1e-9)
