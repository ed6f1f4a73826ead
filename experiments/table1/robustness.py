"""Table I on plants that are not the controllers' model."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from experiments.rig.hexapod.metrics import closure_check, closure_residual_max_m, rms
from experiments.rig.hexapod.mismatch import ALL, ALL_SIZES, has_suspensions, mismatched
from experiments.rig.hexapod.simulation import SpiralRun, Trajectory
from experiments.rig.hexapod.testbed import Testbed
from experiments.study.results import Check
from sim import Array, ModelError

REPRESENTATIVE = ("W_a", "W_d", "W_a_uncorrected")
"""Columns flown with mismatch: all sound, one strut locked and known, locked and unknown. W_b and
W_c point as W_a does, and W_e as W_d, since all of them meet J_m M = I."""

TOLERANCE = 0.1
"""Largest relative distance of an RMS error from the nominal linear model's on the same floor."""


@dataclass(frozen=True)
class MismatchedRun:
    """One column on a drawn plant.

    Attributes:
        rms_rad: Of desired minus true (alpha, beta), shape (2,), from where the zero of the
            detector has drifted to: the loop follows the zero, and no controller could know.
        predicted_rad: The same by the linear model of the sound or locked *nominal* plant, with
            the same noise and the same floor, shape (2,).
        closure_residual_max_m: Of the run.
    """

    rms_rad: Array
    predicted_rad: Array
    closure_residual_max_m: float


def mismatched_flights(
    testbed: Testbed, runs: Mapping[str, SpiralRun], *, quick: bool
) -> dict[str, tuple[Testbed, SpiralRun]]:
    """The plants to fly, each column another one, all differences at once; --quick has one.

    None on a machine without suspension springs, which this mismatch is about.
    """
    if not has_suspensions(testbed.model):
        return {}
    names = REPRESENTATIVE[: 1 if quick else None]
    return {
        name: (mismatched(testbed, ALL, runs[name].seed + k), runs[name])
        for k, name in enumerate(names)
    }


def measured(column: str, testbed: Testbed, run: SpiralRun, flown: Trajectory) -> MismatchedRun:
    """Errors of a flight, beside those that the nominal linear model has on the same floor.

    Raises:
        sim.ModelError: The loops are unstable in the linear model.
    """
    # Late: workers import this module, and only simulate.
    from experiments.rig.hexapod.prediction import predicted_error_rad

    ticks, period_s = len(flown.time_s), testbed.bench.control_period_s
    zero_rad = testbed.machine.zero_rad(ticks, period_s)
    floor = testbed.machine.floor(ticks, period_s)
    predicted = predicted_error_rad(
        replace(testbed, inexact=None), replace(run, floor_m_per_s2=floor)
    )
    if predicted is None:
        raise ModelError(f"the loops of {column} are unstable on this machine")
    return MismatchedRun(
        rms_rad=rms(flown.desired_rad - (flown.true_rad + zero_rad)),
        predicted_rad=rms(predicted),
        closure_residual_max_m=closure_residual_max_m(flown),
    )


def robustness(found: Mapping[str, MismatchedRun]) -> dict[str, Any] | None:
    """What was flown and how far it was off at the most, ready for JSON; None: nothing was."""
    if not found:
        return None
    off = max(float(abs(r.rms_rad / r.predicted_rad - 1).max()) for r in found.values())
    return {
        "sizes": ALL_SIZES,
        "tolerance": TOLERANCE,
        "largest_relative_difference": off,
        "closure_residual_max_m": max(r.closure_residual_max_m for r in found.values()),
        "sentence": (
            f"On plants with all mismatches at once ({', '.join(found)}; another plant each) the "
            f"RMS errors differ by at most {100 * off:.1f} % from those of the nominal linear "
            f"model with the same noise and floor; up to {100 * TOLERANCE:.0f} % was accepted."
        ),
    }


def robustness_checks(summary: Mapping[str, Any]) -> list[Check]:
    """Check that the loops stayed closed on every plant flown."""
    found = summary["mismatch"]
    if found is None:
        return []
    return [closure_check("mismatched plants", found["closure_residual_max_m"])]
