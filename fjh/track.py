"""Study `track`: errors of any robot on a path before and after failures; docs/track.md."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fjh.recording.record import About, write_views
from fjh.recording.view import stated_of, view_of
from fjh.rig import options as rig_options
from fjh.rig import reach
from fjh.rig.advice import advice
from fjh.rig.dither import dither_entry, not_isolable, rig_dither
from fjh.rig.events import EVENTS, Event
from fjh.rig.events.hooks import events_of
from fjh.rig.mjcf import rig_of
from fjh.rig.other_controller import controller_factory, controller_label, simulate_with
from fjh.rig.prediction import Prediction
from fjh.rig.rig import Rig
from fjh.rig.run import Run, diagnosis_entries, entry_of, failure_text
from fjh.rig.units import ROWS, by_unit, norms_text, prefixed, quantity_text
from fjh.study.errors import WrongInput
from fjh.study.interrupts import notice
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, BLUE, GREEN, PURPLE, VERMILION
from fjh.study.plotting import PAGE_IN, new_figure, one_legend
from fjh.study.provenance import version_properties, versions
from fjh.study.result import Check, Picture, Result, TableView, check
from ftc import deciding_sentence, is_possible
from ftc.fdi import Fault
from sim import CLOSURE_TOLERANCE, Array, Failure, SimulationDiverged
from sim.plant import NonlinearityMonitor, dry_friction

NONE: list[Any] = []
"""Default of the options for failures and events."""


class TrackedRuns(NamedTuple):
    """Runs on one path with the same failures, events and noise, by several controllers."""

    rig: Rig
    run: Run  # with diagnosis, unless it is off
    undiagnosed: Run | None  # None without failures or diagnosis, or if the physics diverged
    other: Run | None  # with the controller of a user
    unmodeled: Sequence[str]  # effects outside the linear model, in `run`
    predicted: Prediction  # for a controller informed of failures at onset, or never
    comparable: Prediction  # for a controller informed when `run` diagnosed them


def track(
    *,
    model: rig_options.Model = None,
    seed: Annotated[int, seed_of("the sensors' noise, and of random parameters of events")] = 0,
    quick: Annotated[
        bool,
        Option(
            help="The first half of the run only; failures and events come at half of their times."
        ),
    ] = False,
    fail: Annotated[
        list[str | Failure],
        Option(
            metavar="NAME:KIND@S",
            help="A failure: actuator (or its joint), kind (locked, free, weak, loose) and time in "
            "seconds. May be repeated.",
        ),
    ] = NONE,
    event: Annotated[
        list[str | Event],
        Option(
            metavar="NAME[:ACTUATOR]@S",
            help="Another event of docs/track.md: name, its actuator if it has one, and time in "
            "seconds. May be repeated.",
        ),
    ] = NONE,
    path: Annotated[
        str,
        Option(
            metavar="PATH",
            help="spiral, circle, steps, or FILE.npz with time_s (N,) and desired (N, rows): major "
            "displacements from the start, [rad] or [m].",
        ),
    ] = "circle",
    turn: rig_options.Turn = 4.0,
    duration: Annotated[float, Option(metavar="S", help="Duration of the run in seconds.")] = 8.0,
    robot: rig_options.RobotOptions = rig_options.DEFAULT_OPTIONS,
    diagnosis: Annotated[
        rig_options.Switch,
        Option(help="on: failures are diagnosed, and the mapping is reconfigured; off: neither."),
    ] = "on",
    dither: rig_options.Dither = "default",
    controller: rig_options.Controller = None,
    on_progress: OnProgress,
) -> Result:
    """Track a path with any robot while its actuators fail.

    The robot is an MJCF file as downloaded; without one it is the hexapod, whose frame, loops and
    sensors are those of the testbed: the options for these do not apply to it. The major rows are
    controlled in a closed loop through the mapping, at the joint positions of a keyframe or qpos0.
    An actuator that fails is diagnosed from the measurements, and the mapping is reconfigured. The
    errors are compared with the linear model of the plant, and after failures or events with the
    same run without diagnosis. A minute for most robots.

    Writes track.json, the tables as track.md, every tick as track.npz, the figure track.png, and
    the recording track.rrd with the mechanism in 3D, its path, actuators and failures.

    Example: fjh track panda.xml --site hand --major x,y,z --fail actuator4:locked@4 --out panda
    """
    diagnoses, scale = diagnosis == "on", 0.5 if quick else 1.0
    failed: list[Failure] = parsed("--fail", Failure, fail)
    other_events: list[Event] = parsed("--event", Event, event)
    rig_options.check_bounds("turn", turn)
    rig_options.check_bounds("duration", duration)
    if controller is not None:
        controller_factory(controller)  # raises for a wrong name before the first run
    is_requested = dither not in ("none", "default")
    if is_requested and not diagnoses:
        raise WrongInput(f"--dither {dither} needs --diagnosis on: it serves the diagnosis alone")
    for flag, incidents in (("--fail", failed), ("--event", other_events)):
        if late := [one.time_s for one in incidents if not one.time_s < duration]:
            end = f"before the run ends at {duration:g} s"
            raise WrongInput(f"{flag} must be {end}, got {late[0]:g} s")
    rig = rig_of(model, robot)
    desired = rig.path(path, duration_s=scale * duration, turn_s=turn)
    announced, events, failures = scheduled(rig, failed, other_events, scale, seed)
    reach.check_reachable(rig, desired)
    for warning in rig.warnings:
        notice(warning)
    design = rig_dither(rig, dither if diagnoses else "none")
    if is_requested and design is None:
        raise WrongInput(f"--dither {dither}: the major rows leave no motion for it; choose fewer")
    advised = partial(advice, rig, model, robot, dither)
    for failure in not_isolable(rig, design, desired, failures) if diagnoses else ():
        notice(f"{failure_text(rig, failure)} may not be identified: {advised(failure)}")

    compares = diagnoses and bool(failures or events)
    count = 1 + compares + (controller is not None)
    monitor = NonlinearityMonitor(rig.model, rig.part)

    def on_tick(former: int, done: int) -> None:
        if done % 100 == 0 or done == len(desired):
            on_progress(former * len(desired) + done, count * len(desired))

    case: dict[str, Any] = {"failures": announced, "seed": seed}
    moving = design and design.dither
    first: Any = rig.supervisor(moving) if diagnoses else rig.controller()
    run = rig.fly(first, desired, events=[*events, monitor], on_tick=partial(on_tick, 0), **case)
    undiagnosed = other = None
    case["events"] = events
    if compares:
        with suppress(SimulationDiverged):
            undiagnosed = rig.fly(rig.controller(), desired, on_tick=partial(on_tick, 1), **case)
    if controller is not None:
        case["on_tick"] = partial(on_tick, count - 1)
        other, _ = simulate_with(rig, controller, desired, **case)

    known_s, predict = reach.diagnosed_at_s(rig, run, failures), reach.predictor(rig, run, moving)
    predicted = predict(told=diagnoses)
    comparable = predict(told=known_s) if failures and not events else predicted
    runs = TrackedRuns(rig, run, undiagnosed, other, [*monitor.sentences], predicted, comparable)
    faults = [Fault.of(failure) for failure in run.failures]
    reports = [rig.classified(faults[:count]) for count in range(1, len(faults) + 1)]
    settings = {"seed": seed, "diagnosis": diagnosis, "controller": controller}
    settings |= settings_of(runs) | {"dither": dither_entry(design, rig)}
    rows, entries = rows_of(runs), diagnosis_entries(rig, run)
    results = compare_prediction(runs, rows) | {
        "closure_residual_max_m": run.closure_max_m,
        "possible_after": [is_possible(report) for report in reports],
        "diagnoses": entries,
        "status": run.status,
        "advice": [
            f"{failure_text(rig, failure)} was not diagnosed: {advised(failure)}"
            for failure, time_s in zip(failures, known_s, strict=True)
            if diagnoses and time_s is None
        ],
        "task_lost": run.task_lost,
        "lost": run.lost,
        "limited_by": None if events or run.lost else reach.limited_by(rig, run, predicted),
        "controller_failure": other and other.state.failure,
    }
    log = event_log(runs, reports, entries)
    results["verdict"] = summary(settings | results, *log)
    everything = settings | results
    arrays = run.arrays | {f"other_{k}": v for k, v in (other.arrays if other else {}).items()}
    in_order = pd.concat(log).sort_values("time_s", kind="stable")
    return Result(
        settings=settings,
        overall=results,
        tables={"rows": rows},
        checks=checks(everything),
        views=table_views(rows, in_order, everything),
        notes=[results["verdict"], *results["advice"], *filter(None, [results["limited_by"]])],
        pictures=[Picture("track", results["verdict"], ALT, partial(figure, runs, everything))],
        arrays={"track.npz": arrays},
        records=[partial(record, runs, everything)],
    )


def parsed(flag: str, kind: Any, incidents: Sequence[Any]) -> list[Any]:
    """Return failures or events, after parsing those that are text.

    Raises:
        WrongInput: A text cannot be parsed.
    """
    try:
        return [kind.parse(one) if isinstance(one, str) else one for one in incidents]
    except ValueError as error:
        raise WrongInput(f"{flag} {str(error).removeprefix('text ')}") from None


def scheduled(
    rig: Rig, fail: Sequence[Failure], event: Sequence[Event], scale: float, seed: int
) -> tuple[list[Failure], list[Event], list[Failure]]:
    """Return failures and events with scaled times, and all failures including those by events.

    Raises:
        WrongInput: An actuator does not exist, fails twice, or cannot have an event.
    """
    # Digits are looked up as a name before they are read as a number.
    announced = [
        replace(one, actuator=rig.number(str(one.actuator)), time_s=scale * one.time_s)
        for one in fail
    ]
    in_order = sorted(event, key=lambda one: one.time_s)
    events = [replace(one, time_s=scale * one.time_s) for one in in_order]
    every = [*announced, *events_of(rig, events, seed=seed)[1]]
    if len({failure.actuator for failure in every}) < len(every):
        raise WrongInput(
            f"--fail{' and --event' * bool(events)} must name each actuator at most once"
        )
    return announced, events, sorted(every, key=lambda one: one.time_s)


def settings_of(runs: TrackedRuns) -> dict[str, Any]:
    """Return the settings of the robot, its loops and sensors, and its failures and events."""
    rig, run = runs.rig, runs.run
    unchanged = "model_sha256 actuators bodies major feedforward encoder_noise warnings left_out"
    return {
        "versions": versions(),
        "robot": rig.title,
        **{key: getattr(rig, key) for key in unchanged.split()},
        "units": rig.row_units,
        "duration_s": run.time_s[-1] + rig.period_s,
        "control_period_s": rig.period_s,
        "failures": [entry_of(rig, failure) for failure in run.failures],
        "events": [entry_of(rig, event) for event in run.events],
        "dry_friction": dry_friction(rig.model),
        "path_size": rig.size,
        "sensor_noise": rig.noise,
        **by_unit("path_size", rig.size, rig.row_units),
        **by_unit("sensor_noise", rig.noise, rig.row_units),
        **by_unit("encoder_noise", rig.encoder_noise, rig.units),
    }


def rows_of(runs: TrackedRuns) -> pd.DataFrame:
    """Return a data frame of the major rows: RMS errors in the row's unit, margins of its loop.

    Errors are before and after the first failure or event; NaN if not simulated or predicted.
    """
    rig, run, cut = runs.rig, runs.run, reach.first_tick(runs.run)

    def rms(one: Run | None, ticks: slice) -> Any:
        return np.nan if one is None or not len(run.time_s[ticks]) else one.rms(ticks)

    before, after = slice(cut), slice(cut, None)
    as_diagnosed, at_once = runs.comparable.rms_after, runs.predicted.rms_after
    if run.events or not run.failures:
        as_diagnosed = at_once = np.nan
    columns = {
        "rms_before": rms(run, before),
        "predicted_rms_before": runs.predicted.rms_before,
        "rms_after": rms(run, after),
        "predicted_rms_after_when_named": as_diagnosed,
        "predicted_rms_after": at_once,
        "rms_after_without_diagnosis": rms(runs.undiagnosed, after),
        "controller_rms_before": rms(runs.other, before),
        "controller_rms_after": rms(runs.other, after),
    }
    for key in ("crossover_hz", "gain_margin_db", "phase_margin_deg"):
        columns[key] = [getattr(margin, key) for margin in rig.margins]
    names = {"row": rig.major, "name": [ROWS[row] for row in rig.major], "unit": rig.row_units}
    return pd.DataFrame(names | columns).replace([np.inf, -np.inf], np.nan)


def compare_prediction(runs: TrackedRuns, rows: pd.DataFrame) -> dict[str, Any]:
    """Return the errors of each row, and the ratio of simulated to predicted errors of all rows."""
    rig, run, results = runs.rig, runs.run, dict[str, Any]()
    for key, column in rows.filter(regex="^(predicted_)?rms_").items():
        values = None if column.isna().any() else column.tolist()
        results |= {str(key): values} | by_unit(str(key), values, rig.row_units)
    size = rows.filter(like="rms_").apply(np.linalg.norm)  # norm over all rows
    reason, beyond = reach.uncompared(rig, run, runs.predicted), None
    after = np.nan if reason else size.rms_after / size.predicted_rms_after_when_named
    ratio = pd.Series({"before": size.rms_before / size.predicted_rms_before, "after": after})
    off = (ratio - 1.0).abs()
    if (off >= reach.AGREES).any():
        beyond = reach.beyond_linear_range(rig, run, ratio[off >= reach.AGREES].max())
    for when in ratio.index:
        results[f"measured_over_predicted_{when}"] = ratio[when]
        results[f"prediction_off_{when}"] = off[when] if beyond is None else None
    return results | {"uncompared": reason, "met": [*runs.unmodeled, *filter(None, [beyond])]}


def event_log(
    runs: TrackedRuns, reports: Sequence[Any], entries: Sequence[Any]
) -> list[pd.DataFrame]:
    """Return a table of failures and events, and one of diagnoses, each in order of time."""
    stated, meaning, diagnoses = stated_of(runs.rig, runs.run), dict[str, str](), list[Any]()
    for failure, report in zip(runs.run.failures, reports, strict=True):
        can = "possible" if is_possible(report) else "not possible"
        meaning[failure_text(runs.rig, failure)] = f"major task {can}: {deciding_sentence(report)}"
    texts = [(one.time_s, stated.text(one), one.kind) for one in stated.incidents]
    incidents = [(at, what, meaning.get(what) or EVENTS[kind].sentence) for at, what, kind in texts]
    for entry in entries:
        delay_s, back_s = entry["delay_s"], entry["withdrawn_s"]
        after = "by mistake" if delay_s is None else f"after {delay_s:.3f} s"
        back = "" if back_s is None else f", cleared at {back_s:.3f} s"
        what = f"{entry['actuator']} diagnosed {entry['kind']}"
        diagnoses.append((entry["time_s"], what, after + back))
    columns = ["time_s", "what", "meaning"]
    return [pd.DataFrame(log, columns=columns) for log in (incidents, diagnoses)]


def summary(results: Mapping[str, Any], incidents: pd.DataFrame, diagnoses: pd.DataFrame) -> str:
    """Return a sentence on failures and events, errors, remaining capability and diagnoses."""
    robot, units = results["robot"], results["units"]
    before, after, predicted = (
        norms_text(results[key], units) if results[key] else "unknown"
        for key in ("rms_before", "rms_after", "predicted_rms_before")
    )
    if incidents.empty:
        return f"{robot}: without a failure the RMS error is {before}, predicted {predicted}."
    what = ", ".join(f"{one.what} at {one.time_s:g} s" for one in incidents.itertuples())
    earlier = f", {before} before" if results["rms_before"] else ""
    first = f"{robot}: after {what} the RMS error is {after}{earlier}"
    if (lost := results["lost"]) is not None:
        return f"{first}; {lost[0].lower()}{lost[1:]}"
    can = "cannot" if results["possible_after"][-1:] == [False] else "can"
    diagnosed = ", ".join(f"{one.what} {one.meaning}" for one in diagnoses.itertuples())
    remaining = f"the remaining actuators {can} do the major task"
    return f"{first}; {remaining}; {diagnosed or 'no failure was diagnosed'}."


def checks(results: Mapping[str, Any]) -> list[Check]:
    """Return checks of loop closure, of predicted errors, and of errors of another controller."""
    robot, name, failure = (results[key] for key in ("robot", "controller", "controller_failure"))
    gap_m = results["closure_residual_max_m"]
    off = {f"{k} the first failure": results[f"prediction_off_{k}"] for k in ("before", "after")}
    what = "relative error of the predicted RMS"
    checked = check("closure residual [m]", gap_m, CLOSURE_TOLERANCE, robot)
    checked += check(what, pd.Series(off).dropna(), reach.AGREES, robot)
    if name is not None:
        what = f"failures of the controller ({failure or 'none'})"
        checked += check(what, float(failure is not None), 0.5, name)
    return checked


ERROR_COLUMNS = {
    "rms_before": "before",
    "rms_after": "after",
    "rms_after_without_diagnosis": "after,_no_diagnosis",
    "controller_rms_before": "controller_before",
    "controller_rms_after": "controller_after",
    "predicted_rms_before": "predicted_before",
    "predicted_rms_after_when_named": "predicted_after",
    "predicted_rms_after": "predicted_if_known",
}
"""Columns of the printed table by those of the data frame."""


def table_views(
    rows: pd.DataFrame, log: pd.DataFrame, results: Mapping[str, Any]
) -> list[TableView]:
    """Return the printed tables: errors by major row with units, and incidents and diagnoses."""
    cells = {
        name: [quantity_text(value, unit) for value, unit in zip(rows[key], rows.unit, strict=True)]
        for key, name in ERROR_COLUMNS.items()
        if rows[key].notna().all()
        and (name != "predicted_if_known" or results["diagnosis"] == "on")
    }
    legend = (
        "RMS of desired minus true, before and after the first failure or event. Predicted: by the "
        "linear model with sensor noise; if known: for a controller informed of failures at once."
    )
    legend += f" Not compared: {results['uncompared']}." if results["uncompared"] else ""
    if outside := [*results["warnings"], *results["met"]]:
        legend += f" Not in the linear model: {'; '.join(outside)}."
    errors = pd.DataFrame({"row": rows["name"]} | cells)
    views = [TableView(f"{results['robot']}: RMS error", errors, " ".join(errors), legend)]
    title = "Failures, events and diagnoses"
    return views + [TableView(title, log, "time_s:.3f what meaning")] * (len(log) > 0)


ALT = "Desired and true path, error over time, displacement of each actuator, failed ones red."
MARKS = {
    "failures": ("failure", VERMILION, "-"),
    "events": ("event", VERMILION, ":"),
    "diagnoses": ("diagnosis", GREEN, "--"),
}


def figure(runs: TrackedRuns, results: Mapping[str, Any]) -> Figure:
    """Plot the path, the errors by unit, and the actuators' displacements."""
    run, units = runs.run, list(dict.fromkeys(results["units"]))
    heights = [1.5] * len(units) + [0.4 + 0.2 * len(runs.rig.actuators)]
    plot = new_figure(PAGE_IN, max(3.4, 0.9 + sum(heights)))
    plot.suptitle(fill(results["verdict"], 110))
    grid = plot.add_gridspec(len(heights), 2, width_ratios=[0.8, 1], height_ratios=heights)
    path_panel(plot.add_subplot(grid[:, 0]), runs, results)
    panels = [plot.add_subplot(grid[k, 1]) for k in range(len(heights))]
    for axes, unit in zip(panels, units, strict=False):
        error_panel(axes, runs, np.array(results["units"]) == unit, unit)
    affected = {one["actuator"] for one in (*results["failures"], *results["events"])}
    actuator_panel(panels[-1], runs, affected)
    for axes in panels:
        for key, (label, color, style) in MARKS.items():
            for one in results[key]:
                axes.axvline(one["time_s"], color=color, ls=style, lw=0.8, label=label)
        axes.set(xlim=(run.time_s[0], run.time_s[-1]))
    panels[-1].set_xlabel("time, s")
    one_legend(plot, 4)
    return plot


