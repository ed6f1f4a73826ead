"""A controller that is informed late or wrongly, and what the dither costs; on the exact model."""

from typing import Any

from experiments.recover.flight import AFTER_S, BEFORE_S, DITHER, STRUCK, Flight
from experiments.recover.recovery import controller, errors, fault_unaware, informed
from experiments.rig.hexapod.fault_tolerance import STILL, fault_text
from experiments.rig.hexapod.metrics import pointing_rms_urad
from experiments.rig.hexapod.simulation import track_path
from experiments.rig.hexapod.testbed import Testbed
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


def informed_late_or_wrongly(testbed: Testbed, flight: Flight) -> list[dict[str, Any]]:
    """One entry for each run: the truth, later and later; then, at once, that another strut locked.

    Ready for JSON, units in the names.
    """
    run, truth = fault_unaware(testbed, flight), flight.fault
    news = [(truth, late_s) for late_s in LATE_S]
    news += [(Fault(k, "locked"), 0.0) for k in range(6) if k != truth.actuator]
    entries = []
    for fault, late_s in news:
        stands_m = float(run.strut_displacement_m[STRUCK, fault.actuator])
        found = errors(informed(testbed, flight, fault, stands_m, late_s))
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


def dither_cost(testbed: Testbed, flight: Flight, duration_s: float) -> dict[str, Any]:
    """RMS of the fault-free (alpha, beta) errors, and its change by the dither and by the seed."""
    pilot = controller(testbed)

    def rms_urad(dither: Dither, seed: int) -> Array:
        never = OracleController(pilot, pilot, NEVER, secondary=flight.dither(dither).at)
        return pointing_rms_urad(track_path(testbed, never, seed=seed, duration_s=duration_s)[0])

    still = rms_urad(STILL, flight.seed)
    swinging, reseeded = rms_urad(DITHER, flight.seed), rms_urad(STILL, flight.seed + 1)
    return {
        "rms_urad": still.tolist(),
        "change_urad": (swinging - still).tolist(),
        "reseeded_urad": (reseeded - still).tolist(),
    }
