"""External benchmark: Varga's examples 6.1 and 6.2, an F-16 and its nine models.

A. Varga, Solving Fault Diagnosis Problems: Linear Synthesis Techniques (Springer, 2017), examples
6.1 and 6.2; the same in FDITOOLS User's Guide V1.0 (github.com/andreasvarga/FDITools,
fditoolsdoc.pdf), examples 6, 15 and 16. There is no published table: the numbers below are the
coordinates of the lines in the guide's vector figures 4 and 6, converted by the figures' axes.
States: sideslip, roll angle, roll rate, yaw rate; inputs: aileron, rudder.
"""

from collections.abc import Sequence
from functools import cache, partial

import control
import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov
from scipy.signal import lfilter

from ftc.fdi import CERTAIN, DEFAULT_CONFIG, Fault
from ftc.fdi.bank import HypothesisBank, bank_of
from ftc.fdi.decision import CONFIDENCE, LARGEST_UNEXPLAINED, Decision, decide
from ftc.fdi.fault_model import FaultModel
from ftc.fdi.observer import Parameters, ResidualTest
from ftc.fdi.separation import distances
from ftc.fdi.uncertainty import uncertain_model
from tests.ftc.carts import Record, gathered, outputs_of
from tests.ftc.spectra import spectrum_of, whitened

A = np.array(
    [
        [-0.4492, 0.046, 0.0053, -0.9926],
        [0, 0, 1, 0.0067],
        [-50.8436, 0, -5.2184, 0.722],
        [16.4148, 0, 0.0026, -0.6627],
    ]
)
B = np.array([[0.0004, 0.0011], [0, 0], [-1.4161, 0.2621], [-0.0633, -0.1205]])
EFFECT = np.array([[aileron, rudder] for aileron in (1, 0.5, 0) for rudder in (1, 0.5, 0)])
"""Remaining effectiveness of the actuators in models 1 to 9."""

GRID = np.array([[20 - i, 20 - j] for i in range(21) for j in range(21)]) / 20
"""The 441 aircraft of example 6, each assigned to the nearest of the nine models."""

MATCHES = {
    "parameters": [36, 60, 30, 60, 100, 50, 30, 50, 25],
    "H-infinity": [28, 50, 27, 62, 110, 59, 26, 54, 25],
    "H2": [30, 55, 29, 56, 107, 59, 26, 54, 25],
}
"""Figure 4: number of the 441 aircraft nearest to each model, by three distances."""

NORMS = np.array(
    [
        [0.00, 0.92, 1.84, 13.67, 13.70, 13.79, 27.34, 27.35, 27.40],
        [0.92, 0.00, 0.92, 13.70, 13.67, 13.70, 27.36, 27.34, 27.35],
        [1.84, 0.92, 0.00, 13.79, 13.70, 13.67, 27.40, 27.36, 27.34],
        [13.67, 13.70, 13.79, 0.00, 0.92, 1.84, 13.67, 13.70, 13.79],
        [13.70, 13.67, 13.70, 0.92, 0.00, 0.92, 13.70, 13.67, 13.70],
        [13.79, 13.70, 13.67, 1.84, 0.92, 0.00, 13.79, 13.70, 13.67],
        [27.34, 27.35, 27.40, 13.67, 13.70, 13.79, 0.00, 0.92, 1.84],
        [27.35, 27.34, 27.35, 13.70, 13.67, 13.70, 0.92, 0.00, 0.92],
        [27.40, 27.35, 27.34, 13.79, 13.70, 13.67, 1.84, 0.92, 0.00],
    ]
)
"""Figure 6: H-infinity norms of the differences of the nine models."""

READING = 0.01
"""Accuracy of NORMS: heights that are equal by symmetry differ by up to 0.006 in the figure."""

FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-3, 1e2, 90), np.linspace(3.9, 4.3, 60)])
"""Frequencies [rad/s], dense near the mode of the aircraft."""

PERIOD_S, END_S, DEGREES = 0.01, 10.0, 180 / np.pi
INPUT_NOISE, OUTPUT_NOISE = 0.01, 0.03
"""Widths of the uniform noise of example 6.2, on the states' rates and on the two angles [deg]."""


