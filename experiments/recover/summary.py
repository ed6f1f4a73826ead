"""`recover.json`: what was found, how surely, how fast, and what it was worth."""

from dataclasses import asdict
from typing import Any

from experiments.hexapod.testbed import Bench
from experiments.output.provenance import versions
from experiments.recover.ambiguity import ALIKE, EVIDENCE_S
from experiments.recover.cases import DITHER, RECOVERED_S
from experiments.recover.entries import (
    case_entry,
    flight_entry,
    lookalike_entry,
    mismatch_entry,
    told_entry,
)
from experiments.recover.flights import Found
from experiments.recover.recovery import Recovery
from experiments.recover.second import Succession
from experiments.recover.statistics import (
    alarm_rate,
    delays_ms,
    errors_urad,
    over_oracle,
    rate,
)
from experiments.recover.study import MAIN, Recover
from experiments.recover.wrong import Belief
from ftc.fdi.config import RULES
from ftc.fdi.fault_model import KINDS
from sim import model_sha256

SEPARATION = 10.0
"""Fixed beforehand: a failure counts in the isolation rate if the linear model puts half a second
of its outputs this far from every other explanation: odds of e^50 on average."""


def summarize(result: Recover, seed: int) -> dict[str, Any]:
    """All numbers, ready for JSON; units are in the names."""
    recoveries = result.recoveries
    return {
        "experiment": "recover",
        "seed": seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "jacobian": "constant",
        "bench": asdict(Bench()) | result.plant,
        "rules": asdict(RULES),
        "dither": asdict(DITHER),
        "recovered_from_s": RECOVERED_S,
        "isolation": _isolation(recoveries),
        "settings": [
            _setting(MAIN.name, [each.found for each in recoveries]),
            *(_setting(name, found) for name, found in result.others.items()),
        ],
        "delay_ms": {kind: delays_ms(recoveries, kind) for kind in KINDS},
        "errors_urad": {kind: errors_urad(recoveries, kind) for kind in KINDS},
        "after_over_oracle": over_oracle(recoveries),
        "false_alarms": {
            "flown": alarm_rate(result.flown),
            "with_fresh_noise": alarm_rate(result.redrawn),
            "model_error_max_urad": result.model_error_urad,
        },
        "dither_design": [asdict(point) for point in result.dither_design],
        "dither_cost": asdict(result.dither_cost),
        "ambiguity": {
            "alike_below": ALIKE,
            "evidence_s": EVIDENCE_S,
            "failures": [lookalike_entry(each) for each in result.lookalikes],
        },
        "beliefs": _beliefs(result.beliefs),
        "told": [told_entry(each) for each in result.told],
        "gave_up": sum(each.found.unexplained for each in recoveries),
        "second_failure": _second(result.pairs),
        "mismatch": [mismatch_entry(each) for each in result.mismatches],
        "shown": {name: flight_entry(flight) for name, (_, flight) in result.shown.items()},
        "closure_residual_max_m": max(
            [each.found.closure_residual_max_m for each in recoveries]
            + [each.closure_residual_max_m for each in result.pairs]
            + [flight.closure_residual_max_m for _, flight in result.shown.values()]
        ),
        "cases": [case_entry(each) for each in recoveries],
    }


def _isolation(recoveries: list[Recovery]) -> dict[str, Any]:
    apart = [each for each in recoveries if each.from_others >= SEPARATION]
    both = [each for each in apart if each.from_kinds >= SEPARATION]
    return {
        "separation_required": SEPARATION,
        "strut_as_first_named": rate([each.found.strut_right for each in apart]),
        "strut_and_kind_in_the_end": rate([each.found.right for each in both]),
        "all_cases_strut": rate([each.found.strut_right for each in recoveries]),
        "all_cases_strut_and_kind": rate([each.found.right for each in recoveries]),
        "smallest_separation_from_others": min(each.from_others for each in recoveries),
        "smallest_separation_from_kinds": min(each.from_kinds for each in recoveries),
    }


def _setting(name: str, found: list[Found]) -> dict[str, Any]:
    return {
        "name": name,
        "named": sum(each.first is not None for each in found),
        "strut": rate([each.strut_right for each in found]),
        "strut_and_kind": rate([each.right for each in found]),
    }


def _beliefs(beliefs: list[Belief]) -> dict[str, Any]:
    worst = max(beliefs, key=lambda each: each.sensitivity_peak)
    return {
        "pairs_of_truth_and_belief": len(beliefs),
        "unstable": sum(each.largest_pole >= 1 for each in beliefs),
        "largest_pole": max(each.largest_pole for each in beliefs),
        "sensitivity_peak_nothing_failed": beliefs[0].sensitivity_peak,
        "sensitivity_peak_worst": worst.sensitivity_peak,
        "worst_truth": str(worst.truth or "sound"),
        "worst_belief": str(worst.believed or "sound"),
    }


def _second(pairs: list[Succession]) -> dict[str, Any]:
    return {
        "all_right": rate([each.right for each in pairs]),
        "gave_up": sum(each.unexplained for each in pairs),
        "flights": [flight_entry(each) for each in pairs],
    }
