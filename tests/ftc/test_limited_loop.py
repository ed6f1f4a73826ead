"""Laws of displacement limits in the loop: what is achieved, anti-windup from it, stability."""

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from ftc import (
    DirectDrive,
    Goal,
    LocalGeometry,
    Measurement,
    PrioritizedController,
    PrioritizedMapping,
)
from ftc.control import circle_margin
from ftc.control.anti_windup import tracking_gain
from prioritized import ConstrainedSystem
from tests.profiles import examples

SEEDS = st.integers(0, 2**32 - 1)
MAJOR, SECONDARY = [0, 1], [2, 3]
PERIOD_S = 0.01
INTEGRATOR = control.ss([[1.0]], [[PERIOD_S]], [[5.0]], [[0.0]], PERIOD_S)
"""5 / s, by Euler's rule."""


def geometry(seed: int, n: int = 5) -> LocalGeometry:
    """A serial mechanism of n joints and four task rows."""
    J = np.random.default_rng(seed).normal(size=(4, n))
    return LocalGeometry(ConstrainedSystem(J, None, np.arange(n)))


def limited(own: LocalGeometry, half: float = 0.5, **options) -> Any:
    n = len(own.system.active)
    goal = options.pop("goal", Goal(joint_weight=(1.0,) * n))
    box = (np.full(n, -half), np.full(n, half))
    return PrioritizedMapping(own, goal, MAJOR, SECONDARY, limits=box, **options)


@examples(40)
@given(SEEDS, st.sampled_from([{}, {1: 0.2}, {0: -0.3, 3: 0.1}]))
def test_what_is_achieved_is_as_near_to_the_demand_as_the_limits_allow(seed, locked_at):
    """An independent bounded solver finds the same error, stuck actuators included."""
    own, demand = geometry(seed), np.random.default_rng(seed + 1).normal(size=2)
    mapping = limited(own, goal=Goal(joint_weight=(1.0,) * 5, locked_at=locked_at))
    found_m, residual = mapping.tick(demand, own.nominal)
    assert np.abs(found_m).max() <= 0.5
    assert not found_m[list(locked_at)].any()
    standing_m = found_m.copy()
    for actuator, stands_m in locked_at.items():
        standing_m[actuator] = stands_m
    achieved = mapping.major_motion(standing_m, own.nominal)
    assert residual is not None
    np.testing.assert_allclose(residual, demand - achieved, atol=1e-9)
    offset = own.system.J_T[MAJOR][:, list(locked_at)] @ list(locked_at.values())
    J_m = np.delete(own.system.J_T[MAJOR], list(locked_at), axis=1)
    best = lsq_linear(J_m, demand - offset, (-0.5, 0.5), method="bvls", tol=1e-14)
    assert np.linalg.norm(residual) == pytest.approx(np.sqrt(2 * best.cost), abs=1e-7)


@given(SEEDS)
def test_limits_that_are_not_reached_change_nothing(seed):
    own = geometry(seed)
    rng = np.random.default_rng(seed + 1)
    demand, reference_m = 0.1 * rng.normal(size=2), 0.1 * rng.normal(size=5)
    free = limited(own).displacements(demand, own.nominal, secondary_reference=reference_m)
    wide = limited(own, half=2 * np.abs(free).max())
    found, residual = wide.tick(demand, own.nominal, secondary_reference=reference_m)
    np.testing.assert_allclose(found, free, atol=1e-10)
    np.testing.assert_allclose(residual, 0, atol=1e-10)


@given(SEEDS)
def test_a_secondary_goal_beyond_the_limits_costs_the_major_task_nothing(seed):
    own = geometry(seed)
    rng = np.random.default_rng(seed + 1)
    mapping, demand = limited(own), rng.normal(size=2)
    _, alone = mapping.tick(demand, own.nominal)
    _, beside = mapping.tick(demand, own.nominal, secondary_reference=10 * rng.normal(size=5))
    np.testing.assert_allclose(beside, alone, atol=1e-8)


