"""The four goals as numbers, checks, a table and files."""

from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.goals import secondary_goals
from experiments.goals.demonstration import REFERENCE, Demonstration, Outcome, Strategy
from experiments.goals.figure import MEASURES, pictures, strategy_label
from experiments.goals.runs import DEMONSTRATIONS, Goals
from experiments.recording.file import RecordingInfo
from experiments.recording.layout import write_scenes
from experiments.recording.properties import checked, constants
from experiments.recording.record import About, write_views
from experiments.recording.scene import condition_scene
from experiments.recording.signals import Plot
from experiments.recording.view import Change, RunView, as_run_arrays, stated_of
from experiments.rig.arm import ARM_MJCF
from experiments.rig.checks import closure_check
from experiments.rig.hexapod.metrics import plant_constants
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.run import rms
from experiments.study.provenance import version_properties, versions
from experiments.study.results import Check, Results
from experiments.study.tables import Column, Table, tabulate
from sim import Array, load_model, model_sha256

CHANGES = {
    "rms_change_urad": "change of the RMS of the pointing error",
    "peak_change_urad": "change of its peak",
    "difference_rms_urad": "RMS of the change of pointing, tick by tick",
    "difference_peak_urad": "largest change of pointing at one tick",
}
"""What another seed does to the two angles, and what a goal must stay below."""

_STRUTS = [f"strut {k} [um]" for k in range(1, 7)]
_COILS = [f"coil {k} [C]" for k in range(1, 7)]
_DETAILS: dict[str, tuple[str, str, list[str], float]] = {
    "reliability": ("temperature_c", "Coil temperatures [C]", _COILS, 1.0),
    "stroke": ("strut_displacement_m", "Strut displacements [um]", _STRUTS, 1e6),
    "obstacle": ("strut_displacement_m", "Strut displacements [um]", _STRUTS, 1e6),
    "singularity": ("singular_values", "Singular values of J_m [1]", ["largest", "smallest"], 1.0),
}
"""What else a recording shows: array, title, names of its columns, factor to their units."""


def results(goals: Goals) -> Results:
    """Everything that `fjh goals` publishes."""
    summary = summarize(goals)
    each = [(goal, goals.outcomes[goal["name"]]) for goal in summary["goals"]]
    return Results(
        summary,
        tables=(table(summary),),
        checks=checks(summary),
        pictures=pictures(goals.outcomes, summary),
        arrays={goal["data"]: _arrays(goal, ours) for goal, ours in each},
        records=[partial(_record, goal, ours, summary) for goal, ours in each],
    )


def summarize(goals: Goals) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON; units are in the names."""
    return {
        "experiment": "goals",
        "seed": goals.seed,
        "versions": versions(),
        "model_sha256": {"fjh": model_sha256(), "arm": model_sha256(ARM_MJCF)},
        "jacobian": "constant",
        "bench": asdict(TestbedConfig()) | plant_constants(load_model()),
        "goals": [_entry(one, goals) for one in DEMONSTRATIONS],
    }


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: limits kept with the goal and violated without; pointing changes below the noise."""
    found = []
    for goal in summary["goals"]:
        where, measure = goal["name"], goal["measure"]
        runs = {run["name"]: run for run in goal["runs"]}
        for name, run in runs.items():
            found.append(closure_check(f"{where}, {name}", run["closure_residual_max_m"]))
        # Positive where the limit is broken, whichever its side.
        sign = 1 if goal["keeps_below"] else -1
        beyond = {name: sign * (run[measure] - goal["limit"]) for name, run in runs.items()}
        kept = f"distance of {measure} from its limit, which must be violated,"
        found += [
            Check(f"{measure} beyond its limit", f"{where}, pursued", beyond["pursued"], 0),
            Check(kept, f"{where}, nothing", -beyond["nothing"], 0),
        ]
        for key, what in CHANGES.items():
            change = max(map(abs, runs["pursued"][key]))
            noise = goal["another_seed"][key]
            found.append(Check(f"{what} [urad]", f"{where}, pursued", change, noise))
    return found


