"""The figures as numbers, tables and files."""

from dataclasses import asdict
from typing import Any

from experiments.figures.figure import pictures
from experiments.figures.geometry import node_names
from experiments.figures.runs import Portrait
from experiments.rig.hexapod.fault_tolerance import pointing_verdicts
from experiments.rig.hexapod.metrics import loop_measures, plant_constants
from experiments.study.provenance import versions
from experiments.study.results import Results
from experiments.study.tables import Column, Table, tabulate
from prioritized import FailureAtlas


def results(portrait: Portrait) -> Results:
    """Everything that `fjh figures` publishes; nothing of it is simulated, no check applies."""
    summary = summarize(portrait)
    return Results(
        summary,
        tables=(pointing_after_failures(summary),),
        notes=notes(summary),
        pictures=pictures(portrait),
    )


def summarize(portrait: Portrait) -> dict[str, Any]:
    """All numbers that are drawn, ready for JSON; units are in the names."""
    geometry = portrait.geometry
    return {
        "experiment": "figures",
        "seed": portrait.seed,
        "versions": versions(),
        "model_sha256": portrait.model_sha256,
        "bench": asdict(portrait.bench) | plant_constants(portrait.model),
        "modes_hz": portrait.modes_hz.tolist(),
        "loops": {one.angle: loop_measures(one.loop) for one in portrait.loops},
        "strut_length_m": geometry.nominal_length_m.tolist(),
        "nodes_m": {name: node.tolist() for name, node in node_names(geometry).items()},
        "atlas": _atlas(portrait.atlas),
    }


def _atlas(atlas: FailureAtlas) -> dict[str, Any]:
    assert atlas.elastic is not None  # the hexapod has springs
    return {
        "conditions": len(atlas.codes),
        "possible_rigid": int(atlas.possible.sum()),
        "possible_elastic": int(atlas.elastic.possible.sum()),
        "verdicts": {
            verdict.name: {
                "label": verdict.label,
                "conditions": int(verdict.holds.sum()),
                "by_number_of_failures": verdict.by_failures.tolist(),
            }
            for verdict in pointing_verdicts(atlas)
        },
    }


def notes(summary: dict[str, Any]) -> list[str]:
    """Crossover and margins of both loops."""
    return [f"Loop {name}: {loop['sentence']}." for name, loop in summary["loops"].items()]


def pointing_after_failures(summary: dict[str, Any]) -> Table:
    """One row for each verdict: in how many conditions, by the number of failed struts."""
    atlas = summary["atlas"]
    counts = [
        Column(str(k), lambda verdict, k=k: verdict["by_number_of_failures"][k]) for k in range(7)
    ]
    return tabulate(
        "Pointing by number of failed struts",
        [Column("pointing", "label"), *counts, Column("all", "conditions")],
        atlas["verdicts"].values(),
        f"Numbers of conditions, {atlas['conditions']} in all; a failed strut is locked or free.",
    )