@given(SEEDS)
def test_scaled_demands_keep_their_direction(seed):
    own, demand = geometry(seed), 5 * np.random.default_rng(seed + 1).normal(size=2)
    _, residual = limited(own, when_limited="scaled").tick(demand, own.nominal)
    achieved = demand - residual
    assert abs(np.linalg.det([achieved, demand])) < 1e-8
    assert 0 <= achieved @ demand <= demand @ demand + 1e-9


def driven(controller: PrioritizedController, reference: float, ticks: int, state=None):
    """The loop around a plant that does at once what it is commanded; major task, (ticks, 2)."""
    mapping, kept = controller.mapping, []
    state = controller.start() if state is None else state
    for _ in range(ticks):
        output = mapping.major_motion(state.inputs, mapping.nominal)
        kept.append(output)
        still = Measurement(output, np.zeros(0))
        state = controller.step(state, np.array([reference, 0.0]), still)
    return np.array(kept), state


@pytest.mark.parametrize("anti_windup", [True, False])
def test_an_integrator_does_not_run_away_from_what_is_achieved(anti_windup):
    """The demand is ahead by the error at most: K e dt = L (u - u_a), and L is about K dt.

    Four time constants 1 / K after the target has become attainable, the pointing is there.
    """
    mapping = limited(geometry(3))
    options = {"handover_s": 0.0, "anti_windup": anti_windup}
    controller = PrioritizedController([INTEGRATOR] * 2, mapping, DirectDrive(), **options)
    reached, state = driven(controller, 10.0, 500)
    error = np.linalg.norm([10.0 - reached[-1, 0], reached[-1, 1]])
    ahead = np.linalg.norm(state.asked.demand - reached[-1])
    returned, _ = driven(controller, 0.0, 80, state)
    left = np.linalg.norm(returned[-1]) / np.linalg.norm(returned[0])
    assert (ahead < 1.05 * error) == anti_windup
    assert left < 0.1 if anti_windup else left > 0.9


def test_without_limits_anti_windup_changes_no_bit():
    own = geometry(4)
    free = PrioritizedMapping(own, Goal(joint_weight=(1.0,) * 5), MAJOR, SECONDARY)
    plain, held = (
        driven(
            PrioritizedController([INTEGRATOR] * 2, free, DirectDrive(), 0.0, anti_windup=held),
            0.3,
            50,
        )[0]
        for held in (False, True)
    )
    np.testing.assert_array_equal(plain, held)


@pytest.mark.parametrize("slowness", [1.0, 7.0])
def test_the_observer_of_an_integrator_is_the_scalar_kalman_filter(slowness):
    """The Riccati equation is c^2 P^2 = b^2 (c^2 P + r), and L = c P / (c^2 P + r), r = slowness^2.

    The excess then decays in about slowness / K, to first order in the period.
    """
    b, c, r = PERIOD_S, 5.0, slowness**2
    P = (b**2 * c**2 + np.sqrt((b * c) ** 4 + 4 * r * (b * c) ** 2)) / (2 * c**2)
    gain = tracking_gain(INTEGRATOR, slowness)[0]
    assert gain == pytest.approx(c * P / (c**2 * P + r))
    decay_s = -PERIOD_S / np.log(1 - c * gain)
    assert decay_s == pytest.approx(slowness / c, rel=0.01)
    proportional = control.ss([], [], [], [[3.0]], PERIOD_S)
    assert tracking_gain(proportional).shape == (0,)


@given(SEEDS, st.integers(0, 2), st.integers(0, 3))
def test_compensators_that_observe_what_is_achieved_are_stable(seed, integrators, others):
    """Double integrators and unstable compensators too: all poles of A - L C within the circle."""
    rng = np.random.default_rng(seed)
    order = integrators + others
    A = np.diag(np.concatenate([np.ones(integrators), rng.uniform(-1.1, 0.9, others)]))
    A[:integrators, :integrators] += np.diag(np.ones(max(integrators - 1, 0)), 1)[
        :integrators, :integrators
    ]
    if order:
        channel = control.ss(
            A, rng.uniform(0.5, 1, (order, 1)), rng.uniform(0.5, 1, (1, order)), 0.3, 0.1
        )
        L = tracking_gain(channel)[:, None]
        assert np.abs(np.linalg.eigvals(channel.A - L @ channel.C)).max() < 1


