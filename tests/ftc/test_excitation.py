"""Laws of signatures, separations, dither design and sensor choice, on random mechanisms."""

from dataclasses import replace

import control
import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from scipy.stats import norm

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.fault_tolerance import HEAVE, nominal_model
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc.fdi import (
    KINDS,
    Cost,
    Dither,
    Fault,
    NominalModel,
    Uncertainty,
    designed_dither,
    fault_model,
    fault_responses,
    ranked_sensors,
    separation,
    separations,
    separations_at,
)
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.fault_model import FaultModel
from ftc.fdi.separation import ALIKE, distances
from sim import NOMINAL, load_model
from tests.cart_runs import outputs_of

LOOSE = Uncertainty(gain=0.03, stiffness=0.03, damping=0.2, delay_s=1e-3)
seeds = pytest.mark.parametrize("seed", range(3))
servos = pytest.mark.parametrize("servo", [False, True])


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


def random_dither(seed: int, n: int = 3, hz: float = 10.0) -> Dither:
    rng = np.random.default_rng([seed, 1])
    return Dither(1e-3, hz, tuple(rng.uniform(0.5, 1.0, size=n) * rng.choice([-1, 1], size=n)))


def demodulated(nominal: NominalModel, faults: list[Fault], dither: Dither) -> np.ndarray:
    """Phasor of the simulated outputs over the last 10 periods, by least squares."""
    ticks = np.arange(round(4.0 / nominal.period_s))
    commanded = np.array([dither.at(tick * nominal.period_s) for tick in ticks])
    y = outputs_of(fault_model(nominal, faults), commanded)
    angle = 2 * np.pi * dither.frequency_hz * nominal.period_s * ticks
    late = slice(-round(10 / dither.frequency_hz / nominal.period_s), None)
    waves = np.stack([np.sin(angle), np.cos(angle)], axis=1)[late]
    return np.array([1, 1j]) @ np.linalg.lstsq(waves, y[late], rcond=None)[0]


def signatures(
    nominal: NominalModel, dither: Dither
) -> tuple[tuple[Fault, ...], NDArray[np.complex128]]:
    """All failures of one actuator, and what each changes of the steady phasor, shape (9, p)."""
    known, u = (1.0,), dither.amplitude * np.array(dither.direction)
    found = fault_responses(nominal, [dither.frequency_hz], *known)
    of_part = dict(zip(found.parts.tolist(), range(1, 1 + len(found.parts)), strict=True))
    locked, free = found.change[0, :, 0], found.change[0, :, of_part[1.0]]
    half = found.change[0, :, of_part[0.5]] if 0.5 in of_part else free / 2
    changes = (np.stack([locked, free, half], axis=1) @ u).reshape(-1, len(nominal.noise))
    return separations(nominal, dither, *known).faults, changes.astype(complex)


@servos
@seeds
def test_a_signature_is_the_change_of_the_simulated_steady_state(seed, servo):
    nominal, dither = mechanism(seed, servo=servo), random_dither(seed)
    faults, found = signatures(nominal, dither)
    assert [fault.kind for fault in faults] == list(KINDS) * 3
    sound = demodulated(nominal, [], dither)
    changes = np.array([demodulated(nominal, [fault], dither) - sound for fault in faults])
    np.testing.assert_allclose(found, changes, atol=1e-6 * np.abs(changes).max())


def struck(nominal: NominalModel, fault: Fault, dither: Dither, time_s: float) -> tuple:
    """States and commands of a run in which the failure comes at rest, and then the dither."""
    before = 20
    times = np.arange(round(time_s / nominal.period_s)) * nominal.period_s
    commanded = np.vstack([np.zeros((before, 3)), [dither.at(time) for time in times]])
    return before, fault_model(nominal, [fault]).states(commanded)[:-1], commanded