def path_panel(axes: Axes, runs: TrackedRuns, results: Mapping[str, Any]) -> None:
    """Plot the first two major rows in a plane, or a single row over time."""
    run, names = runs.run, [ROWS[row] for row in runs.rig.major]
    factor, prefix = prefixed(float(np.abs(run.desired).max()))
    labels = [f"{n}, {prefix}{u}" for n, u in zip(names, results["units"], strict=True)]
    is_plane = len(names) > 1

    def plane_curve(signal: Array) -> tuple[Array, Array]:
        first = factor * signal[:, 0]
        return (first, factor * signal[:, 1]) if is_plane else (run.time_s, first)

    x, y = plane_curve(run.true)
    axes.plot(x, y, color=BLUE, label="true")
    if runs.other is not None:
        label = controller_label(results["controller"])
        axes.plot(*plane_curve(runs.other.true), color=PURPLE, lw=0.6, label=label)
    axes.plot(*plane_curve(run.desired), color=BLACK, ls="--", lw=0.6, label="desired")
    for key, (_, color, _) in MARKS.items():
        ticks = np.searchsorted(run.time_s[:-1], [one["time_s"] for one in results[key]])
        axes.plot(x[ticks], y[ticks], "o", color=color)
    axes.set(title="Path", xlabel=labels[0] if is_plane else "time, s")
    axes.set_ylabel(labels[int(is_plane)])
    if is_plane and results["units"][0] == results["units"][1]:
        axes.set_aspect("equal", adjustable="datalim")


