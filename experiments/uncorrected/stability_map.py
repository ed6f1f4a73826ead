"""Both ratios over damping and crossover, in the linear model."""

from dataclasses import dataclass, replace

import control
import mujoco
import numpy as np

from experiments.hexapod.compensator import compensators
from experiments.hexapod.mapping import StrutMapping
from experiments.hexapod.metrics import rms
from experiments.hexapod.prediction import detector_noise_rad, driven_loop
from experiments.hexapod.testbed import Bench
from experiments.uncorrected.candidate import COLUMNS, STRUT
from experiments.uncorrected.candidates import BENCH
from experiments.uncorrected.machine import damped
from sim import Array, Failure, ModelError, failed_plant, hexapod, linearize

ROLL_OFF_HZ = (25.0, 40.0)
"""The bench's, below the modes; and one at them, behind which a locked mode can close the loop."""


@dataclass(frozen=True)
class Grid:
    """Where the map is computed; beta's crossover keeps the bench's distance from alpha's."""

    damping_ratio: Array
    alpha_crossover_hz: Array


def grid(*, quick: bool) -> Grid:
    """From a twentieth of the bench's damping to twice it, from a third of its crossover on."""
    return Grid(
        damping_ratio=np.geomspace(0.005, 0.2, 3 if quick else 9),
        alpha_crossover_hz=np.geomspace(3.0, 24.0, 3 if quick else 10),
    )


def at_crossover(bench: Bench, alpha_hz: float, roll_off_hz: float) -> Bench:
    """The bench with other loops."""
    beta_hz = alpha_hz * bench.beta_crossover_hz / bench.alpha_crossover_hz
    return replace(
        bench, alpha_crossover_hz=alpha_hz, beta_crossover_hz=beta_hz, roll_off_hz=roll_off_hz
    )


def map_row(
    model: mujoco.MjModel,
    bench: Bench,
    damping_ratio: float,
    alpha_crossover_hz: Array,
    roll_off_hz: float,
    seed: int,
) -> tuple[Array, Array]:
    """RMS of desired minus true pointing along the crossovers, and the largest closed-loop poles.

    Args:
        model: The hexapod.
        bench: All but its loops.
        damping_ratio: Of the pointing modes.
        alpha_crossover_hz: Shape (K,).
        roll_off_hz: Corner of the low-pass.
        seed: Of the detector noise.

    Returns:
        (K, 2, 2): W_a and W_a_uncorrected, alpha and beta, [rad]; infinite where the loop is
        unstable. (K, 4): largest pole of each of COLUMNS; infinite where the sound loop is not to
        be closed.
    """
    machine = damped(model, damping_ratio)
    goals = {name: BENCH.run(name, seed)["goal"] for name in COLUMNS}
    geometry, lock = hexapod(machine), (Failure(STRUT, "locked"),)
    gains = {
        name: StrutMapping(geometry, goals[name], "constant").pointing_gain() for name in goals
    }
    plants = {name: failed_plant(machine, () if name == "W_a" else lock) for name in COLUMNS}
    sound = linearize(plants["W_a"].model, plants["W_a"].data)
    errors = np.full((len(alpha_crossover_hz), 2, 2), np.inf)
    poles = np.full((len(alpha_crossover_hz), len(COLUMNS)), np.inf)
    for k, alpha_hz in enumerate(alpha_crossover_hz):
        here = at_crossover(bench, alpha_hz, roll_off_hz)
        try:
            G = compensators(sound, gains["W_a"], here)
        except ModelError:
            continue
        loops = {name: driven_loop(plants[name], gains[name], G) for name in COLUMNS}
        poles[k] = [np.abs(loops[name].poles()).max() for name in COLUMNS]
        for j, name in enumerate(("W_a", "W_a_uncorrected")):
            if poles[k, COLUMNS.index(name)] < 1:
                errors[k, j] = rms(_error_rad(loops[name], here, seed))
    return errors, poles


def _error_rad(T: control.StateSpace, bench: Bench, seed: int) -> Array:
    time_s = bench.time_s(bench.duration_s)
    desired = bench.desired_rad(time_s)
    driven = np.zeros((len(time_s), T.ninputs))
    driven[:, :2] = desired - detector_noise_rad(bench, seed, len(time_s))
    return desired - np.asarray(control.forced_response(T, time_s, driven.T).outputs).T