def model(remaining: ArrayLike, outputs: int = 4, unit: float = 1.0) -> control.StateSpace:
    """Return an aircraft with this effectiveness; the first states are measured."""
    C = unit * np.eye(outputs, 4)
    return control.ss(A, B * np.asarray(remaining), C, np.zeros((outputs, 2)))


def output_distance(
    first: control.StateSpace, second: control.StateSpace, noise: np.ndarray
) -> float:
    """Return the H-infinity norm of the difference of two models in units of output noise."""
    jw = 1j * FREQUENCIES
    difference = first(jw, squeeze=False) - second(jw, squeeze=False)
    whitened = np.moveaxis(difference, -1, 0) / noise[:, None]
    return float(np.linalg.norm(whitened, 2, axis=(1, 2)).max())


def sampled() -> control.StateSpace:
    """Return the healthy aircraft, sampled with a hold, with inputs [commands; noise]."""
    whole = control.ss(A, np.hstack([B, np.eye(4)]), DEGREES * np.eye(2, 4), np.zeros((2, 6)))
    return control.c2d(whole, PERIOD_S)


SIGMA = np.full(2, OUTPUT_NOISE / np.sqrt(12))  # standard deviation of uniform noise
PLANT = sampled()[:, :2]
ALONE, TOGETHER = [1, 2, 3, 6], [4, 5, 7, 8]  # models with one actuator weak, with both


def input_fault_model(faults: Sequence[Fault] = ()) -> FaultModel:
    """Return the sampled aircraft with faults of its inputs, states [x; last commands].

    An actuator acts through its column of B: free, the column is zero; weak, it is multiplied by
    the effectiveness; locked, the last command before the fault stays, as of a stuck surface.
    """
    remaining, stuck = np.ones(2), np.zeros(2)
    for fault in faults:
        if fault.kind == "locked":
            stuck[fault.actuator] = 1.0
        else:
            remaining[fault.actuator] *= fault.effectiveness if fault.kind == "weak" else 0.0
    B = PLANT.B * remaining
    return FaultModel(
        A=np.block([[PLANT.A, B * stuck], [np.zeros((2, 4)), np.diag(stuck)]]),
        B=np.vstack([B * (1 - stuck), np.diag(1 - stuck)]),
        C=np.hstack([PLANT.C / SIGMA[:, None], np.zeros((2, 2))]),
        onset=np.eye(6),
        drift=np.zeros(6),
    )


def input_fault_bank(*faults: Fault) -> HypothesisBank:
    """Return the hypotheses of one more fault of an input in addition to the known ones."""
    return bank_of(partial(uncertain_model, input_fault_model), 2, faults)


def commands() -> np.ndarray:
    """Return example 6.2's commands: a square wave of period 2 pi plus 0.3, a sine plus 1.5."""
    t = np.arange(round(END_S / PERIOD_S) + 1) * PERIOD_S
    return np.column_stack([(t % (2 * np.pi) >= np.pi) + 0.3, np.sin(2 * t) + 1.5])


def measured(remaining: ArrayLike, rng: np.random.Generator, gusts: bool) -> np.ndarray:
    """Simulate example 6.2's measured angles [deg], with or without noise on the rates."""
    plant, u = sampled(), commands()
    w = INPUT_NOISE * rng.uniform(-0.5, 0.5, (len(u), 4)) * gusts
    y = control.forced_response(
        plant, inputs=np.hstack([u * np.asarray(remaining), w]).T, return_states=False
    )
    return y.outputs.T + OUTPUT_NOISE * rng.uniform(-0.5, 0.5, (len(u), 2))


