"""Table I on plants that are not the controllers' model."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from experiments.rig.checks import closure_check
from experiments.rig.hexapod.columns import Column
from experiments.rig.hexapod.machine import detector_noise_rad
from experiments.rig.hexapod.mismatch import ALL_SIZES, has_suspensions
from experiments.rig.rig import Rig
from experiments.rig.run import Run, rms
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


def mismatched_rigs(rigs: Mapping[str, Rig], seed: int, *, quick: bool) -> dict[str, Rig]:
    """Rigs by column on other plants, each another one, all differences at once; --quick has one.

    None on a machine without suspension springs, which this mismatch is about.
    """
    names = [name for name in REPRESENTATIVE if has_suspensions(rigs[name].model)]
    chosen = names[: 1 if quick else None]
    return {name: rigs[name].drawn("all", seed + k) for k, name in enumerate(chosen)}


def measured(name: str, rig: Rig, column: Column, run: Run, seed: int) -> MismatchedRun:
    """Errors of a run, beside those that the nominal linear model has on the same floor.

    Raises:
        sim.ModelError: The loops are unstable in the linear model.
    """
    machine, ticks = rig.machine, len(run.time_s)
    predicted = rig.predict(
        run.desired,
        failures=column.failures,
        told=False,
        noise=detector_noise_rad(machine.testbed.bench, seed, ticks),
        floor_m_per_s2=machine.floor(ticks),
    )
    if predicted.leaves is not None:
        raise ModelError(f"the loops of {name} are unstable on this machine")
    return MismatchedRun(
        rms_rad=rms(run.desired - (run.true + machine.zero_rad(ticks))),
        predicted_rad=predicted.rms,
        closure_residual_max_m=float(run.closure_m.max()),
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