def test_the_circle_margin_of_a_gain_behind_a_tick_is_one_minus_the_gain():
    """H = k / z: its real part is at least -k."""
    delay = control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], PERIOD_S)
    for gain in (0.2, 0.9, 1.5):
        margin = circle_margin(
            delay, [control.ss([], [], [], [[gain]], PERIOD_S)], anti_windup=True
        )
        assert margin == pytest.approx(1 - gain, abs=1e-4)


@pytest.mark.parametrize("anti_windup", [True, False])
def test_the_circle_margin_of_an_integrator_behind_a_tick_is_the_one_on_paper(anti_windup):
    """I + H = (z - 1 + b c / z) / (z - 1 + c L), with L = 0 for an integrator that winds up."""
    delay = control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], PERIOD_S)
    b_c, c_L = 5.0 * PERIOD_S, 5.0 * tracking_gain(INTEGRATOR)[0] * anti_windup
    z = np.exp(1j * np.pi * np.geomspace(2e-4, 0.998, 100000))
    least = ((z - 1 + b_c / z) / (z - 1 + c_L)).real.min()
    found = circle_margin(delay, [INTEGRATOR], anti_windup=anti_windup)
    assert found == pytest.approx(least, abs=1e-3)


@examples(2)
@given(SEEDS)
def test_with_a_positive_circle_margin_two_responses_converge_through_the_limits(seed):
    delay = control.ss(np.zeros((2, 2)), np.eye(2), np.eye(2), np.zeros((2, 2)), PERIOD_S)
    loops = [INTEGRATOR] * 2
    assert circle_margin(delay, loops, anti_windup=True) > 0
    controller = PrioritizedController(
        loops, limited(geometry(seed)), DirectDrive(), 0.0, anti_windup=True
    )
    _, far = driven(controller, 30.0, 30)
    one, _ = driven(controller, 1.0, 200)
    other, _ = driven(controller, 1.0, 200, far)
    np.testing.assert_allclose(one[-1], other[-1], atol=1e-3 * (1 + np.abs(other[0]).max()))


@given(SEEDS)
def test_a_mapping_with_limits_takes_over_without_a_step(seed):
    """Commands within the limits are those of the new mapping, whatever it would do itself."""
    own, rng = geometry(seed), np.random.default_rng(seed)
    mapping, commanded_m = limited(own), 0.4 * rng.uniform(-1, 1, 5)
    pilot = PrioritizedController([INTEGRATOR] * 2, mapping, DirectDrive(), handover_s=0.1)
    state = replace(pilot.start(), inputs=commanded_m)
    last, new = state.asked, pilot.transfer(state).bumpless_transfer
    assert new is not None
    demand, beside = last.demand + new.demand, new.secondary_reference
    found, _ = mapping.tick(demand, own.nominal, secondary_reference=beside)
    np.testing.assert_allclose(found, commanded_m, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"limits": (np.zeros(4), np.ones(4))},
            "limits must be a pair of numbers or of shapes",
        ),
        ({"limits": (np.zeros((2, 5)), np.ones(5))}, "limits must be two numbers or of shape"),
        ({"limits": (np.ones(5), np.zeros(5))}, "limits must be a lower and an upper limit"),
        ({"limits": np.ones(5)}, "limits must be a pair"),
        ({"limits": (np.full(5, np.nan),) * 2}, "limits must hold numbers or infinity"),
        ({"limits": (0.0, "x")}, "limits must hold real numbers"),
        (
            {"limits": (np.zeros(5), np.ones(5)), "form": "incremental"},
            'form must be "absolute" or "gauss_newton" with limits',
        ),
    ],
)
def test_limits_without_sense_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        PrioritizedMapping(geometry(0), Goal(), MAJOR, SECONDARY, **options)


def test_without_limits_nothing_is_left():
    own = geometry(0)
    mapping = PrioritizedMapping(own, Goal(joint_weight=(1.0,) * 5), MAJOR, SECONDARY)
    found, residual = mapping.tick(np.ones(2), own.nominal)
    assert residual is None
    np.testing.assert_array_equal(found, mapping.displacements(np.ones(2), own.nominal))