def kalman_decisions(y: np.ndarray) -> np.ndarray:
    """Return the model 0..8 chosen by Varga's nine Kalman filters at each tick of a record (N, 2).

    Example 6.2, first design: noise intensities 1e-4 and 0.04, each filter divided by its smallest
    H-infinity norm over the other models, 0.9 |r| plus 0.1 times the root of |r|^2 filtered by
    1 / (s + 10). The model of the smallest signal is chosen.
    """
    C = DEGREES * np.eye(2, 4)
    L = solve_continuous_are(A.T, C.T, 1e-4 * np.eye(4), 0.04 * np.eye(2)) @ C.T / 0.04
    F, u = A - L @ C, commands()
    filters = [control.ss(F, np.hstack([B * e, L]), C, np.zeros((2, 4))) for e in EFFECT]
    driven, signals = [each[:, :2] for each in filters], []
    for i, each in enumerate(filters):
        others = driven[:i] + driven[i + 1 :]
        scale = min(output_distance(driven[i], other, np.ones(2)) for other in others)
        estimate = control.forced_response(
            control.c2d(each, PERIOD_S), inputs=np.hstack([u, y]).T
        ).outputs.T
        squared = ((y - estimate) ** 2).sum(axis=1) / scale**2
        pole = np.exp(-10 * PERIOD_S)
        smooth = lfilter([0, (1 - pole) / 10], [1, -pole], squared)
        signals.append(0.9 * np.sqrt(squared) + 0.1 * np.sqrt(smooth))
    return np.argmin(signals, axis=0)


def test_the_published_distances_are_reproduced_at_unit_noise():
    """Figure 6's norms are d per unit input energy if each output has white noise of density 1."""
    computed = [[output_distance(model(a), model(b), np.ones(4)) for b in EFFECT] for a in EFFECT]
    assert np.abs(np.array(computed) - NORMS).max() < READING


def test_the_published_decisions_are_reproduced_except_exact_ties():
    """80 of the 441 lie midway between models; round-off decided these in Varga's figure."""
    lost = GRID[:, None] - EFFECT
    Q = solve_continuous_lyapunov(A.T, -np.eye(4))
    jw = 1j * FREQUENCIES[:, None, None] * np.eye(4)
    G = np.linalg.solve(jw - A, np.broadcast_to(B, (len(jw), 4, 2)))
    K = (G.conj().swapaxes(-1, -2) @ G)[:, None, None] * lost[..., :, None] * lost[..., None, :]
    distances = {
        "parameters": np.linalg.norm(lost, axis=-1),
        "H2": np.sqrt((lost**2) @ np.diag(B.T @ Q @ B)),
        "H-infinity": np.sqrt(np.linalg.eigvalsh(K)[..., -1].max(axis=0)),
    }
    for name, d in distances.items():
        nearest = d <= d.min(axis=1, keepdims=True) + 1e-9
        tied = nearest.sum(axis=1) > 1
        assert tied.sum() == 80
        assert (nearest[~tied].sum(axis=0) <= MATCHES[name]).all()
        assert (nearest.sum(axis=0) >= MATCHES[name]).all()


def test_the_distance_bounds_the_isolability_of_a_run():
    """The d of example 6.2's commands is below root(energy) times the distance per input energy."""
    bank, u = input_fault_bank(), commands()[:600]
    half = input_fault_model([Fault(0, "weak", 0.5)])
    by_kind, d = distances(bank, Fault(0, "weak", 0.5), 0, outputs_of(half, u), u, (PERIOD_S, 1))
    per_energy = output_distance(
        model(EFFECT[0], 2, DEGREES), model(EFFECT[3], 2, DEGREES), SIGMA * np.sqrt(PERIOD_S)
    )
    bound = per_energy * np.sqrt((u[:, 0] ** 2).sum() * PERIOD_S)
    assert 0.02 * bound < d < bound
    assert by_kind[0, 2] == 0 < by_kind[1].min() <= d


@pytest.mark.long
@pytest.mark.parametrize("gusts", [False, True])
def test_nine_kalman_filters_choose_the_correct_model_as_published(gusts):
    """Figure 9's pattern, zeros on the diagonal: correct from 0.2 s on for each aircraft."""
    for k, remaining in enumerate(EFFECT):
        y = measured(remaining, np.random.default_rng(k), gusts)
        assert (kalman_decisions(y)[20:] == k).all()


WHITE = np.ones((1, 2))  # without process noise nothing needs a filter


@cache
def whitening(gusts: bool) -> np.ndarray:
    """Return the whitening filter of one healthy run of 10 s, seed 1000."""
    if not gusts:
        return WHITE
    return spectrum_of(healthy_residuals(1000, gusts), order=10).filter()


