"""The study of the Jacobian as numbers, checks, tables, a paragraph to cite, and files."""

import math
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.jacobian.figure import pictures
from experiments.jacobian.loop import VARIANTS, LoopRun, Tracked
from experiments.jacobian.loop_results import loop_checks, loop_table, summarize_loop
from experiments.jacobian.runs import Constancy
from experiments.jacobian.variation import NORMS, ByNorm, Norm, Variation, size
from experiments.recording.record import About, write_run
from experiments.rig.hexapod import paper
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.rig.hexapod.metrics import plant_constants
from experiments.rig.hexapod.rig import hexapod_rig, nominal_testbed
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.provenance import version_properties, versions
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table, tabulate
from sim import load_model, model_sha256

CERTIFICATE_LIMIT = 1.02
"""Largest ratio of the certified bound to the value found."""
SAME_JACOBIAN = 1e-9
"""Largest difference of eq. (39) from geometry and from the MJCF."""


def results(constancy: Constancy) -> Results:
    """Everything that `fjh jacobian` publishes."""
    summary = summarize(constancy)
    loop = summary.get("loop")
    recorded = [each for each in constancy.loop.items() if each[0].is_recorded]
    return Results(
        summary,
        tables=(table(summary), *([loop_table(loop)] if loop else [])),
        notes=(summary["paragraph"], *([loop["paragraph"]] if loop else [])),
        checks=checks(summary),
        pictures=pictures(summary),
        records=[partial(_record, *each, summary) for each in recorded],
    )


def summarize(constancy: Constancy) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON; units are in the names."""
    base, *_ = constancy.variations.values()
    summary: dict[str, Any] = {
        "experiment": "jacobian",
        "seed": constancy.seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "bench": asdict(TestbedConfig()) | plant_constants(load_model()),
        "stroke_m": paper.STROKE_M,
        "J0": constancy.J_0.tolist(),
        "J0_from_mjcf_largest_difference": float(np.abs(constancy.J_0_mjcf - constancy.J_0).max()),
        "J0_printed_largest_difference": float(np.abs(paper.JACOBIAN - constancy.J_0).max()),
        "condition_number": float(np.linalg.cond(constancy.J_0)),
        "paper_condition_number": paper.CONDITION_NUMBER,
        "variation": {norm: _certified(constancy, base[norm], norm) for norm in NORMS},
        "readings": {
            name: {norm: _found(by_norm[norm]) for norm in NORMS}
            for name, by_norm in constancy.variations.items()
        },
        "tried": [_trial(name, e) for name, e in constancy.tried.items()],
        "newton_error_m": constancy.newton_error_m,
    }
    summary["paragraph"] = _paragraph(summary)
    if constancy.loop:
        summary["loop"] = summarize_loop(constancy.loop, constancy.seed)
    return summary


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: certified bound within 2 % of the value found; closed-loop runs against geometry."""
    off = summary["J0_from_mjcf_largest_difference"]
    found = [Check("largest difference of geometry and MJCF", "eq. (39)", off, SAME_JACOBIAN)]
    for norm, one in summary["variation"].items():
        where, bound = f"eq. (40), {norm} norm", one["certified_upper_bound"] or math.nan
        below, near = one["value"] / bound, bound / one["value"]
        found.append(Check("value found divided by its certified bound", where, below, 1.0))
        found.append(
            Check("certified bound divided by the value found", where, near, CERTIFICATE_LIMIT)
        )
    return found + (loop_checks(summary["loop"]) if "loop" in summary else [])


def table(summary: dict[str, Any]) -> Table:
    """The certified values, the paper's, and everything that was tried."""
    variation = summary["variation"].items()
    above = {norm: one["certified_upper_bound"] or math.nan for norm, one in variation}
    printed = {norm: one["paper"] for norm, one in variation}
    entries = [{"reading": "certified to be at most"} | above]
    entries += [{"reading": "paper", "digits": 4} | printed, *summary["tried"]]

    def value(norm: Norm, entry: dict[str, Any]) -> str:
        return f"{entry[norm]:.{entry.get('digits', 5)}f}"

    columns = (
        Column("how eq. (40) is read", "reading"),
        Column("Frobenius", partial(value, "frobenius")),
        Column("2-norm", partial(value, "two")),
        Column("paper's at", _part_of_stroke),
    )
    title = "Eq. (40): largest relative change of J over the stroke"
    legend = "paper's at: the part of the stroke on which a reading gives both printed numbers."
    return tabulate(title, columns, entries, legend)