@pytest.mark.parametrize("row", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (4, 8))])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
@pytest.mark.parametrize(
    ("servo", "tolerance"), [(False, 0.02), pytest.param(True, 0.1, marks=pytest.mark.long)]
)
def test_in_a_long_time_an_exact_model_separates_as_isolability_says(
    row, seed, servo, tolerance, monkeypatch
):
    """The transient fades in the sum; what is left is the energy of a sinusoid, T / 2 |a|^2.

    With any time of onset, as there, an explanation that begins at the end explains no more than no
    failure does. Between the losses of a servo's force, both interpolate, in other places.
    """
    nominal, dither, time_s = mechanism(seed, servo=servo), random_dither(seed), 3.0
    monkeypatch.setattr(separation, "_STEP_S", 0.01)  # of onsets, a tenth of a period
    found = separations(nominal, dither, time_s)
    onset, states, commanded = struck(nominal, found.faults[row], dither, time_s)
    bank, outputs = hypothesis_bank(nominal), states @ fault_model(nominal).C.T
    each_tick = nominal.period_s, 1
    expected, from_none = distances(bank, found.faults[row], onset, outputs, commanded, each_tick)
    nearest = np.minimum(found.distance[row], found.from_none[row]).reshape(-1, 3)
    others = np.arange(3) != found.faults[row].actuator
    slack = tolerance * from_none
    # Which loss still counts as weak differs: weak and free go together.
    np.testing.assert_allclose(nearest[others, 0], expected[others, 0], atol=slack)
    lost = nearest[others, 1:].min(axis=1), expected[others, 1:].min(axis=1)
    np.testing.assert_allclose(*lost, atol=slack)
    assert found.from_none[row] == pytest.approx(from_none, rel=tolerance)


@servos
@seeds
def test_a_separation_grows_with_amplitude_and_root_of_time_until_the_model_limits_it(seed, servo):
    """Noise averages out, an error of the model does not."""
    nominal, dither = mechanism(seed, servo=servo), random_dither(seed)

    def apart(scale: float, time_s: float, *uncertainty: Uncertainty) -> np.ndarray:
        larger = replace(dither, amplitude=scale * dither.amplitude)
        return separations(nominal, larger, time_s, *uncertainty).distance

    exact, loose = apart(1.0, 1.0), apart(1.0, 1.0, LOOSE)
    tiny = 1e-9 * exact.max()
    np.testing.assert_allclose(apart(3.0, 1.0), 3 * exact, atol=tiny)
    np.testing.assert_allclose(apart(1.0, 9.0), 3 * exact, atol=tiny)
    for longer in (apart(3.0, 1.0, LOOSE), apart(1.0, 9.0, LOOSE)):
        assert (longer >= loose - tiny).all() and (longer <= 3 * loose + tiny).all()
    assert (loose <= exact + tiny).all()
    endless = apart(1e6, 1.0, LOOSE)
    np.testing.assert_allclose(apart(1e7, 1.0, LOOSE), endless, rtol=0.05, atol=0.05)


@servos
@pytest.mark.parametrize("seed", range(2))
def test_separations_with_an_uncertain_model_are_those_of_drawn_machines(seed, servo):
    """Means and covariances of phasors of machines with random errors, and of noise; no calculus.

    Gains, springs and damping of each machine are drawn, and its own change is taken.
    """
    nominal, dither, T = mechanism(seed, servo=servo), random_dither(seed), 0.5
    draws, rng = 200, np.random.default_rng(seed)
    small = Uncertainty(0.01, 0.01, 0.05, delay_s=1e-4)
    rows = [0, 1, 5, 8]
    phasors = np.stack([drawn(nominal, dither, small, rng)[rows] for _ in range(draws)])
    values = np.concatenate([phasors.real, phasors.imag], axis=-1)
    by_noise = 2 * nominal.period_s / T * np.eye(2)
    found = separations(nominal, dither, T, small)
    nearest = signatures(nominal, dither)[1][rows]
    means = np.concatenate([nearest.real, nearest.imag], axis=-1)
    for i, first in enumerate(rows):
        for j, second in enumerate(rows):
            if found.faults[second].kind == "weak" or i == j:
                continue
            S = np.kron(np.eye(2), by_noise)
            S = S + (np.cov(values[:, i].T) + np.cov(values[:, j].T)) / 2
            gap = means[i] - means[j]
            expected = np.sqrt(gap @ np.linalg.solve(S, gap))
            assert found.distance[first, second] == pytest.approx(expected, rel=0.15)


