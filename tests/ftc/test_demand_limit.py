"""Limit on the pointing demanded by the hexapod's compensators: controller and linear model."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.uncorrected import W_A, fast_loop_ratio, remaining_gain
from fjh.rig.hexapod.controller import controller_for
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.hexapod.trajectory import spiral
from tests.ftc.hexapod import reading
from tests.ftc.hexapod import testbed as nominal_testbed

TIGHT = replace(TestbedConfig(), spiral_exponent=0.5, demand_limit_urad=20.0)
"""Testbed whose demand limit is reached within the first second."""


def test_a_spiral_has_constant_speed_in_both_directions():
    time_s = np.arange(16000) * 1e-3
    path = spiral(time_s, radius_rad=1e-4, turns=8, duration_s=16.0, exponent=0.5)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1)[2000:]
    assert speed.max() < 1.03 * speed.min()
    np.testing.assert_allclose(np.linalg.norm(path, axis=1), 1e-4 * np.sqrt(time_s / 16))
    plain = spiral(time_s, 1e-4, 8, 16.0)  # for comparison, backwards from another start
    bench = replace(TestbedConfig(), spiral_direction=-1, spiral_start_deg=90.0)
    np.testing.assert_allclose(bench.desired_rad(time_s), plain[:, ::-1], atol=1e-18)


def demands(bench: TestbedConfig, ticks: int, error_rad):
    """Return the demands of the compensators, tick by tick, for a constant error."""
    controller = controller_for(replace(nominal_testbed(), bench=bench), W_A)
    state, demanded = controller.start(), []
    for _ in range(ticks):
        state = controller.step(state, np.asarray(error_rad), reading(np.zeros(2)))
        demanded.append(state.previous_command.demand)
    return controller, state, np.array(demanded)


def test_no_angle_is_demanded_beyond_the_limit_and_each_has_its_own():
    _, state, demanded = demands(TIGHT, 300, [5e-6, -1e-6])
    _, _, free = demands(replace(TIGHT, demand_limit_urad=None), 300, [5e-6, -1e-6])
    beyond = np.abs(free) > TIGHT.demand_limit_rad
    assert beyond[:, 0].any() and not beyond[:, 1].any()
    np.testing.assert_array_equal(demanded, np.where(beyond, TIGHT.demand_limit_rad, free))
    assert np.isfinite(state.compensator).all()


@pytest.mark.parametrize("anti_windup", [False, True])
def test_an_integrator_at_its_limit_winds_up_without_anti_windup(anti_windup):
    """The integrator leaves the limit at once after a sign change only with anti-windup."""
    bench = replace(TIGHT, anti_windup=anti_windup)
    controller, state, _ = demands(bench, 1000, [5e-6, 0.0])
    ticks = 0
    while state.previous_command.demand[0] >= TIGHT.demand_limit_rad and ticks < 2000:
        state = controller.step(state, np.array([-5e-6, 0.0]), reading(np.zeros(2)))
        ticks += 1
    assert ticks < 60 if anti_windup else ticks > 500


def test_any_fast_linear_loop_gives_139_and_115_percent(model):
    """Ratios of (I + G L)^-1 r to (I + L)^-1 r for circling r and random complex L, to 1 / |L|."""
    G = remaining_gain(model)
    np.testing.assert_allclose(G, [[0.750, -0.144], [-0.144, 0.917]], atol=1e-3)
    bound = fast_loop_ratio(G)
    np.testing.assert_allclose(bound, [1.392, 1.146], atol=5e-4)
    rng, r = np.random.default_rng(0), np.array([1.0, -1.0j])
    for size in (1e2, 1e4, 1e6):
        for _ in range(200):
            L = np.diag(size * rng.uniform(0.5, 2, 2) * np.exp(1j * rng.uniform(-np.pi, np.pi, 2)))
            both = [np.abs(np.linalg.solve(np.eye(2) + gain @ L, r)) for gain in (G, np.eye(2))]
            np.testing.assert_allclose(both[0] / both[1], bound, rtol=10 / size)
