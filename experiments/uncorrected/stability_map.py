"""Both ratios over damping and crossover, in the linear model."""

from dataclasses import dataclass, replace
from typing import Any

import control
import mujoco
import numpy as np

from experiments.rig.hexapod.controller import designed, nominal_loops
from experiments.rig.hexapod.machine import detector_noise_rad
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.prediction import open_loop
from experiments.rig.rig import Rig
from experiments.rig.run import Run, rms
from experiments.uncorrected.candidates import (
    BENCH,
    COLUMNS,
    EXPERIMENTS,
    PAPER_RATIOS,
    RATIO_TOLERANCE,
    damped,
)
from experiments.uncorrected.predicted import faults_of, gain_and_plant, predicted_error_rad
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
    pointing, plant = gain_and_plant(machine, "W_a")
    healthy, rig = linearize(plant.model, plant.data), None
    errors = np.full((len(alpha_crossover_hz), 2, 2), np.inf)
    poles = np.full((len(alpha_crossover_hz), len(COLUMNS)), np.inf)
    for k, alpha_hz in enumerate(alpha_crossover_hz):
        here = at_crossover(bench, alpha_hz, roll_off_hz)
        try:
            testbed = Testbed(machine, here, designed(healthy, pointing, here))
        except ModelError:
            continue
        rig = hexapod_rig(testbed) if rig is None else _with(rig, testbed)
        loops = {name: _closed(rig, name) for name in COLUMNS}
        poles[k] = [np.abs(loops[name].poles()).max() for name in COLUMNS]
        for j, name in enumerate(("W_a", "W_a_uncorrected")):
            if poles[k, COLUMNS.index(name)] < 1:
                errors[k, j] = rms(_error_rad(loops[name], here, seed))
    return errors, poles


def _with(rig: Rig, testbed: Testbed) -> Rig:
    """The same linear model with the compensators of another testbed."""
    return replace(rig, control=replace(rig.control, testbed=testbed))


def _closed(rig: Rig, column: str) -> control.StateSpace:
    """The closed loop from reference to pointing, in one of COLUMNS."""
    return control.feedback(open_loop(rig, EXPERIMENTS[column].goal, faults_of(column)), np.eye(2))


def _error_rad(T: control.StateSpace, bench: TestbedConfig, seed: int) -> Array:
    desired = bench.spiral_rad()
    time_s, noise = bench.time_s(bench.duration_s), detector_noise_rad(bench, seed, len(desired))
    return desired - np.asarray(control.forced_response(T, time_s, (desired - noise).T).outputs).T


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
    """Arguments of `runs.simulate`: W_a and uncorrected, point after point."""
    calls = []
    for ratio, alpha_hz, roll_off_hz in CHECKED_POINTS:
        machine = damped(load_model(), ratio)
        bench = at_crossover(TestbedConfig(), alpha_hz, roll_off_hz)
        testbed = Testbed(machine, bench, nominal_loops(machine, bench))
        how = {"testbed": testbed, "candidate": BENCH, "seed": seed}
        how["duration_s"] = bench.duration_s
        calls += [how | {"column": column} for column in ("W_a", "W_a_uncorrected")]
    return calls


def compare_checked(calls: list[dict[str, Any]], ended: list[Run | float]) -> list[dict[str, Any]]:
    """Simulated beside predicted RMS at the checked points of the map."""
    compared = []
    for k, (call, run) in enumerate(zip(calls, ended, strict=True)):
        error = predicted_error_rad(**call, lead_in_s=0.0)
        simulated = (1e6 * run.rms()).tolist() if isinstance(run, Run) else None
        where = dict(zip(_CHECKED_BY, CHECKED_POINTS[k // 2], strict=True))
        predicted = None if error is None else (1e6 * rms(error)).tolist()
        outcome = {"predicted_urad": predicted, "simulated_urad": simulated}
        compared.append({"name": call["column"]} | where | outcome)
    return compared