def error_panel(axes: Axes, runs: TrackedRuns, rows: Array, unit: str) -> None:
    """Plot the norm of desired minus true over the major rows of one unit."""
    colored = [(runs.run, BLUE)]
    if runs.other is not None:
        colored.insert(0, (runs.other, PURPLE))
    sizes = [np.linalg.norm(run.error[:, rows], axis=1) for run, _ in colored]
    factor, prefix = prefixed(float(np.max(sizes)))
    for size, (run, color) in zip(sizes, colored, strict=True):
        axes.plot(run.time_s, factor * size, color=color, lw=0.8)
    names = ", ".join(ROWS[row] for row in np.array(runs.rig.major)[rows])
    axes.set(title=f"Error of {names}", ylabel=f"error, {prefix}{unit}")
    axes.tick_params(labelbottom=False)


def actuator_panel(axes: Axes, runs: TrackedRuns, affected: set[str | None]) -> None:
    """Plot each actuator's displacement in its own row, with one scale for each unit."""
    run, names, units = runs.run, runs.rig.actuators, np.array(runs.rig.units)
    spans = {u: 2 * np.abs(run.displacement[:, units == u]).max() for u in dict.fromkeys(units)}
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        color, width = (VERMILION, 1.4) if name in affected else ("0.4", 0.8)
        row = k - run.displacement[:, k] / (spans[unit] or 1.0)
        axes.plot(run.time_s, row, color=color, lw=width)
    high = " or ".join(quantity_text(span, unit) for unit, span in spans.items())
    axes.set_yticks(range(len(names)), names)
    axes.set(title=f"Displacement of each actuator:\na row is {high} high")
    axes.invert_yaxis()


def record(runs: TrackedRuns, results: Mapping[str, Any], folder: Path) -> None:
    """Write `track.rrd` with the run and, if there is one, that of another controller."""
    rig, keys = runs.rig, ("seed", "control_period_s", "path_size", "sensor_noise")
    about = About(
        study="track",
        identity=f"track-{rig.title}-seed{results['seed']}",
        notes=[f"- {results['verdict']}"],
        parameters={key: results[key] for key in keys} | version_properties(dict(results)),
        predicted=(results["predicted_rms_before"], results["predicted_rms_after_when_named"]),
        checks=checks(results),
        summary=results["verdict"],
    )
    views = {rig.title: view_of(rig, runs.run)}
    if runs.other is not None:
        views[controller_label(results["controller"])] = view_of(rig, runs.other)
    write_views(folder / "track.rrd", about, views)
