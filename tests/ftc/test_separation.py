"""Separation of failures in steady states and transients, and its design."""

from dataclasses import replace
from functools import cache
from typing import Any

import control
import numpy as np
import pytest
import scipy.linalg
from scipy.stats import norm

from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.fault_tolerance import HEAVE, STILL, nominal_model
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.prediction import linear_run
from ftc.fdi import (
    CERTAIN,
    KINDS,
    Cause,
    Cost,
    Dither,
    Fault,
    NominalModel,
    Uncertainty,
    designed_dither,
    fault_model,
    fault_responses,
    isolability,
    ranked_sensors,
    separation,
    separations,
    separations_at,
)
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.separation import SEPARATION_THRESHOLD, distances
from ftc.fdi.uncertainty import TYPICAL
from tests.ftc.hexapod import DITHER, jacobian
from tests.random_systems import bits

seeds = pytest.mark.parametrize("seed", range(3))
servos = pytest.mark.parametrize("servo", [False, True])

LOOSE = Uncertainty(gain=0.03, stiffness=0.03, damping=0.2, delay_s=1e-3)


@cache
def mechanism(seed: int, *, servo: bool = False, n: int = 3, outputs: int = 2) -> NominalModel:
    """Return well-damped masses on springs or servos, with a passive one at odd seeds."""
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
    """Return two equal masses with one sensor of their sum, and an unobserved third mass."""
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-4000.0 * np.eye(3), -30.0 * np.eye(3)]])
    B = np.vstack([np.zeros((3, 3)), 4000.0 * np.eye(3)])
    C = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    return NominalModel(control.ss(A, B, C, 0), np.eye(3, 6), np.array([1e-5]), 2e-3, 1e-3)


def random_dither(seed: int, n: int = 3, hz: float = 10.0) -> Dither:
    rng = np.random.default_rng([seed, 1])
    return Dither(1e-3, hz, tuple(rng.uniform(0.5, 1.0, size=n) * rng.choice([-1, 1], size=n)))


FAULTS = [Fault(k, kind, 0.5 * (kind == "weak")) for k in range(3) for kind in KINDS]


def phasor_of(nominal: NominalModel, hz: float, u: np.ndarray, *faults: Fault) -> Any:
    """Return the steady phasor (s,) of the states for commands of amplitudes (n,)."""
    model, z = fault_model(nominal, faults), np.exp(2j * np.pi * hz * nominal.period_s)
    return np.linalg.solve(z * np.eye(len(model.A)) - model.A, model.B @ u)


def test_the_distance_of_actuators_is_that_of_their_nearest_failures():
    """The diagonal is that of an actuator and no failure; the smaller of both directions counts."""
    result = separations(mechanism(0), random_dither(0), 1.0)
    between = result.between_actuators
    for i, j in np.ndindex(3, 3):
        rows, columns = (slice(3 * k, 3 * k + 3) for k in (i, j))
        both = result.distance[rows, columns].min(), result.distance[columns, rows].min()
        assert between[i, j] == (result.from_none[rows].min() if i == j else min(both))


def change(nominal: NominalModel, dither: Dither, fault: Fault) -> Any:
    """Return the change of the steady phasor (p,) of the whitened outputs by a failure."""
    how = nominal, dither.frequency_hz, dither.amplitude * np.array(dither.direction)
    return fault_model(nominal).C @ (phasor_of(*how, fault) - phasor_of(*how))


NIGHT = [pytest.mark.long, pytest.mark.night]


@pytest.mark.long
@pytest.mark.parametrize("row", [0, *(pytest.param(k, marks=NIGHT) for k in (4, 8))])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=NIGHT) for k in (1, 2))])
@pytest.mark.parametrize(
    ("servo", "tolerance"), [(False, 0.02), pytest.param(True, 0.1, marks=NIGHT)]
)
def test_separations_for_long_times_equal_the_isolability(row, seed, servo, tolerance, monkeypatch):
    """The transient is negligible; with free onsets, an explanation at the end is no failure."""
    nominal, dither, time_s = mechanism(seed, servo=servo), random_dither(seed), 3.0
    monkeypatch.setattr(separation, "_STEP_S", 0.01)  # step of onsets, a tenth of a period
    result = separations(nominal, dither, time_s)
    onset, times = 20, np.arange(round(time_s / nominal.period_s)) * nominal.period_s
    commanded = np.vstack([np.zeros((onset, 3)), [dither.at(time) for time in times]])
    states = fault_model(nominal, [result.faults[row]]).states(commanded)[:-1]
    bank, outputs = hypothesis_bank(nominal), states @ fault_model(nominal).C.T
    each_tick = nominal.period_s, 1
    expected, from_none = distances(bank, result.faults[row], onset, outputs, commanded, each_tick)
    nearest = np.minimum(result.distance[row], result.from_none[row]).reshape(-1, 3)
    others = np.arange(3) != result.faults[row].actuator
    slack = tolerance * from_none
    # The limit between weak and free differs: compare their minimum.
    np.testing.assert_allclose(nearest[others, 0], expected[others, 0], atol=slack)
    lost = nearest[others, 1:].min(axis=1), expected[others, 1:].min(axis=1)
    np.testing.assert_allclose(*lost, atol=slack)
    assert result.from_none[row] == pytest.approx(from_none, rel=tolerance)