def drawn(
    nominal: NominalModel, dither: Dither, spread: Uncertainty, rng: np.random.Generator
) -> NDArray[np.complex128]:
    """Signatures of a machine with errors, shape (9, p)."""
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
    return late * signatures(machine, dither)[1]


@seeds
def test_a_released_servo_takes_the_error_of_its_stiffness_with_it(seed):
    """Free, it is the same machine whatever its stiffness was: only the change was another."""
    nominal, dither = mechanism(seed, servo=True), random_dither(seed)
    u, step = dither.amplitude * np.array(dither.direction), 1e-6
    found = fault_responses(nominal, [dither.frequency_hz], 1.0, Uncertainty(stiffness=0.01))
    for k in range(3):
        A = nominal.plant.A - step * np.outer(nominal.plant.B[:, k], nominal.displacement[k])
        stiffer = replace(nominal, plant=control.ss(A, nominal.plant.B, nominal.plant.C, 0))
        before, after = (response(fault_model(each), dither) for each in (nominal, stiffer))
        expected = -0.01 / step * (after - before) @ u
        error = found.errors[0, k, -1, k] @ u
        np.testing.assert_allclose(error, expected, atol=1e-3 * np.abs(expected).max())


def response(model: FaultModel, dither: Dither) -> np.ndarray:
    """Whitened outputs per command, by one matrix inverse."""
    z = np.exp(2j * np.pi * dither.frequency_hz * 2e-3)
    return model.C @ np.linalg.inv(z * np.eye(len(model.A)) - model.A) @ model.B


def change(nominal: NominalModel, faults: list[Fault], dither: Dither) -> np.ndarray:
    """Of the steady outputs' phasor."""
    u = dither.amplitude * np.array(dither.direction)
    failed, sound = fault_model(nominal, faults), fault_model(nominal)
    return (response(failed, dither) - response(sound, dither)) @ u


@pytest.mark.parametrize(("servo", "tolerance"), [(False, 1e-9), (True, 0.08)])
@seeds
def test_the_nearest_loss_of_force_is_found(seed, servo, tolerance):
    """A fine grid of losses has none that is nearer, or much nearer where a servo's interpolate."""
    nominal, dither, T = mechanism(seed, servo=servo), random_dither(seed), 0.5
    found = separations(nominal, dither, T)
    size = np.sqrt(T / nominal.period_s / 2)
    losses = np.linspace(0.01, 0.95, 95)
    happens = [change(nominal, [fault], dither) for fault in found.faults]
    for other in range(3):
        weak = [change(nominal, [Fault(other, "weak", 1 - lost)], dither) for lost in losses]
        between = 0.51 * np.abs(np.diff(weak, axis=0)).max() * size * np.sqrt(2)
        for row, own in enumerate(happens):
            grid = size * np.linalg.norm(own - weak, axis=1).min()
            slack = tolerance * found.from_none[row]
            assert grid - between - slack <= found.distance[row, 3 * other + 2] <= grid + slack


