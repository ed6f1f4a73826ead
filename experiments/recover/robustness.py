"""False alarms, late and wrong diagnoses, and a plant that is not quite the model."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import mujoco
import numpy as np
from scipy.stats import binomtest, chi2

from experiments.hexapod.fault_tolerance import STILL, excitation, fault_text, nominal_model
from experiments.hexapod.metrics import pointing_rms_urad
from experiments.hexapod.simulation import track_path
from experiments.hexapod.testbed import Testbed
from experiments.recover.recovery import (
    DITHER,
    STRUCK,
    Identification,
    Scenario,
    controller,
    errors,
    fault_unaware,
    identify,
    informed,
)
from ftc.fdi.calibration import calibrated
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel, fault_model
from ftc.fdi.residual_test import ResidualTest, residual_test
from ftc.oracle import NEVER, OracleController
from sim import Array

LATE_S = (0.03, 0.1, 0.3, 1.0)
"""How late a diagnosis may come."""

INFORMED_LATE = tuple(
    Scenario(fault, 8.25, (0.0,) * 6, seed=0)
    for fault in (Fault(0, "locked"), Fault(0, "free"), Fault(0, "weak", 1.0))
)
"""Of these the controller is informed late or wrongly; the last is no failure at all."""

GAIN_ERRORS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
"""Of each coil of a plant off the model, relative, standard deviation."""


def informed_late_or_wrongly(testbed: Testbed, scenario: Scenario) -> list[dict[str, Any]]:
    """One entry for each run: the truth, later and later; then, at once, that another strut locked.

    Ready for JSON, units in the names.
    """
    run, truth = fault_unaware(testbed, scenario), scenario.fault
    news = [(truth, late_s) for late_s in LATE_S]
    news += [(Fault(k, "locked"), 0.0) for k in range(6) if k != truth.actuator]
    entries = []
    for fault, late_s in news:
        stands_m = float(run.strut_displacement_m[STRUCK, fault.actuator])
        found = errors(informed(testbed, scenario, fault, stands_m, late_s))
        entries.append(
            {
                "truth": "sound" if truth.effectiveness == 1 else fault_text(truth),
                "told": fault_text(fault),
                "late_ms": 1e3 * late_s,
                "peak_during_urad": found.peak_urad[1],
                "rms_after_urad": found.rms_urad[2],
                "rms_after_told_nothing_urad": errors(run).rms_urad[2],
                "peak_after_urad": found.peak_urad[2],
            }
        )
    return entries


@dataclass(frozen=True)
class FaultFree:
    """Hours of fault-free runs, or of such runs with fresh noise; runs with an alarm."""

    hours: float
    alarms: int

    @property
    def upper_per_hour(self) -> float:
        """Exact 95 % upper bound on the rate of a Poisson process."""
        return float(chi2.ppf(0.95, 2 * (self.alarms + 1)) / 2 / self.hours)

    @property
    def entry(self) -> dict[str, float]:
        """The rate with its two one-sided 95 % bounds, ready for JSON."""
        low = chi2.ppf(0.05, 2 * self.alarms) / 2 / self.hours if self.alarms else 0.0
        rate = {"per_hour": self.alarms / self.hours, "low_per_hour_95": float(low)}
        return asdict(self) | rate | {"high_per_hour_95": self.upper_per_hour}


def together(parts: Sequence[FaultFree]) -> FaultFree:
    """All of them as one."""
    return FaultFree(sum(each.hours for each in parts), sum(each.alarms for each in parts))


def rate(right: Sequence[bool]) -> dict[str, Any]:
    """With the exact (Clopper and Pearson) 95 % interval; no cases, no rate."""
    counted = {"cases": len(right), "right": sum(right)}
    if not right:
        return counted | {"rate": None, "low": None, "high": None}
    interval = binomtest(sum(right), len(right)).proportion_ci(0.95)
    bounds = {"low": float(interval.low), "high": float(interval.high)}
    return counted | {"rate": sum(right) / len(right)} | bounds


def rates(found: Sequence[Identification]) -> dict[str, Any]:
    """Of the strut as first named, and of strut and kind in the end; ready for JSON."""
    strut, both = [each.strut_right for each in found], [each.right for each in found]
    return {"strut": rate(strut), "strut_and_kind": rate(both)}


def dither_cost(testbed: Testbed, scenario: Scenario, duration_s: float) -> dict[str, Any]:
    """RMS of the fault-free (alpha, beta) errors, and its change by the dither and by the seed."""
    pilot = controller(testbed)

    def rms_urad(dither: Dither, seed: int) -> Array:
        never = OracleController(pilot, pilot, NEVER, secondary=scenario.dither(dither).at)
        return pointing_rms_urad(track_path(testbed, never, seed=seed, duration_s=duration_s)[0])

    still = rms_urad(STILL, scenario.seed)
    swinging, reseeded = rms_urad(DITHER, scenario.seed), rms_urad(STILL, scenario.seed + 1)
    return {
        "rms_urad": still.tolist(),
        "change_urad": (swinging - still).tolist(),
        "reseeded_urad": (reseeded - still).tolist(),
    }


def fault_free(
    testbed: Testbed, scenario: Scenario, duration_s: float, draws: int
) -> tuple[FaultFree, FaultFree, float]:
    """One fault-free run in a scenario's posture, and the same with fresh noise.

    The residuals of a run are the detector's noise and what the linear model leaves out. The noise
    is the larger by far and hardly changes the rest, so that the run with fresh noise stands for
    another run.

    Returns:
        As simulated; with so many draws of noise; and the largest residual without noise, [urad].
    """
    nominal = nominal_model(testbed.model, testbed.bench)
    secondary = scenario.dither(DITHER).at
    commanded, measured, true = _fault_free(testbed, nominal, secondary, scenario.seed, duration_s)
    expected = fault_model(nominal).outputs(commanded)
    silent, test = true - expected, _residual_test(nominal)
    hours = len(silent) * testbed.bench.control_period_s / 3600
    rng = np.random.default_rng([scenario.seed, 3])
    alarms = sum(
        bool(test.alarms(silent + rng.standard_normal(silent.shape)).any()) for _ in range(draws)
    )
    return (
        FaultFree(hours, int(test.alarms(measured - expected).any())),
        FaultFree(draws * hours, alarms),
        float(1e6 * np.abs(silent * nominal.noise).max()),
    )


def _residual_test(nominal: NominalModel) -> ResidualTest:
    rate = DEFAULT_CONFIG.false_alarms_per_hour
    return residual_test(len(nominal.noise), rate, nominal.period_s)


def _fault_free(
    testbed: Testbed,
    nominal: NominalModel,
    secondary: Callable[[float], Array],
    seed: int,
    duration_s: float,
    plant: mujoco.MjModel | None = None,
) -> tuple[Array, Array, Array]:
    """Commands from each tick on (N, 6); whitened (alpha, beta), measured and true, (N, 2) each."""
    pilot = controller(testbed)
    never = OracleController(pilot, pilot, NEVER, secondary=secondary)
    machine = replace(testbed, inexact=plant)
    run, _ = track_path(machine, never, seed=seed, duration_s=duration_s)
    commanded_m = pilot.amplifier.displacement_m(run.strut_input_percent)
    return commanded_m, run.measured_rad / nominal.noise, run.true_rad / nominal.noise


def mismatched(
    testbed: Testbed, error: float, scenarios: Sequence[Scenario]
) -> list[dict[str, Any]]:
    """Failures of a plant whose coils differ: diagnosed as if they were alike, and once calibrated.

    Two entries, ready for JSON; `error` is that of the gains, relative.
    """
    plant, seed = copy.copy(testbed.model), scenarios[0].seed
    rng = np.random.default_rng(seed)
    plant.actuator_gainprm[:, 0] *= 1 + error * rng.standard_normal(plant.nu)
    nominal = nominal_model(testbed.model, testbed.bench)
    duration_s = testbed.bench.duration_s
    swinging = scenarios[0].dither(DITHER).at
    run, measured, _ = _fault_free(testbed, nominal, excitation, seed, duration_s, plant)
    corrected = calibrated(nominal, run, measured)
    commanded, measured, _ = _fault_free(testbed, nominal, swinging, seed, duration_s, plant)

    def entry(known: NominalModel) -> dict[str, Any]:
        found = [identify(testbed, each, plant=plant, nominal=known)[1] for each in scenarios]
        residuals = measured - fault_model(known).outputs(commanded)
        return {
            "coil_gain_error": error,
            "calibrated": known is corrected,
            "healthy_alarm": bool(_residual_test(known).alarms(residuals).any()),
            "false_alarms": sum(each.false_alarm for each in found),
        } | rates(found)

    return [entry(nominal), entry(corrected)]