def random_phasors(
    nominal: NominalModel, dither: Dither, spread: Uncertainty, rng: np.random.Generator
) -> Any:
    """Sample a machine with errors; return its phasors, shape (9, p)."""
    n, k = nominal.actuators, nominal.plant.nstates // 2
    plant = nominal.plant
    more = spread.stiffness * rng.normal(size=(n, 1)) * nominal.displacement
    more[:, k:] = 0.0
    dampers, gains = spread.damping * rng.normal(size=n), spread.gain * rng.normal(size=n)
    rows = nominal.displacement[:, :k]
    A = plant.A - plant.B @ more
    A[k:, k:] = A[k:, k:] @ (np.eye(k) + np.linalg.pinv(rows) * dampers @ rows)
    feedback = nominal.feedback
    if feedback is not None:
        feedback = feedback + more
        feedback[:, k:] *= 1 + dampers[:, None]
        A = A - plant.B * gains @ feedback
    B = plant.B * (1 + gains)
    machine = replace(nominal, plant=control.ss(A, B, plant.C, 0), feedback=feedback)
    late = np.exp(-2j * np.pi * dither.frequency_hz * spread.delay_s * rng.normal())
    return late * np.array([change(machine, dither, fault) for fault in FAULTS])


@pytest.mark.parametrize(
    ("seed", "servo"),
    [
        (0, False),
        pytest.param(0, True, marks=pytest.mark.long),
        pytest.param(1, False, marks=pytest.mark.long),
        pytest.param(1, True, marks=pytest.mark.long),
    ],
)
def test_separations_with_an_uncertain_model_match_sampled_machines(seed, servo):
    """The reference is the mean and covariance of phasors of sampled machines and of noise."""
    nominal, dither, T = mechanism(seed, servo=servo), random_dither(seed), 0.5
    samples, rng = 200, np.random.default_rng(seed)
    small = Uncertainty(0.01, 0.01, 0.05, delay_s=1e-4)
    rows = [0, 1, 5, 8]
    phasors = np.stack([random_phasors(nominal, dither, small, rng)[rows] for _ in range(samples)])
    values = np.concatenate([np.real(phasors), np.imag(phasors)], axis=-1)
    by_noise = 2 * nominal.period_s / T * np.eye(2)
    result = separations(nominal, dither, T, small)
    nearest = np.array([change(nominal, dither, FAULTS[row]) for row in rows])
    means = np.concatenate([np.real(nearest), np.imag(nearest)], axis=-1)
    for i, first in enumerate(rows):
        for j, second in enumerate(rows):
            if result.faults[second].kind == "weak" or i == j:
                continue
            S = np.kron(np.eye(2), by_noise)
            S = S + (np.cov(values[:, i].T) + np.cov(values[:, j].T)) / 2
            gap = means[i] - means[j]
            expected = np.sqrt(gap @ np.linalg.solve(S, gap))
            assert result.distance[first, second] == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(("servo", "tolerance"), [(False, 1e-9), (True, 0.08)])
