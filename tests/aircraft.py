"""Varga's examples 6.1 and 6.2: an F-16, its nine loss-of-effectiveness models, what he published.

A. Varga, Solving Fault Diagnosis Problems: Linear Synthesis Techniques (Springer, 2017), examples
6.1 and 6.2; the same in FDITOOLS User's Guide V1.0 (github.com/andreasvarga/FDITools,
fditoolsdoc.pdf), examples 6, 15 and 16. He prints no table: the numbers below are the coordinates
of the lines in the guide's vector figures 4 and 6, turned into values by the figures' own axes.
States: sideslip, roll angle, roll rate, yaw rate; inputs: aileron, rudder.
"""

from collections.abc import Sequence
from functools import partial

import control
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_continuous_are
from scipy.signal import lfilter

from ftc.fdi import Fault
from ftc.fdi.bank import HypothesisBank, bank_of
from ftc.fdi.fault_model import FaultModel
from ftc.fdi.uncertainty import uncertain_model

A = np.array(
    [
        [-0.4492, 0.046, 0.0053, -0.9926],
        [0, 0, 1, 0.0067],
        [-50.8436, 0, -5.2184, 0.722],
        [16.4148, 0, 0.0026, -0.6627],
    ]
)
B = np.array([[0.0004, 0.0011], [0, 0], [-1.4161, 0.2621], [-0.0633, -0.1205]])
LEFT = np.array([[aileron, rudder] for aileron in (1, 0.5, 0) for rudder in (1, 0.5, 0)])
"""Parts of their effectiveness that the actuators have left in models 1 to 9."""

GRID = np.array([[20 - i, 20 - j] for i in range(21) for j in range(21)]) / 20
"""The 441 aircraft of example 6, each assigned to the nearest of the nine models."""

MATCHES = {
    "parameters": [36, 60, 30, 60, 100, 50, 30, 50, 25],
    "H-infinity": [28, 50, 27, 62, 110, 59, 26, 54, 25],
    "H2": [30, 55, 29, 56, 107, 59, 26, 54, 25],
}
"""Figure 4: how many of the 441 are nearest to each model, by three distances. Whole numbers."""

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
"""Of NORMS: heights that must be equal by symmetry differ by up to 0.006 in the figure."""

FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-3, 1e2, 90), np.linspace(3.9, 4.3, 60)])
"""[rad]/[s], close together where the aircraft's mode is."""

PERIOD_S, END_S, DEGREES = 0.01, 10.0, 180 / np.pi
INPUT_NOISE, OUTPUT_NOISE = 0.01, 0.03
"""Widths of the uniform noise of example 6.2, on the states' rates and on the two angles [deg]."""


def model(left: ArrayLike, outputs: int = 4, unit: float = 1.0) -> control.StateSpace:
    """Of an aircraft with these parts left; the first states are measured."""
    return control.ss(A, B * np.asarray(left), unit * np.eye(outputs, 4), np.zeros((outputs, 2)))


def output_distance(
    first: control.StateSpace, second: control.StateSpace, noise: np.ndarray
) -> float:
    """H-infinity norm of the difference of two models, whitened by the noise of the outputs."""
    jw = 1j * FREQUENCIES
    apart = first(jw, squeeze=False) - second(jw, squeeze=False)
    whitened = np.moveaxis(apart, -1, 0) / noise[:, None]
    return float(np.linalg.norm(whitened, 2, axis=(1, 2)).max())


def input_fault_model(
    plant: control.StateSpace, noise: np.ndarray, faults: Sequence[Fault] = ()
) -> FaultModel:
    """A sampled plant with faults of its inputs, states [x; last commands].

    An actuator acts through its column of B alone: free, the column is zero; weak, it is multiplied
    by what is left; locked, it stays where the last command before had put it, as a control surface
    that is stuck. `noise` are the standard deviations of the outputs, (p,).
    """
    n, s = plant.ninputs, plant.nstates
    left, stuck = np.ones(n), np.zeros(n)
    for fault in faults:
        if fault.kind == "locked":
            stuck[fault.actuator] = 1.0
        else:
            left[fault.actuator] *= fault.effectiveness if fault.kind == "weak" else 0.0
    B = plant.B * left
    return FaultModel(
        A=np.block([[plant.A, B * stuck], [np.zeros((n, s)), np.diag(stuck)]]),
        B=np.vstack([B * (1 - stuck), np.diag(1 - stuck)]),
        C=np.hstack([plant.C / noise[:, None], np.zeros((plant.noutputs, n))]),
        onset=np.eye(s + n),
        drift=np.zeros(s + n),
    )


def input_fault_bank(
    plant: control.StateSpace, noise: np.ndarray, faults: Sequence[Fault] = ()
) -> HypothesisBank:
    """Hypotheses of one more fault of an input beside those that are known."""
    return bank_of(
        partial(uncertain_model, partial(input_fault_model, plant, noise)), plant.ninputs, faults
    )


def sampled() -> control.StateSpace:
    """The sound aircraft with commands and noise held for a tick, inputs [commands; noise]."""
    whole = control.ss(A, np.hstack([B, np.eye(4)]), DEGREES * np.eye(2, 4), np.zeros((2, 6)))
    return control.c2d(whole, PERIOD_S)


def commands() -> np.ndarray:
    """Example 6.2's at all ticks: a square wave of period 2 pi + 0.3, a sine of period pi + 1.5."""
    t = np.arange(round(END_S / PERIOD_S) + 1) * PERIOD_S
    return np.column_stack([(t % (2 * np.pi) >= np.pi) + 0.3, np.sin(2 * t) + 1.5])


def measured(left: ArrayLike, rng: np.random.Generator, gusts: bool) -> np.ndarray:
    """Example 6.2's measured angles [deg] of an aircraft, with or without noise on the rates."""
    plant, u = sampled(), commands()
    w = INPUT_NOISE * rng.uniform(-0.5, 0.5, (len(u), 4)) * gusts
    y = control.forced_response(
        plant, inputs=np.hstack([u * np.asarray(left), w]).T, return_states=False
    )
    return y.outputs.T + OUTPUT_NOISE * rng.uniform(-0.5, 0.5, (len(u), 2))


def kalman_decisions(y: np.ndarray) -> np.ndarray:
    """Which of the models 0..8 Varga's nine Kalman filters choose at each tick of records (N, 2).

    Example 6.2, first design: noise intensities 1e-4 and 0.04, each filter divided by its smallest
    H-infinity norm over the other models, 0.9 |r| plus 0.1 times the root of |r|^2 filtered by
    1 / (s + 10). The model of the smallest signal is chosen.
    """
    C = DEGREES * np.eye(2, 4)
    L = solve_continuous_are(A.T, C.T, 1e-4 * np.eye(4), 0.04 * np.eye(2)) @ C.T / 0.04
    F, u = A - L @ C, commands()
    filters = [control.ss(F, np.hstack([B * left, L]), C, np.zeros((2, 4))) for left in LEFT]
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