def test_a_free_actuator_at_a_vibration_absorber_looks_locked():
    """At its frequency an absorber holds the mass to which it is attached still, as a lock does."""
    h, absorber, spring = 1e-3, 3000.0, 4000.0
    coupled, leak = 1500.0, 1e-3
    K = np.array(
        [
            [spring + coupled + absorber, -coupled, -absorber],
            [-coupled, spring + coupled, 0.0],
            [-absorber, 0.0, absorber],
        ]
    )
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K, -leak * np.eye(3)]])
    B = np.vstack([np.zeros((3, 2)), spring * np.eye(3, 2)])
    second = np.eye(1, 6, 1)
    nominal = NominalModel(control.ss(A, B, second, 0), np.eye(2, 6), np.full(1, 1e-5), 2 * h, h)
    hz = 2 / h * np.arcsin(np.sqrt(absorber) * h / 2) / (2 * np.pi)  # of the stepped equations

    def kinds_apart(at_hz: float) -> float:
        found = separations(nominal, Dither(1e-3, at_hz, (1.0, 1.0)), 1.0)
        return found.distance[0, 1]

    assert kinds_apart(hz) < 0.1
    assert min(kinds_apart(0.8 * hz), kinds_apart(1.2 * hz)) > 10.0


def twins() -> NominalModel:
    """Two equal masses, one sensor of their sum, and a third that it does not see."""
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-4000.0 * np.eye(3), -30.0 * np.eye(3)]])
    B = np.vstack([np.zeros((3, 3)), 4000.0 * np.eye(3)])
    C = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    return NominalModel(control.ss(A, B, C, 0), np.eye(3, 6), np.array([1e-5]), 2e-3, 1e-3)


def test_what_counts_as_alike_is_mistaken_once_in_a_thousand():
    assert norm.cdf(-ALIKE / 2) == pytest.approx(1e-3, rel=0.01)


def test_groups_name_what_is_alike_and_a_sensor_that_ends_it():
    """In step, twins leave the same gap; in turn, gaps of opposite sign."""
    nominal, known = twins(), (1.0,)
    step = Dither(1e-2, 5.0, (1.0, 1.0, 1.0))
    found = separations(nominal, step, *known)
    assert found.alike_actuators() == ((0, 1),) and found.least == 0.0
    assert found.undetected() == tuple(Fault(2, kind, 0.5 * (kind == "weak")) for kind in KINDS)
    # Uncoupled, each stands still when locked and when free.
    assert not found.distance[[0, 3, 6], [1, 4, 7]].any()
    in_turn = separations(nominal, replace(step, direction=(1.0, -1.0, 1.0)), *known)
    assert in_turn.alike_actuators() == () and found.isolable() == ()
    assert [fault.actuator for fault in in_turn.isolable()] == [0, 0, 0, 1, 1, 1]

    sum_again, third, first = np.eye(1, 6)[0] + np.eye(1, 6, 1)[0], np.eye(1, 6, 2)[0], np.eye(6)[0]
    candidates = {"sum": (sum_again, 1e-5), "third": (third, 1e-5), "first": (first, 1e-5)}
    ranked = ranked_sensors(nominal, candidates, step, *known)
    assert [each.alike for each in ranked] == [1, 1, 2]
    assert {each.name for each in ranked[:2]} == {"third", "first"}
    assert ranked_sensors(nominal, {}, step, *known) == ()


@servos
@seeds
def test_one_more_sensor_is_one_more_output_and_never_lowers_a_separation(seed, servo):
    """It can be ignored; with an uncertain model, too."""
    nominal, dither = mechanism(seed, servo=servo), random_dither(seed)
    known = 0.5, LOOSE
    before = separations(nominal, dither, *known)
    encoders = {str(k): (row, 1e-4) for k, row in enumerate(nominal.displacement)}
    ranked = ranked_sensors(nominal, encoders, dither, *known)
    for each in ranked:
        slack, (row, noise) = 1e-6 * before.distance.max(), encoders[each.name]
        C = np.vstack([nominal.plant.C, row])
        plant = control.ss(nominal.plant.A, nominal.plant.B, C, 0)
        beside = replace(nominal, plant=plant, noise=np.append(nominal.noise, noise))
        alone = separations(beside, dither, *known)
        np.testing.assert_allclose(each.separations.distance, alone.distance, atol=slack)
        assert (each.separations.distance >= before.distance - slack).all()
        assert (each.separations.from_none >= before.from_none - slack).all()
    order = [(each.alike, -each.separations.least) for each in ranked]
    assert order == sorted(order) and len(ranked) == 3


