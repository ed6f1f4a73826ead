"""Single flights and comparisons, ready for JSON; struts are 1 to 6 for people."""

from typing import Any

import numpy as np

from experiments.recover.ambiguity import Lookalikes
from experiments.recover.flights import STRUCK
from experiments.recover.mismatch import Mismatch
from experiments.recover.recovery import Recovery, Told
from experiments.recover.second import Succession
from experiments.recover.statistics import rate
from ftc.fdi.fault_model import KINDS, Fault


def lookalike_entry(seen: Lookalikes) -> dict[str, Any]:
    """One failure as one setting sees it."""
    own = KINDS.index(seen.fault.kind)
    others = np.delete(seen.separation, seen.fault.strut, axis=0).min(axis=1)
    strut = int(np.delete(np.arange(6), seen.fault.strut)[others.argmin()])
    kinds = np.delete(seen.separation[seen.fault.strut], own)
    return {
        "setting": seen.setting,
        "failure": fault_entry(seen.fault),
        "where": seen.where,
        "from_soundness": seen.from_sound,
        "nearest_other_strut": strut + 1,
        "from_other_struts": float(others.min()),
        "nearest_other_kind": np.delete(KINDS, own)[kinds.argmin()].item(),
        "from_other_kinds": float(kinds.min()),
        "alike": [fault_entry(fault) | {"separation": d} for fault, d in seen.alike],
    }


def told_entry(told: Told) -> dict[str, Any]:
    """One flight told late or wrongly."""
    return {
        "truth": "sound" if told.case.strength == 1 else str(told.case.fault),
        "told": str(told.told),
        "late_ms": 1e3 * told.late_s,
        "peak_during_urad": told.flown.peak_urad[1],
        "rms_after_urad": told.flown.rms_urad[2],
        "rms_after_told_nothing_urad": told.uncorrected.rms_urad[2],
        "peak_after_urad": told.flown.peak_urad[2],
    }


def mismatch_entry(mismatch: Mismatch) -> dict[str, Any]:
    """One machine off the model."""
    return {
        "coil_gain_error": mismatch.error,
        "calibrated": mismatch.calibrated,
        "healthy_alarm": mismatch.healthy_alarm,
        "false_alarms": sum(each.false_alarm for each in mismatch.found),
        "strut": rate([each.strut_right for each in mismatch.found]),
        "strut_and_kind": rate([each.right for each in mismatch.found]),
    }


def flight_entry(flight: Succession) -> dict[str, Any]:
    """Failures in succession, and what was found."""
    return {
        "happened": [
            {"strut": each.strut + 1, "kind": each.kind, "time_s": each.time_s}
            for each in flight.failures
        ],
        "found": [fault_entry(fault) for fault in flight.found],
        "right": flight.right,
        "task_lost": flight.task_lost,
        "unexplained": flight.unexplained,
        "rms_in_the_end_urad": flight.rms_urad,
        "peak_urad": flight.peak_urad,
    }


def case_entry(recovery: Recovery) -> dict[str, Any]:
    """One failure of the main set."""
    found, first, last = recovery.found, recovery.found.first, recovery.found.last
    return {
        "truth": fault_entry(found.case.fault),
        "time_s": found.case.time_s,
        "seed": found.case.seed,
        "separation_from_others": recovery.from_others,
        "separation_from_kinds": recovery.from_kinds,
        "first": None if first is None else fault_entry(first.fault),
        "first_strut_confidence": None if first is None else first.strut_confidence,
        "alarm_ms": None if first is None else first.alarm_tick - STRUCK,
        "named_ms": None if first is None else first.tick - STRUCK,
        "last": None if last is None else fault_entry(last.fault),
        "kind_confidence": None if last is None else last.kind_confidence,
        "false_alarm": found.false_alarm,
        "rms_after_urad": recovery.supervised.rms_urad[2],
        "rms_after_oracle_urad": recovery.informed.rms_urad[2],
        "rms_after_uncorrected_urad": recovery.uncorrected.rms_urad[2],
    }


def fault_entry(fault: Fault) -> dict[str, Any]:
    """Struts are 1 to 6 for people."""
    left = {"strength": fault.strength} if fault.kind == "weak" else {}
    return {"strut": fault.strut + 1, "kind": fault.kind} | left