def _part_of_stroke(entry: dict[str, Any]) -> str:
    if "stroke_fraction" not in entry:
        return ""
    if entry["is_the_papers"]:
        return "all of it"
    if entry["stroke_fraction"] is None:
        return "-"
    low, high = entry["stroke_fraction"]
    return f"{100 * low:.0f}-{100 * high:.0f} %"


def _record(run: LoopRun, tracked: Tracked, summary: dict[str, Any], folder: Path) -> None:
    """Write one run's data and its recording."""
    (jacobian, form), growth = VARIANTS[run.variant], run.growth._asdict()
    grown = nominal_testbed().scaled(**growth)
    plain = {"seed": run.seed, "model_sha256": summary["model_sha256"], "variant": run.variant}
    factors = {f"{name}_factor": times for name, times in growth.items()}
    around = asdict(grown.bench) | plant_constants(grown.model)
    duration_s = len(tracked.run.time_s) * grown.bench.control_period_s
    about = About(
        study="jacobian",
        identity=f"jacobian-{run.name}",
        title=run.name,
        said=[
            f"- {run.column}, strut 1 locked; seed {run.seed}, {duration_s:g} s.",
            f"- Spiral {run.growth} as large as the paper's.",
            f"- {jacobian.capitalize()} Jacobian, {form} displacements.",
            f"- Deviation of the secondary goal from its optimum: {tracked.extra_percent:.2f} %.",
            f"- e visited: {tracked.e_visited['frobenius']:.1e} (Frobenius), "
            f"{tracked.e_visited['two']:.1e} (2-norm).",
        ],
        parameters=plain | factors | version_properties(summary) | around,
        checks=checks(summary),
    )
    write_run(
        folder / f"{run.name}.rrd",
        hexapod_rig(grown),
        tracked.run,
        about,
        arrays=hexapod_arrays(tracked.run),
        known="known to the mapping",
    )


def _certified(constancy: Constancy, found: Variation, norm: Norm) -> dict[str, Any]:
    nominal, certificate = float(size(constancy.J_0, norm)), constancy.certificates[norm]
    terms = [term / nominal for term in certificate.terms]
    holds = bool(np.isfinite(certificate.upper_bound))
    remainder = {"remainder": certificate.remainder / nominal if holds else None}
    return _found(found) | {
        "certified_upper_bound": certificate.upper_bound / nominal if holds else None,
        "paper": paper.JACOBIAN_VARIATION[norm],
        "certificate": dict(zip(("linear", "quadratic", "cubic"), terms, strict=True)) | remainder,
    }


def _found(variation: Variation) -> dict[str, Any]:
    return {"value": variation.value, "at_strut_m": variation.at_strut_m.tolist()}


def _trial(name: str, e: ByNorm) -> dict[str, Any]:
    """Whether e is the paper's pair, and between which parts of the stroke it would be.

    Rounding allowed for; e grows in proportion to the stroke, to 1 % here.
    """
    printed, half = paper.JACOBIAN_VARIATION, paper.JACOBIAN_VARIATION_TOLERANCE
    low = max((printed[norm] - half) / e[norm] for norm in NORMS)
    high = min((printed[norm] + half) / e[norm] for norm in NORMS)
    return {
        "reading": name,
        **e,
        "is_the_papers": all(abs(e[norm] - printed[norm]) < half for norm in NORMS),
        "stroke_fraction": (low, high) if low < high else None,
    }


def _paragraph(summary: dict[str, Any]) -> str:
    """The answer in one paragraph, to be cited."""
    frobenius, two = (summary["variation"][norm] for norm in ("frobenius", "two"))
    certified = max(one["certified_upper_bound"] for one in (frobenius, two))
    ours = [f'"{one["reading"]}"' for one in summary["tried"] if one["is_the_papers"]]
    number, which = len(summary["tried"]), " and ".join(ours) or "none"
    return (
        f"Over the stroke of +-{1e3 * summary['stroke_m']:g} mm (searches with seed "
        f"{summary['seed']}) the Jacobian of the University of Wyoming hexapod differs from its "
        f"nominal value by e = {frobenius['value']:.5f} in the Frobenius norm and "
        f"{two['value']:.5f} in the 2-norm (eq. 40), and provably by no more than "
        f"{frobenius['certified_upper_bound']:.5f} and {two['certified_upper_bound']:.5f}. "
        f"Chen, McInroy and Yi print {frobenius['paper']:.4f} and {two['paper']:.4f}; for their "
        f"own geometry e is larger by factors of {frobenius['value'] / frobenius['paper']:.1f} and "
        f"{two['value'] / two['paper']:.1f}. Of {number} readings of (40) that were tried, "
        f"{which} gives both. That J is nearly constant holds: e is at most "
        f"{100 * certified:.2f} % (condition number of J: {summary['condition_number']:.2f})."
    )