def freedom_of(J: np.ndarray) -> np.ndarray:
    return scipy.linalg.null_space(J)


def static_task(nominal: NominalModel) -> np.ndarray:
    """Slope of the first output at rest, shape (1, n)."""
    plant = nominal.plant
    return (-plant.C @ np.linalg.solve(plant.A, plant.B))[:1]


def spent(nominal: NominalModel, commanded: np.ndarray, hz: float) -> np.ndarray:
    """Commands, motions of actuators and of the first output, in units of what is allowed."""
    model, z = fault_model(nominal), np.exp(2j * np.pi * hz * nominal.period_s)
    x = np.linalg.solve(z * np.eye(len(model.A)) - model.A, model.B @ commanded)
    task = np.abs(nominal.plant.C[:1] @ x) / 1e-4
    return np.concatenate([np.abs(commanded) / 1e-3, np.abs(nominal.displacement @ x) / 1e-3, task])


@servos
@pytest.mark.parametrize("uncertainty", [Uncertainty(), LOOSE], ids=["exact", "uncertain"])
@pytest.mark.parametrize("seed", range(2))
def test_no_random_dither_of_equal_cost_is_better(seed, uncertainty, servo):
    """And the designed one costs what it may, and keeps the null space."""
    nominal = mechanism(seed, servo=servo)
    J, known = static_task(nominal), (0.5, uncertainty)
    N, frequencies = freedom_of(J), np.array([4.0, 16.0])
    cost = Cost(1e-3, np.asarray(nominal.plant.C)[:1], 1e-4)
    best = designed_dither(nominal, N, frequencies, cost, *known)
    u = best.dither.amplitude * np.array(best.dither.direction)
    assert np.abs(J @ u).max() < 1e-12 * np.abs(J).max()
    assert best.dither.frequency_hz in frequencies
    used = spent(nominal, u, best.dither.frequency_hz)
    assert used.max() == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(best.displacement, 1e-3 * used[3:6], rtol=1e-6)
    np.testing.assert_allclose(best.task_motion, 1e-4 * used[6:], rtol=1e-6)

    responses = fault_responses(nominal, frequencies, *known)
    rng = np.random.default_rng([seed, 2])
    for number in range(50):
        k = number % 2
        other = N @ rng.normal(size=N.shape[1])
        other /= spent(nominal, other, frequencies[k]).max()
        found = separations_at(responses, k, other)
        reached = [each.between_actuators[best.separable] for each in (found, best.separations)]
        assert reached[0].min() <= reached[1].min() * (1 + 1e-6)


def test_a_task_that_leaves_no_freedom_gets_no_dither():
    nominal = mechanism(0)
    cost = Cost(1e-3, np.asarray(nominal.plant.C), 1e-4)
    for none in (np.zeros((3, 0)), np.zeros((3, 3))):
        found = designed_dither(nominal, none, [5.0], cost, 1.0)
        assert found.dither.amplitude == 0.0 and found.separations.least == 0.0
        assert len(found.separations.undetected()) == 9


def test_for_the_hexapod_the_heave_is_found():
    """All struts alike: by symmetry pointing stays still, and each strut has a direction."""
    model, bench = load_model(), TestbedConfig()
    nominal = nominal_model(model, bench)
    J_m = np.linalg.inv(hexapod(model).inverse_jacobian(NOMINAL))[MAJOR]
    known, cost = (0.2, LOOSE), Cost(0.5e-6, np.asarray(nominal.plant.C), 1e-7)
    found = designed_dither(nominal, freedom_of(J_m), [20.0], cost, *known)
    np.testing.assert_allclose(found.dither.direction, HEAVE, atol=1e-3)
    assert found.task_motion.max() < 1e-10
    heave = separations(nominal, replace(found.dither, direction=HEAVE), *known)
    assert found.separable.all()
    assert found.separations.least == pytest.approx(heave.least, rel=1e-3)