def healthy_residuals(seed: int, gusts: bool) -> np.ndarray:
    y = measured(EFFECT[0], np.random.default_rng(seed), gusts)
    return y / SIGMA - outputs_of(input_fault_model(), commands())


def decide_at(
    bank: HypothesisBank, y: np.ndarray, tick: int, weights: np.ndarray = WHITE
) -> Decision:
    """Decide at a tick, with onsets at growing distances back to the start of the record."""
    back = {0, *np.geomspace(1, tick, 10).round().astype(int).tolist()}
    record = Record(None, 1, commands()[: tick + 1], y[: tick + 1] / SIGMA)
    onsets, prior = tick - np.array(sorted(back, reverse=True)), Parameters.prior(0, 2, CERTAIN)
    return decide(bank, gathered(bank, record, prior, weights, onsets), tick)


def isolates(decision: Decision) -> bool:
    """Return whether an actuator would be isolated with the settings of a monitor."""
    sure = decision.actuator_confidence >= CONFIDENCE
    return sure and decision.unexplained <= LARGEST_UNEXPLAINED


def assert_isolated(decision: Decision, actuator: int, left: float, error: float = 1e-3) -> None:
    """Check that the actuator is isolated with its effectiveness, and the residuals are noise."""
    assert isolates(decision)
    assert decision.inflation < 1.5
    assert decision.fault.actuator == actuator
    assert decision.fault.effectiveness == pytest.approx(left, abs=error)


@pytest.mark.parametrize("gusts, errors", [(False, (0.08, 1e-3)), (True, (0.08, 0.015))])
@pytest.mark.parametrize("k", ALONE)
def test_the_bank_isolates_one_weak_actuator_and_its_effectiveness(k, gusts, errors):
    """The decisions are 0.2 and 3 s after the onset, with or without process noise."""
    y = measured(EFFECT[k], np.random.default_rng(k), gusts)
    for tick, error in zip((20, 300), errors, strict=True):
        decision = decide_at(input_fault_bank(), y, tick, whitening(gusts))
        assert_isolated(decision, int(EFFECT[k, 0] == 1), EFFECT[k].min(), error)


def test_the_bank_estimates_a_weakness_between_the_nine_models():
    """The nine filters' choice with 0.7 of the aileron wanders, also to the rudder."""
    y = measured((0.7, 1.0), np.random.default_rng(0), gusts=False)
    assert_isolated(decide_at(input_fault_bank(), y, 300), 0, 0.7)
    assert len(set(kalman_decisions(y)[100:])) > 2


@pytest.mark.parametrize("k", TOGETHER)
def test_two_weak_actuators_leave_residuals_until_one_is_known(k):
    """The bank has no such hypothesis; its best one may be isolated, as the motions are large."""
    y = measured(EFFECT[k], np.random.default_rng(k), gusts=False)
    early, *later = (decide_at(input_fault_bank(), y, tick) for tick in (20, 100, 300))
    assert early.inflation > 2
    assert all(decision.inflation > 100 for decision in later)
    bank = input_fault_bank(Fault(0, "weak", float(EFFECT[k, 0])))
    assert_isolated(decide_at(bank, y, 300), 1, EFFECT[k, 1])


def alarms(seed: int, gusts: bool, filtered: np.ndarray) -> bool:
    """Return whether the residual test raises an alarm in a healthy run of 10 s."""
    test = ResidualTest(2, DEFAULT_CONFIG.false_alarms_per_hour, PERIOD_S)
    recent, remaining = test.start(), healthy_residuals(seed, gusts)
    for residual in whitened(filtered, remaining):
        recent = np.vstack([recent[1:], residual])
        if test.alarm(recent):
            return True
    return False


def test_process_noise_raises_an_alarm_only_if_treated_as_white():
    """The residuals drift; whitened by the spectrum of another run they are noise."""
    y, bank = measured(EFFECT[0], np.random.default_rng(0), True), input_fault_bank()
    assert not isolates(decide_at(bank, y, 100, whitening(True)))
    assert alarms(0, True, WHITE)
    assert not alarms(0, True, whitening(True))
    assert not alarms(0, False, WHITE)