def table(summary: dict[str, Any]) -> Table:
    """One row for each goal and strategy, and one for what another seed changes."""
    entries = []
    for goal in summary["goals"]:
        for run in goal["runs"]:
            if not run["name"].startswith(f"{REFERENCE}_seed"):
                label = f"{goal['name']}, {strategy_label(run)}"
                worst = round(run[goal["measure"]], 1) + 0.0
                entries.append({"label": label, "worst": worst, "limit": goal["limit"]} | run)
        noise = {key: [value] for key, value in goal["another_seed"].items()}
        nothing = dict.fromkeys(("worst", "limit", "rms_urad", "peak_urad"))
        entries.append({"label": f"{goal['name']}, other seed", **nothing, **noise})
    angles = {"RMS": "rms_urad", "peak": "peak_urad"}
    angles |= {"change": "rms_change_urad", "by tick": "difference_rms_urad"}
    columns = (
        Column("", "label"),
        Column("worst", "worst", ".1f"),
        Column("limit", "limit", "g"),
        *(Column(heading, partial(_larger, key)) for heading, key in angles.items()),
    )
    return tabulate(
        "Extreme of the secondary measure; desired minus true pointing, larger angle, urad",
        columns,
        entries,
        "worst: hottest coil, C (reliability); least stroke left, um (stroke); clearance, um "
        "(obstacle); condition number (singularity). RMS, peak: of the pointing error. change: of "
        "that RMS, relative to unlimited. by tick: RMS of the change at each tick.",
    )


def _larger(key: str, entry: dict[str, Any]) -> str | None:
    if entry[key] is None:
        return None
    value = max(map(abs, entry[key]))
    return f"{value:.3f}" if value < 100 else f"{value:.0f}"


def _entry(one: Demonstration, goals: Goals) -> dict[str, Any]:
    outcomes = goals.outcomes[one.name]
    runs = [_run(one, it, outcomes[it.name], outcomes[REFERENCE]) for it in goals.strategies]
    kept = {
        field.name: getattr(one, field.name)
        for field in fields(one)
        if field.name not in ("run", "durations_s")
    }
    return kept | {
        "another_seed": _another_seed([run for run in runs if not run["limited"]]),
        "runs": runs,
        "recording": f"{one.name}.rrd",
        "data": f"{one.name}.npz",
    }


def _run(
    one: Demonstration, strategy: Strategy, outcome: Outcome, reference: Outcome
) -> dict[str, Any]:
    worst = one.worst(outcome)
    judged = outcome.time_s >= one.judged_from_s
    error_urad, expected_urad = (1e6 * run.error_rad[judged] for run in (outcome, reference))
    difference_urad = 1e6 * (outcome.error_rad - reference.error_rad)
    peak, expected_peak = (np.abs(error).max(axis=0) for error in (error_urad, expected_urad))
    angles = {
        "rms": rms(error_urad),
        "peak": peak,
        "rms_change": rms(error_urad) - rms(expected_urad),
        "peak_change": peak - expected_peak,
        "difference_rms": rms(difference_urad),
        "difference_peak": np.abs(difference_urad).max(axis=0),
    }
    return {
        **asdict(strategy),
        one.measure: worst,
        "kept": one.is_kept(worst),
        **{f"{what}_urad": both.tolist() for what, both in angles.items()},
        "closure_residual_max_m": outcome.closure_residual_max_m,
    }


def _another_seed(references: list[dict[str, Any]]) -> dict[str, float]:
    """Largest changes between noise seeds: between any two, and relative to the first."""
    found = {}
    for what in ("rms", "peak"):
        total = np.array([run[f"{what}_urad"] for run in references])
        found[f"{what}_change_urad"] = float(np.ptp(total, axis=0).max())
        key = f"difference_{what}_urad"
        found[key] = max(max(run[key]) for run in references)
    return found


def _arrays(goal: dict[str, Any], ours: dict[str, Outcome]) -> dict[str, Array]:
    """Arrays of all strategies, their names in front; of the other seeds the errors alone."""
    arrays = {"time_s": ours[REFERENCE].time_s}
    for name, outcome in ours.items():
        kept = {"error_rad": outcome.error_rad}
        if not name.startswith(f"{REFERENCE}_seed"):
            kept |= {goal["measure"]: outcome.measure} | outcome.arrays
        arrays |= {f"{name}_{key}": value for key, value in kept.items()}
    return arrays