@seeds
def test_an_exact_model_separates_phasors_by_their_distance_in_noise(seed, servo, tolerance):
    """The reference is a fine grid of losses of force; distances grow with the root of time."""
    nominal, dither, T = mechanism(seed, servo=servo), random_dither(seed), 0.5 + seed
    result, size = separations(nominal, dither, T), np.sqrt(T / nominal.period_s / 2)
    assert list(result.faults) == FAULTS
    signatures = size * np.array([change(nominal, dither, fault) for fault in FAULTS])
    np.testing.assert_allclose(result.from_none, np.linalg.norm(signatures, axis=1), rtol=1e-6)
    for other in range(3):
        losses = [Fault(other, "weak", 1 - lost) for lost in np.linspace(0.01, 0.95, 95)]
        weak = size * np.array([change(nominal, dither, fault) for fault in losses])
        between = 0.51 * np.abs(np.diff(weak, axis=0)).max() * np.sqrt(2)
        for row, own in enumerate(signatures):
            sure = np.linalg.norm(own - signatures[3 * other : 3 * other + 2], axis=1)
            np.testing.assert_allclose(result.distance[row, 3 * other : 3 * other + 2], sure)
            grid = np.linalg.norm(own - weak, axis=1).min()
            slack = tolerance * result.from_none[row]
            assert grid - between - slack <= result.distance[row, 3 * other + 2] <= grid + slack


def test_failures_at_the_threshold_are_confused_once_in_a_thousand():
    assert norm.cdf(-SEPARATION_THRESHOLD / 2) == pytest.approx(1e-3, rel=0.01)


def test_groups_are_indistinguishable_and_a_sensor_separates_them():
    """Signatures of twins are equal in phase and opposite in antiphase."""
    nominal, known = twins(), (1.0,)
    step = Dither(1e-2, 5.0, (1.0, 1.0, 1.0))
    result = separations(nominal, step, *known)
    assert result.indistinguishable() == ((0, 1),) and result.least == 0.0
    assert result.undetected() == tuple(Fault(2, kind, 0.5 * (kind == "weak")) for kind in KINDS)
    # Uncoupled, each is at rest both locked and free.
    assert not result.distance[[0, 3, 6], [1, 4, 7]].any()
    in_turn = separations(nominal, replace(step, direction=(1.0, -1.0, 1.0)), *known)
    assert in_turn.indistinguishable() == () and result.isolable() == ()
    assert [fault.actuator for fault in in_turn.isolable()] == [0, 0, 0, 1, 1, 1]

    sum_again, third, first = np.eye(1, 6)[0] + np.eye(1, 6, 1)[0], np.eye(1, 6, 2)[0], np.eye(6)[0]
    candidates = {"sum": (sum_again, 1e-5), "third": (third, 1e-5), "first": (first, 1e-5)}
    ranked = ranked_sensors(nominal, candidates, step, *known)
    assert [each.indistinguishable for each in ranked] == [1, 1, 2]
    assert {each.name for each in ranked[:2]} == {"third", "first"}
    assert ranked_sensors(nominal, {}, step, *known) == ()


@servos
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_one_more_sensor_is_one_more_output_and_never_lowers_a_separation(seed, servo):
    """An additional sensor could be ignored, also with an uncertain model."""
    nominal, dither = mechanism(seed, servo=servo), random_dither(seed)
    known = 0.5, LOOSE
    before = separations(nominal, dither, *known)
    encoders = {str(k): (row, 1e-4) for k, row in enumerate(nominal.displacement)}
    ranked = ranked_sensors(nominal, encoders, dither, *known)
    for each in ranked:
        slack, (row, noise) = 1e-6 * before.distance.max(), encoders[each.name]
        C = np.vstack([nominal.plant.C, row])
        extended = nominal.measured(C, np.append(nominal.noise, noise))
        alone = separations(extended, dither, *known)
        np.testing.assert_allclose(each.separations.distance, alone.distance, atol=slack)
        assert (each.separations.distance >= before.distance - slack).all()
        assert (each.separations.from_none >= before.from_none - slack).all()
    order = [(each.indistinguishable, -each.separations.least) for each in ranked]
    assert order == sorted(order) and len(ranked) == 3


def used_fractions(nominal: NominalModel, commanded: np.ndarray, hz: float) -> np.ndarray:
    """Return commands and motions of actuators and first output relative to their limits."""
    x = phasor_of(nominal, hz, commanded)
    parts = commanded / 1e-3, nominal.displacement @ x / 1e-3, nominal.plant.C[:1] @ x / 1e-4
    return np.abs(np.concatenate(parts))


