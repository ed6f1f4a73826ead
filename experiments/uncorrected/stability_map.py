"""Both ratios over damping and crossover, in the linear model."""

from dataclasses import dataclass, replace
from typing import Any

import control
import mujoco
import numpy as np

from experiments.rig.hexapod.controller import designed, nominal_loops
from experiments.rig.hexapod.metrics import pointing_rms_urad, rms
from experiments.rig.hexapod.prediction import detector_noise_rad, driven_loop, predicted_error_rad
from experiments.rig.hexapod.simulation import Trajectory
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.uncorrected.candidates import BENCH, COLUMNS, PAPER_RATIOS, RATIO_TOLERANCE, damped
from experiments.uncorrected.predicted import gain_and_plant
from sim import Array, ModelError, linearize, load_model

ROLL_OFF_HZ = (25.0, 40.0)
"""The testbed's, below the modes; and one at the modes, where a locked mode can be unstable."""

CHECKED_POINTS = ((0.05, 12.0, 25.0), (0.02, 6.0, 40.0), (0.005, 7.3, 40.0))
"""Map points that are simulated too."""
_CHECKED_BY = ("damping_ratio", "alpha_crossover_hz", "roll_off_hz")


@dataclass(frozen=True)
class Grid:
    """Where the map is computed; beta's crossover has the testbed's ratio to alpha's."""

    damping_ratio: Array
    alpha_crossover_hz: Array


def grid(*, quick: bool) -> Grid:
    """From a twentieth of the testbed's damping to twice it, from a third of its crossover on."""
    return Grid(
        damping_ratio=np.geomspace(0.005, 0.2, 3 if quick else 9),
        alpha_crossover_hz=np.geomspace(3.0, 24.0, 3 if quick else 10),
    )


def at_crossover(bench: TestbedConfig, alpha_hz: float, roll_off_hz: float) -> TestbedConfig:
    """The testbed with other loops."""
    beta_hz = alpha_hz * bench.beta_crossover_hz / bench.alpha_crossover_hz
    return replace(
        bench, alpha_crossover_hz=alpha_hz, beta_crossover_hz=beta_hz, roll_off_hz=roll_off_hz
    )


def map_row(
    model: mujoco.MjModel,
    bench: TestbedConfig,
    damping_ratio: float,
    alpha_crossover_hz: Array,
    roll_off_hz: float,
    seed: int,
) -> tuple[Array, Array]:
    """RMS of desired minus true pointing along the crossovers, and the largest closed-loop poles.

    The testbed is used with other loops; the damping ratio is of the pointing modes.

    Returns:
        (K, 2, 2): W_a and W_a_uncorrected, alpha and beta, [rad]; infinite where the loop is
        unstable. (K, 4): largest pole of each of COLUMNS; infinite where no sound loop exists.
    """
    machine = damped(model, damping_ratio)
    driven = {name: gain_and_plant(machine, name) for name in COLUMNS}
    pointing, plant = driven["W_a"]
    sound = linearize(plant.model, plant.data)
    errors = np.full((len(alpha_crossover_hz), 2, 2), np.inf)
    poles = np.full((len(alpha_crossover_hz), len(COLUMNS)), np.inf)
    for k, alpha_hz in enumerate(alpha_crossover_hz):
        here = at_crossover(bench, alpha_hz, roll_off_hz)
        try:
            G = [each.discrete for each in designed(sound, pointing, here)]
        except ModelError:
            continue
        loops = {name: driven_loop(plant, gain, G) for name, (gain, plant) in driven.items()}
        poles[k] = [np.abs(loops[name].poles()).max() for name in COLUMNS]
        for j, name in enumerate(("W_a", "W_a_uncorrected")):
            if poles[k, COLUMNS.index(name)] < 1:
                errors[k, j] = rms(_error_rad(loops[name], here, seed))
    return errors, poles


def _error_rad(T: control.StateSpace, bench: TestbedConfig, seed: int) -> Array:
    time_s = bench.time_s(bench.duration_s)
    desired = bench.desired_rad(time_s)
    driven = np.zeros((len(time_s), T.ninputs))
    driven[:, :2] = desired - detector_noise_rad(bench, seed, len(time_s))
    return desired - np.asarray(control.forced_response(T, time_s, driven.T).outputs).T


def map_numbers(where: Grid, map_rad: Array, map_poles: Array) -> dict[str, Any]:
    """The map in a few numbers, of RMS errors and poles stacked from :func:`map_row`.

    Their leading axes are roll-offs, dampings and crossovers.
    """
    both = np.isfinite(map_rad).all(axis=(-2, -1))
    ratio = map_rad[both][:, 1] / map_rad[both][:, 0]
    sound, corrected_d, corrected_e, uncorrected = np.moveaxis(map_poles < 1, -1, 0)
    corrected = corrected_d & corrected_e
    points = {
        "points": np.ones(both.shape),
        "points_stable": both,
        "points_within_tolerance": (np.abs(ratio / PAPER_RATIOS - 1) < RATIO_TOLERANCE).all(axis=1),
        "points_uncorrected_alone_unstable": sound & corrected & ~uncorrected,
        "points_corrected_alone_unstable": sound & uncorrected & ~corrected,
    }
    return {
        "data": "map.npz",
        "roll_off_hz": list(ROLL_OFF_HZ),
        **{name: values.tolist() for name, values in vars(where).items()},
        "alpha_ratio_range": [float(ratio[:, 0].min()), float(ratio[:, 0].max())],
        "beta_ratio_range": [float(ratio[:, 1].min()), float(ratio[:, 1].max())],
        **{name: int(held.sum()) for name, held in points.items()},
    }


def map_arrays(where: Grid, map_rad: Array, map_poles: Array) -> dict[str, Array]:
    """The contents of `map.npz`."""
    return vars(where) | {
        "roll_off_hz": np.array(ROLL_OFF_HZ),
        "rms_urad": 1e6 * map_rad,
        "largest_pole": map_poles,
    }


def checked_calls(seed: int) -> list[dict[str, Any]]:
    """Arguments of `track_spiral`: W_a and uncorrected, point after point."""
    calls = []
    for ratio, alpha_hz, roll_off_hz in CHECKED_POINTS:
        machine = damped(load_model(), ratio)
        bench = at_crossover(TestbedConfig(), alpha_hz, roll_off_hz)
        testbed = Testbed(machine, bench, nominal_loops(machine, bench))
        both = (BENCH.run(column, seed) for column in ("W_a", "W_a_uncorrected"))
        calls += [{"testbed": testbed, "run": run} for run in both]
    return calls


def compare_checked(
    calls: list[dict[str, Any]], ended: list[Trajectory | float]
) -> list[dict[str, Any]]:
    """Simulated beside predicted RMS at the checked points of the map."""
    compared = []
    for k, (call, run) in enumerate(zip(calls, ended, strict=True)):
        error = predicted_error_rad(**call)
        simulated = pointing_rms_urad(run).tolist() if isinstance(run, Trajectory) else None
        where = dict(zip(_CHECKED_BY, CHECKED_POINTS[k // 2], strict=True))
        predicted = None if error is None else (1e6 * rms(error)).tolist()
        outcome = {"predicted_urad": predicted, "simulated_urad": simulated}
        compared.append({"name": ("W_a", "W_a_uncorrected")[k % 2]} | where | outcome)
    return compared