def _record(
    goal: dict[str, Any], ours: dict[str, Outcome], summary: dict[str, Any], folder: Path
) -> None:
    """Write the recording: the goal pursued, and nothing done, side by side."""
    on_hexapod, name = goal["machine"] == "fjh", goal["name"]
    properties = {
        "seed": summary["seed"],
        "model_sha256": summary["model_sha256"][goal["machine"]],
        **{f"goal_{name}": value for name, value in goal["settings"].items()},
        **version_properties(summary),
        **(summary["bench"] if on_hexapod else {}),
    }
    about = About(
        study="goals",
        identity=f"goals-{name}-seed{summary['seed']}",
        title=goal["title"],
        said=_notes(goal),
        parameters=properties,
        checks=checks(summary),
        verdict=goal["title"],
    )
    shown = {key: ours[key] for key in ("pursued", "nothing")}
    write = _write_hexapod if on_hexapod else _write_arm
    write(folder / goal["recording"], about, goal, shown)


def _write_arm(path: Path, about: About, goal: dict[str, Any], shown: dict[str, Outcome]) -> None:
    model = load_model(ARM_MJCF)
    scenes = {
        key: condition_scene(model, one.time_s, one.arrays["joint_rad"], _plots(goal, one))
        for key, one in shown.items()
    }
    results = {"study": about.study, "robot": goal["machine"], "failures": "none"}
    results |= {"verdict": about.verdict, "checks": checked(about.checks)}
    lines = [f"# {about.title}", "", *about.said, "", *constants(about.parameters)]
    info = RecordingInfo(
        about.identity, about.title, "\n".join(lines), dict(about.parameters), results
    )
    write_scenes(path, info, scenes, pages=False)


def _write_hexapod(
    path: Path, about: About, goal: dict[str, Any], shown: dict[str, Outcome]
) -> None:
    rig, model = hexapod_rig(), load_model()
    stated = stated_of(rig)
    if goal["name"] == "obstacle":
        model = secondary_goals.cluttered()
        lock = Change(rig.actuators[secondary_goals.LOCKED_STRUT], "locked", 0.0)
        stated = replace(stated, incidents=[lock])
    # A run shows its pointing error anyway.
    runs = {
        key: RunView(
            stated,
            as_run_arrays({"time_s": one.time_s, **one.arrays}),
            model,
            extras=_plots(goal, one)[1:],
        )
        for key, one in shown.items()
    }
    write_views(path, about, runs)


def _plots(goal: dict[str, Any], outcome: Outcome) -> list[Plot]:
    angles = [f"{angle} [urad]" for angle in goal["angles"]]
    error, measure = "Pointing error, desired - true [urad]", _measure_words(goal)
    key, title, names, factor = _DETAILS[goal["name"]]
    return [
        Plot("error", error, angles, outcome.time_s, 1e6 * outcome.error_rad),
        Plot("measure", measure, [measure], outcome.time_s, outcome.measure[:, None]),
        Plot("details", title, names, outcome.time_s, factor * outcome.arrays[key]),
    ]


def _measure_words(goal: dict[str, Any]) -> str:
    return MEASURES[goal["measure"]].replace("$", "")


def _notes(goal: dict[str, Any]) -> list[str]:
    """Lines of the recording's notes: the goal, and a table of all strategies."""
    measure, (first, second) = _measure_words(goal), goal["angles"]
    columns = (
        Column("strategy", lambda run: run["name"].replace("_", " ")),
        Column(f"{measure}, worst", goal["measure"], ".4g"),
        Column(f"{first}, urad RMS", lambda run: run["rms_urad"][0], ".3f"),
        Column(f"{second}, urad RMS", lambda run: run["rms_urad"][1], ".3f"),
    )
    side = "below" if goal["keeps_below"] else "above"
    limit = f"{measure}: must stay {side} {goal['limit']:g}."
    rows = tabulate("", columns, goal["runs"]).markdown()
    return [limit, "", rows]