@servos
@pytest.mark.parametrize("uncertainty", [Uncertainty(), LOOSE], ids=["exact", "uncertain"])
@pytest.mark.parametrize("seed", range(2))
def test_no_random_dither_of_equal_cost_is_better_than_the_designed_one(seed, uncertainty, servo):
    """The designed dither uses its limits and lies in the null space."""
    nominal = mechanism(seed, servo=servo)
    plant, known = nominal.plant, (0.5, uncertainty)
    J = (-plant.C @ np.linalg.solve(plant.A, plant.B))[:1]  # of the first output at rest
    N, frequencies = scipy.linalg.null_space(J), np.array([4.0, 16.0])
    cost = Cost(1e-3, np.asarray(plant.C)[:1], 1e-4)
    best = designed_dither(nominal, N, frequencies, cost, *known)
    u = best.dither.amplitude * np.array(best.dither.direction)
    assert np.abs(J @ u).max() < 1e-12 * np.abs(J).max()
    assert best.dither.frequency_hz in frequencies
    used = used_fractions(nominal, u, best.dither.frequency_hz)
    assert used.max() == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(best.displacement, 1e-3 * used[3:6], rtol=1e-6)
    np.testing.assert_allclose(best.task_motion, 1e-4 * used[6:], rtol=1e-6)

    responses = fault_responses(nominal, frequencies, *known)
    rng = np.random.default_rng([seed, 2])
    for number in range(50):
        k = number % 2
        other = N @ rng.normal(size=N.shape[1])
        other /= used_fractions(nominal, other, frequencies[k]).max()
        result = separations_at(responses, k, other)
        reached = [each.between_actuators[best.separable] for each in (result, best.separations)]
        assert reached[0].min() <= reached[1].min() * (1 + 1e-6)


def test_a_task_without_null_space_gets_no_dither():
    nominal = mechanism(0)
    cost = Cost(1e-3, np.asarray(nominal.plant.C), 1e-4)
    for none in (np.zeros((3, 0)), np.zeros((3, 3))):
        result = designed_dither(nominal, none, [5.0], cost, 1.0)
        assert result.dither.amplitude == 0.0 and result.separations.least == 0.0
        assert len(result.separations.undetected()) == 9


def test_the_dither_of_the_hexapod_is_the_heave():
    """Heave does not move the pointing by symmetry, and every strut has its own direction."""
    nominal, J_m = hexapod_rig().nominal, jacobian()[MAJOR]
    known, cost = (0.2, LOOSE), Cost(0.5e-6, np.asarray(nominal.plant.C), 1e-7)
    result = designed_dither(nominal, scipy.linalg.null_space(J_m), [20.0], cost, *known)
    np.testing.assert_allclose(result.dither.direction, HEAVE, atol=1e-3)
    assert result.task_motion.max() < 1e-10
    heave = separations(nominal, replace(result.dither, direction=HEAVE), *known)
    assert result.separable.all()
    assert result.separations.least == pytest.approx(heave.least, rel=1e-3)


def test_a_dither_does_not_depend_on_the_basis_of_its_freedom():
    """The search starts from directions, so that any spanning columns give the same dither."""
    nominal, rng = mechanism(0, n=4), np.random.default_rng(1)
    J = rng.normal(size=(1, 4))
    P = np.eye(4) - np.linalg.pinv(J) @ J
    cost = Cost(1e-3, np.asarray(nominal.plant.C)[:1], 1e-4)
    result = [
        designed_dither(nominal, P @ mix, [4.0, 16.0], cost, 0.5, LOOSE).dither
        for mix in (np.eye(4), np.eye(4) * (1 + 1e-15), rng.normal(size=(4, 4)))
    ]
    for each in result[1:]:
        assert each.frequency_hz == result[0].frequency_hz
        np.testing.assert_allclose(each.direction, result[0].direction, atol=1e-6)


def test_equally_good_sensors_keep_their_order():
    """The sensors measure one of the twins and the third mass each, with equal separations."""
    nominal, step = twins(), Dither(1e-2, 5.0, (1.0, 1.0, 1.0))
    for seed in range(12):
        rng = np.random.default_rng(seed)
        rows = [bits(rng, sign * np.eye(6)[k] + np.eye(6)[2]) for k in (0, 1) for sign in (1, -1)]
        for order in (range(4), [3, 1, 0, 2]):
            sensors = {str(k): (rows[k], 1e-5) for k in order}
            ranked = ranked_sensors(nominal, sensors, step, 1.0)
            assert [int(each.name) for each in ranked] == list(order)


ONSET = 1500


