"""A controller that is informed late or wrongly, on the exact model; and what the dither costs."""

from dataclasses import replace
from typing import Any

import numpy as np

from experiments.recover.flight import DITHER, STRUCK, Flight
from experiments.recover.pointing import errors, pointing_error_urad
from experiments.recover.recovery import AFTER_S, BEFORE_S, fault_unaware, informed
from experiments.rig.hexapod.fault_tolerance import STILL, fault_text
from experiments.rig.hexapod.metrics import pointing_rms_urad
from experiments.rig.hexapod.rig import HexapodRig
from experiments.rig.hexapod.simulation import trajectory
from experiments.rig.run import Run
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, FaultKind
from ftc.oracle import NEVER, OracleController
from sim import Array, Failure

LATE_S = (0.03, 0.1, 0.3, 1.0)
"""How late a diagnosis may come."""

_STRUCK_S = 8.25


def _centred(kind: FaultKind, effectiveness: float) -> Flight:
    """Strut 1 fails at the same point of the spiral, without a secondary displacement."""
    return Flight(
        number=0,
        sort="failure",
        draw=0,
        mismatch="exact",
        factor=1.0,
        plant_seed=0,
        failures=(Failure(0, kind, _STRUCK_S, effectiveness),),
        begin_s=_STRUCK_S - BEFORE_S,
        duration_s=BEFORE_S + AFTER_S,
        posture_m=(0.0,) * 6,
        seed=0,
    )


INFORMED_LATE = (_centred("locked", 0.0), _centred("free", 0.0), _centred("weak", 1.0))
"""Of these the controller is informed late or wrongly; the last is no failure at all."""


def informed_late_or_wrongly(rig: HexapodRig, flight: Flight) -> list[dict[str, Any]]:
    """One entry for each run: the truth, later and later; then, at once, that another strut locked.

    Ready for JSON, units in the names.
    """
    run, truth = fault_unaware(rig, flight), flight.fault
    news = [(truth, late_s) for late_s in LATE_S]
    news += [(Fault(k, "locked"), 0.0) for k in range(6) if k != truth.actuator]
    entries = []
    for fault, late_s in news:
        stands_m = float(run.displacement[STRUCK, fault.actuator])
        found = errors(informed(rig, flight, fault, stands_m, late_s))
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


def dither_cost(rig: HexapodRig, flight: Flight, duration_s: float) -> dict[str, Any]:
    """RMS of the fault-free (alpha, beta) errors, and its change by the dither and by the seed.

    And how far the dither moves the pointing, both angles together, on a plant that is not the
    model: there the struts do not cancel.
    """
    pilot, whole = rig.controller(), replace(flight, begin_s=0.0, duration_s=duration_s)

    def flown(plant: HexapodRig, dither: Dither, seed: int) -> Run:
        never = OracleController(pilot, pilot, NEVER, secondary=flight.dither(dither).at)
        return plant.fly(never, whole.path(rig), seed=seed)

    def rms_urad(dither: Dither, seed: int) -> Array:
        return pointing_rms_urad(trajectory(flown(rig, dither, seed)))

    mixed = rig.drawn("all", flight.plant_seed)
    quiet, moved = (flown(mixed, dither, flight.seed).true for dither in (STILL, DITHER))
    still = rms_urad(STILL, flight.seed)
    swinging, reseeded = rms_urad(DITHER, flight.seed), rms_urad(STILL, flight.seed + 1)
    return {
        "rms_urad": still.tolist(),
        "change_urad": (swinging - still).tolist(),
        "reseeded_urad": (reseeded - still).tolist(),
        "moved_urad": float(np.sqrt((pointing_error_urad(moved, quiet) ** 2).mean())),
    }