@cache
def dithered(ticks: int, dither: Dither = DITHER, *faults: Fault) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the loop on the spiral from 6 s on; return states and commands."""
    rig = hexapod_rig()
    path = rig.control.testbed.bench.spiral_rad((ticks + 1) * rig.period_s, begin_s=6.0)
    states, commanded = linear_run(rig, path, dither, faults, ONSET)
    return states[:ticks], commanded[:ticks]


def distances_of(
    fault: Fault, ticks: int, uncertainty: Uncertainty = CERTAIN
) -> tuple[np.ndarray, float]:
    """Return the distances from each failure and from none, `ticks` after a failure."""
    simulate = dithered(ONSET + ticks, DITHER, fault)
    return isolability(hexapod_rig().nominal, fault, ONSET, *simulate, uncertainty)


def test_gauges_on_the_struts_separate_all_without_a_dither():
    fault, bench = Fault(2, "free"), hexapod_rig().control.testbed.bench
    seen = nominal_model(hexapod_rig().model, bench, strut_sensors=True)
    result, _ = isolability(seen, fault, ONSET, *dithered(ONSET + 100, STILL, fault))
    assert np.delete(result, 2, axis=0).min() > 100


def test_the_distance_from_no_failure_is_that_of_the_outputs():
    """The distance is summed over ticks; means over four ticks lose some percent."""
    fault = Fault(0, "free")
    states, commanded = dithered(1700, DITHER, fault)
    healthy = fault_model(hexapod_rig().nominal)
    distance = (states - healthy.states(commanded)[:-1]) @ healthy.C.T
    _, result = distances_of(fault, 200)
    assert 0.9 < result / np.linalg.norm(distance) < 1.0


def test_an_uncertain_model_separates_less():
    fault = Fault(2, "locked")
    sure, from_none = distances_of(fault, 100)
    unsure, from_none_unsure = distances_of(fault, 100, TYPICAL)
    assert sure[2, KINDS.index("locked")] == unsure[2, KINDS.index("locked")] == 0.0
    others = np.delete(np.arange(6), 2)
    assert (unsure[others] < sure[others] + 1e-6).all()
    assert 0 < from_none_unsure < from_none


@pytest.mark.parametrize("kind", KINDS)
def test_distances_are_the_same_at_twice_and_half_the_control_rate(kind):
    """The evidence is the same: equal onsets per second and equal noise density."""
    result = []
    for period_s in (5e-4, 1e-3, 2e-3):
        plant = mechanism(1)
        density = np.sqrt(2e-3 / period_s)
        seen = replace(plant, period_s=period_s, step_s=5e-4, noise=density * plant.noise)
        fault, times = Fault(1, kind, 0.5 * (kind == "weak")), np.arange(0.0, 0.6, period_s)
        commanded = 1e-3 * np.sin(np.outer(times, [10.0, 25.0, 40.0]))
        onset = round(0.3 / period_s)
        before = fault_model(seen).states(commanded[:onset])
        after = fault_model(seen, [fault])
        failed = after.states(commanded[onset:], after.onset @ before[-1])
        states = np.vstack([before[:-1], failed[:-1]])
        far, from_none = isolability(seen, fault, onset, states, commanded, LOOSE)
        result.append([*np.delete(far, 1, axis=0).ravel(), from_none])
    for other in (result[0], result[2]):
        np.testing.assert_allclose(other, result[1], rtol=0.05)


@pytest.mark.parametrize(
    ("cause", "offset_m", "drift_m_per_s", "supply", "scale"),
    [
        pytest.param(Cause("offset", 0), 1e-6, 0.0, 1.0, 1.0, marks=pytest.mark.long),
        pytest.param(Cause("offset", 0), 0.0, 1e-5, 1.0, 1.0, marks=pytest.mark.long),
        (Cause("supply"), 0.0, 0.0, 0.8, 1.0),
        pytest.param(Cause("scale"), 0.0, 0.0, 1.0, 1.2, marks=pytest.mark.long),
    ],
)
def test_causes_are_far_from_every_failure(cause, offset_m, drift_m_per_s, supply, scale):
    """The distance on the spiral exceeds 6.2 within 0.2 s of the onset, before the loops react."""
    until, nominal = ONSET + 200, hexapod_rig().nominal
    since_s = ((np.arange(until) - ONSET) * nominal.period_s)[:, None]
    commanded, began = dithered(until)[1], since_s >= 0
    more = began * (offset_m + drift_m_per_s * since_s) * np.eye(6)[0]
    healthy, bank = fault_model(nominal), hypothesis_bank(nominal, (), TYPICAL, 4)
    moved = healthy.states(np.where(began, supply, 1.0) * commanded + more)[:-1] @ healthy.C.T
    outputs = np.where(began, scale, 1.0) * moved
    period = nominal.period_s, 4
    result, from_none = distances(bank, cause, ONSET, outputs, commanded, period, TYPICAL)
    assert 40 < result.min() < from_none
