"""The study `track`: any robot on a path, failures in flight, and what they cost; docs/track.md."""

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
from fjh.rig import options as its
from fjh.rig import reach
from fjh.rig.advice import advice
from fjh.rig.dither import dither_entry, not_isolable, rig_dither
from fjh.rig.events import EVENTS, Event
from fjh.rig.events.hooks import events_of
from fjh.rig.mjcf import rig_of
from fjh.rig.other_controller import controller_factory, controller_label, fly_with
from fjh.rig.prediction import Prediction
from fjh.rig.rig import Rig
from fjh.rig.run import Run, called, diagnosis_entries, entry_of
from fjh.rig.units import ROWS, by_unit, norms_said, prefixed, said
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
from sim.plant import Met, dry_friction

NONE: list[Any] = []
"""Nothing happens."""


class TrackedRuns(NamedTuple):
    """One path with the same failures, events and noise, flown by several controllers."""

    rig: Rig
    run: Run  # with diagnosis, unless it is off
    undiagnosed: Run | None  # None where nothing happens, it is off, or the physics diverged
    other: Run | None  # with the controller of a user
    met: Sequence[str]  # effects outside the linear model, in `run`
    predicted: Prediction  # of a controller that is told of failures at once, or never
    comparable: Prediction  # of one that is told when `run` diagnosed them


def track(
    *,
    model: its.Model = None,
    seed: Annotated[int, seed_of("the sensors' noise, and what is drawn of events")] = 0,
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
            help="Something else that happens: an event of docs/track.md, its actuator where it is "
            "of one, and time in seconds. May be repeated.",
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
    turn: its.Turn = 4.0,
    duration: Annotated[float, Option(metavar="S", help="Of the run, in seconds.")] = 8.0,
    robot: its.RobotOptions = its.DEFAULT_OPTIONS,
    diagnosis: Annotated[
        its.Switch,
        Option(
            help="on: failures are diagnosed, and the mapping is reconfigured; off: it goes on."
        ),
    ] = "on",
    dither: its.Dither = "default",
    controller: its.Controller = None,
    on_progress: OnProgress,
) -> Result:
    """Track a path with any robot while its actuators fail.

    The robot is an MJCF file as downloaded; without one it is the hexapod, whose frame, loops and
    sensors are those of the testbed: it takes none of the options for these. The major rows are
    controlled in a closed loop through the mapping, at the joint positions of a keyframe or qpos0.
    An actuator that fails is diagnosed from the measurements, and the mapping is reconfigured. The
    errors are compared with the linear model of the plant, and where something fails or happens
    with the same run without diagnosis. A minute for most robots.

    Writes track.json, the tables as track.md, every tick as track.npz, the figure track.png, and
    the recording track.rrd with the mechanism in 3D, its path, actuators and failures.

    Example: fjh track panda.xml --site hand --major x,y,z --fail actuator4:locked@4 --out panda
    """
    told, scale = diagnosis == "on", 0.5 if quick else 1.0
    failed: list[Failure] = parsed("--fail", Failure, fail)
    other_events: list[Event] = parsed("--event", Event, event)
    its.check_bounds("turn", turn)
    its.check_bounds("duration", duration)
    if controller is not None:
        controller_factory(controller)  # a wrong name is refused before anything runs
    is_asked = dither not in ("none", "default")
    if is_asked and not told:
        raise WrongInput(f"--dither {dither} is for the diagnosis, which is off")
    for flag, given in (("--fail", failed), ("--event", other_events)):
        if late := [each.time_s for each in given if not each.time_s < duration]:
            end = f"before the run ends at {duration:g} s"
            raise WrongInput(f"{flag} must be {end}, got {late[0]:g} s")
    rig = rig_of(model, robot)
    desired = rig.path(path, duration_s=scale * duration, turn_s=turn)
    announced, events, failures = scheduled(rig, failed, other_events, scale, seed)
    reach.check_reach(rig, desired)
    for warning in rig.warnings:
        notice(warning)
    design = rig_dither(rig, dither if told else "none")
    if is_asked and design is None:
        raise WrongInput(f"--dither {dither}: the major task leaves no motion for a dither")
    advised = partial(advice, rig, model, robot, dither)
    for each in not_isolable(rig, design, desired, failures) if told else ():
        notice(f"{called(rig, each)} may not be found: {advised(each)}")

    compares = told and bool(failures or events)
    runs, met = 1 + compares + (controller is not None), Met(rig.model, rig.part)

    def on_tick(before: int, done: int) -> None:
        if done % 100 == 0 or done == len(desired):
            on_progress(before * len(desired) + done, runs * len(desired))

    how: dict[str, Any] = {"failures": announced, "seed": seed}
    moving = design and design.dither
    own: Any = rig.supervisor(moving) if told else rig.controller()
    run = rig.fly(own, desired, events=[*events, met], on_tick=partial(on_tick, 0), **how)
    undiagnosed = other = None
    how["events"] = events
    if compares:
        with suppress(SimulationDiverged):
            undiagnosed = rig.fly(rig.controller(), desired, on_tick=partial(on_tick, 1), **how)
    if controller is not None:
        other, _ = fly_with(rig, controller, desired, on_tick=partial(on_tick, runs - 1), **how)

    learnt, predict = reach.learnt_s(rig, run, failures), reach.predictor(rig, run, moving)
    predicted = predict(told=told)
    comparable = predict(told=learnt) if failures and not events else predicted
    flown = TrackedRuns(rig, run, undiagnosed, other, list(met.sentences), predicted, comparable)
    faults = [Fault.of(failure) for failure in run.failures]
    reports = [rig.classified(faults[:count]) for count in range(1, len(faults) + 1)]
    settings = {"seed": seed, "diagnosis": diagnosis, "controller": controller}
    settings |= settings_of(flown) | {"dither": dither_entry(design, rig)}
    rows, named = rows_of(flown), diagnosis_entries(rig, run)
    found = agreement(flown, rows) | {
        "closure_residual_max_m": run.closure_max_m,
        "possible_after": [is_possible(report) for report in reports],
        "diagnoses": named,
        "status": run.status,
        "advice": [
            f"{called(rig, failure)} was not diagnosed: {advised(failure)}"
            for failure, learnt_at_s in zip(failures, learnt, strict=True)
            if told and learnt_at_s is None
        ],
        "task_lost": run.task_lost,
        "lost": run.lost,
        "limited_by": None if events or run.lost else reach.limited_by(rig, run, predicted),
        "controller_failure": other and other.state.failure,
    }
    log = happened(flown, reports, named)
    found["verdict"] = verdict(settings | found, *log)
    everything = settings | found
    arrays = run.arrays | {f"other_{k}": v for k, v in (other.arrays if other else {}).items()}
    return Result(
        settings=settings,
        found=found,
        tables={"rows": rows},
        checks=checks(everything),
        shown=shown(rows, pd.concat(log).sort_values("time_s", kind="stable"), everything),
        notes=[found["verdict"], *found["advice"], *filter(None, [found["limited_by"]])],
        pictures=[Picture("track", found["verdict"], ALT, partial(figure, flown, everything))],
        arrays={"track.npz": arrays},
        records=[partial(record, flown, everything)],
    )


def parsed(flag: str, kind: Any, given: Sequence[Any]) -> list[Any]:
    """Failures or events, of their text where they are not made yet.

    Raises:
        WrongInput: A text is none.
    """
    try:
        return [kind.parse(each) if isinstance(each, str) else each for each in given]
    except ValueError as error:
        raise WrongInput(f"{flag} {str(error).removeprefix('text ')}") from None


def scheduled(
    rig: Rig, fail: Sequence[Failure], event: Sequence[Event], scale: float, seed: int
) -> tuple[list[Failure], list[Event], list[Failure]]:
    """Failures and events at so much of their times, in order; and all failures, also of events.

    Raises:
        WrongInput: An actuator that the robot does not have, that fails twice, or that cannot have
            an event.
    """
    # A name of digits is looked up before it is taken for a number.
    announced = [
        replace(each, actuator=rig.number(str(each.actuator)), time_s=scale * each.time_s)
        for each in fail
    ]
    in_order = sorted(event, key=lambda one: one.time_s)
    events = [replace(each, time_s=scale * each.time_s) for each in in_order]
    every = [*announced, *events_of(rig, events, seed=seed)[1]]
    if len({failure.actuator for failure in every}) < len(every):
        raise WrongInput(f"--fail{' and --event' * bool(events)} must name each actuator once")
    return announced, events, sorted(every, key=lambda one: one.time_s)


def settings_of(flown: TrackedRuns) -> dict[str, Any]:
    """The robot, its loops and sensors, and what happened to it."""
    rig, run = flown.rig, flown.run
    as_they_are = "model_sha256 actuators bodies major feedforward encoder_noise warnings left_out"
    return {
        "versions": versions(),
        "robot": rig.title,
        **{key: getattr(rig, key) for key in as_they_are.split()},
        "units": rig.row_units,
        "duration_s": run.time_s[-1] + rig.period_s,
        "control_period_s": rig.period_s,
        "failures": [entry_of(rig, each) for each in run.failures],
        "events": [entry_of(rig, each) for each in run.events],
        "dry_friction": dry_friction(rig.model),
        "path_size": rig.size,
        "sensor_noise": rig.noise,
        **by_unit("path_size", rig.size, rig.row_units),
        **by_unit("sensor_noise", rig.noise, rig.row_units),
        **by_unit("encoder_noise", rig.encoder_noise, rig.units),
    }


def rows_of(flown: TrackedRuns) -> pd.DataFrame:
    """A row for each major row: RMS errors in its unit, and the margins of its loop.

    Before and after the first failure or event; missing where nothing was flown or predicted.
    """
    rig, run, cut = flown.rig, flown.run, reach.first_tick(flown.run)

    def of(flight: Run | None, ticks: slice) -> Any:
        return np.nan if flight is None or not len(run.time_s[ticks]) else flight.rms(ticks)

    before, after = slice(cut), slice(cut, None)
    told, at_once = flown.comparable.rms_after, flown.predicted.rms_after
    if run.events or not run.failures:
        told = at_once = np.nan
    columns = {
        "rms_before": of(run, before),
        "predicted_rms_before": flown.predicted.rms_before,
        "rms_after": of(run, after),
        "predicted_rms_after_when_named": told,
        "predicted_rms_after": at_once,
        "rms_after_without_diagnosis": of(flown.undiagnosed, after),
        "controller_rms_before": of(flown.other, before),
        "controller_rms_after": of(flown.other, after),
    }
    for key in ("crossover_hz", "gain_margin_db", "phase_margin_deg"):
        columns[key] = [getattr(margin, key) for margin in rig.margins]
    names = {"row": rig.major, "name": [ROWS[row] for row in rig.major], "unit": rig.row_units}
    return pd.DataFrame(names | columns).replace([np.inf, -np.inf], np.nan)


def agreement(flown: TrackedRuns, rows: pd.DataFrame) -> dict[str, Any]:
    """Errors by row, and those of all rows over the linear model's, where both are compared."""
    rig, run, found = flown.rig, flown.run, dict[str, Any]()
    for key, column in rows.filter(regex="^(predicted_)?rms_").items():
        values = None if column.isna().any() else column.tolist()
        found |= {str(key): values} | by_unit(str(key), values, rig.row_units)
    size = rows.filter(like="rms_").apply(np.linalg.norm)  # of all rows together
    other, beyond = reach.uncompared(rig, run, flown.predicted), None
    after = np.nan if other else size.rms_after / size.predicted_rms_after_when_named
    ratio = pd.Series({"before": size.rms_before / size.predicted_rms_before, "after": after})
    off = (ratio - 1.0).abs()
    if (off >= reach.AGREES).any():
        beyond = reach.beyond_linear_range(rig, run, ratio[off >= reach.AGREES].max())
    for when in ratio.index:
        found[f"measured_over_predicted_{when}"] = ratio[when]
        found[f"prediction_off_{when}"] = off[when] if beyond is None else None
    return found | {"uncompared": other, "met": [*flown.met, *filter(None, [beyond])]}


def happened(
    flown: TrackedRuns, reports: Sequence[Any], found: Sequence[Any]
) -> list[pd.DataFrame]:
    """Failures and events, one that is both once; and diagnoses; each in the order of time."""
    stated, left, named = stated_of(flown.rig, flown.run), dict[str, str](), list[Any]()
    for failure, report in zip(flown.run.failures, reports, strict=True):
        can = "possible" if is_possible(report) else "not possible"
        left[called(flown.rig, failure)] = f"major task {can}: {deciding_sentence(report)}"
    struck = [(each.time_s, stated.text(each), each.kind) for each in stated.incidents]
    struck = [(at, what, left.get(what) or EVENTS[kind].sentence) for at, what, kind in struck]
    for one in found:
        delay_s, back_s = one["delay_s"], one["withdrawn_s"]
        after = "by mistake" if delay_s is None else f"after {delay_s:.3f} s"
        back = "" if back_s is None else f", cleared at {back_s:.3f} s"
        named.append((one["time_s"], f"{one['actuator']} diagnosed {one['kind']}", after + back))
    return [pd.DataFrame(log, columns=["time_s", "what", "meaning"]) for log in (struck, named)]


def verdict(found: Mapping[str, Any], struck: pd.DataFrame, named: pd.DataFrame) -> str:
    """One sentence: what happened, what it cost, what is left, and what was diagnosed."""
    robot, units = found["robot"], found["units"]
    before, after, predicted = (
        norms_said(found[key], units) if found[key] else "unknown"
        for key in ("rms_before", "rms_after", "predicted_rms_before")
    )
    if struck.empty:
        return f"{robot}: without a failure the RMS error is {before}, predicted {predicted}."
    what = ", ".join(f"{one.what} at {one.time_s:g} s" for one in struck.itertuples())
    earlier = f", {before} before" if found["rms_before"] else ""
    first = f"{robot}: after {what} the RMS error is {after}{earlier}"
    if (lost := found["lost"]) is not None:
        return f"{first}; {lost[0].lower()}{lost[1:]}"
    can = "cannot" if found["possible_after"][-1:] == [False] else "can"
    said = ", ".join(f"{one.what} {one.meaning}" for one in named.itertuples())
    left = f"the remaining actuators {can} do the major task"
    return f"{first}; {left}; {said or 'nothing was diagnosed'}."


def checks(found: Mapping[str, Any]) -> list[Check]:
    """Loops stay closed, errors are as predicted, another controller does no wrong."""
    robot, name, failure = (found[key] for key in ("robot", "controller", "controller_failure"))
    gap_m = found["closure_residual_max_m"]
    off = {f"{k} the first failure": found[f"prediction_off_{k}"] for k in ("before", "after")}
    what = "relative error of the predicted RMS"
    checked = check("closure residual [m]", gap_m, CLOSURE_TOLERANCE, robot)
    checked += check(what, pd.Series(off).dropna(), reach.AGREES, robot)
    if name is not None:
        what = f"failures of the controller ({failure or 'none'})"
        checked += check(what, float(failure is not None), 0.5, name)
    return checked


ERRORS = {
    "rms_before": "before",
    "predicted_rms_before": "linear",
    "rms_after": "after",
    "predicted_rms_after_when_named": "linear_after",
    "predicted_rms_after": "at_once",
    "rms_after_without_diagnosis": "undiagnosed",
    "controller_rms_before": "controller_before",
    "controller_rms_after": "controller_after",
}


def shown(rows: pd.DataFrame, log: pd.DataFrame, found: Mapping[str, Any]) -> list[TableView]:
    """The errors by major row with their units; and what happened and was diagnosed."""
    cells = {
        name: [said(value, unit) for value, unit in zip(rows[key], rows.unit, strict=True)]
        for key, name in ERRORS.items()
        if rows[key].notna().all() and (name != "at_once" or found["diagnosis"] == "on")
    }
    legend = (
        "RMS of desired minus true, before and after the first failure or event. linear: by the "
        "linear model with the noise of the sensors, told of failures as diagnosed, or at_once."
    )
    legend += f" Not compared: {found['uncompared']}." if found["uncompared"] else ""
    if outside := [*found["warnings"], *found["met"]]:
        legend += f" Not in the linear model: {'; '.join(outside)}."
    errors = pd.DataFrame({"row": rows["name"]} | cells)
    tables = [TableView(found["robot"], errors, " ".join(errors), legend)]
    return tables + [TableView("What happened", log, "time_s:.3f what meaning")] * (len(log) > 0)


ALT = "Desired and true path, error over time, displacement of each actuator, failed ones red."
MARKS = {
    "failures": ("failure", VERMILION, "-"),
    "events": ("event", VERMILION, ":"),
    "diagnoses": ("diagnosis", GREEN, "--"),
}


def figure(flown: TrackedRuns, found: Mapping[str, Any]) -> Figure:
    """Path, errors of each unit, actuators."""
    run, units = flown.run, list(dict.fromkeys(found["units"]))
    heights = [1.5] * len(units) + [0.4 + 0.2 * len(flown.rig.actuators)]
    drawn = new_figure(PAGE_IN, max(3.4, 0.9 + sum(heights)))
    drawn.suptitle(fill(found["verdict"], 110))
    grid = drawn.add_gridspec(len(heights), 2, width_ratios=[0.8, 1], height_ratios=heights)
    path_panel(drawn.add_subplot(grid[:, 0]), flown, found)
    over_time = [drawn.add_subplot(grid[k, 1]) for k in range(len(heights))]
    for axes, unit in zip(over_time, units, strict=False):
        error_panel(axes, flown, np.array(found["units"]) == unit, unit)
    broken = {one["actuator"] for one in (*found["failures"], *found["events"])}
    actuator_panel(over_time[-1], flown, broken)
    for axes in over_time:
        for key, (label, color, style) in MARKS.items():
            for one in found[key]:
                axes.axvline(one["time_s"], color=color, ls=style, lw=0.8, label=label)
        axes.set(xlim=(run.time_s[0], run.time_s[-1]))
    over_time[-1].set_xlabel("time, s")
    one_legend(drawn, 4)
    return drawn


def path_panel(axes: Axes, flown: TrackedRuns, found: Mapping[str, Any]) -> None:
    """The first two major rows, or the only one over time."""
    run, names = flown.run, [ROWS[row] for row in flown.rig.major]
    factor, prefix = prefixed(float(np.abs(run.desired).max()))
    labels = [f"{n}, {prefix}{u}" for n, u in zip(names, found["units"], strict=True)]
    is_plane = len(names) > 1

    def drawn(signal: Array) -> tuple[Array, Array]:
        first = factor * signal[:, 0]
        return (first, factor * signal[:, 1]) if is_plane else (run.time_s, first)

    x, y = drawn(run.true)
    axes.plot(x, y, color=BLUE, label="true")
    if flown.other is not None:
        label = controller_label(found["controller"])
        axes.plot(*drawn(flown.other.true), color=PURPLE, lw=0.6, label=label)
    axes.plot(*drawn(run.desired), color=BLACK, ls="--", lw=0.6, label="desired")
    for key, (_, color, _) in MARKS.items():
        ticks = np.searchsorted(run.time_s[:-1], [one["time_s"] for one in found[key]])
        axes.plot(x[ticks], y[ticks], "o", color=color)
    axes.set(title="Path", xlabel=labels[0] if is_plane else "time, s")
    axes.set_ylabel(labels[int(is_plane)])
    if is_plane and found["units"][0] == found["units"][1]:
        axes.set_aspect("equal", adjustable="datalim")


def error_panel(axes: Axes, flown: TrackedRuns, rows: Array, unit: str) -> None:
    """Size of desired minus true, of the major rows of one unit together."""
    flights = [(flown.run, BLUE)]
    if flown.other is not None:
        flights.insert(0, (flown.other, PURPLE))
    sizes = [np.linalg.norm(run.error[:, rows], axis=1) for run, _ in flights]
    factor, prefix = prefixed(float(np.max(sizes)))
    for size, (run, color) in zip(sizes, flights, strict=True):
        axes.plot(run.time_s, factor * size, color=color, lw=0.8)
    names = ", ".join(ROWS[row] for row in np.array(flown.rig.major)[rows])
    axes.set(title=f"Error of {names}", ylabel=f"error, {prefix}{unit}")
    axes.tick_params(labelbottom=False)


def actuator_panel(axes: Axes, flown: TrackedRuns, broken: set[str | None]) -> None:
    """A row for each, from its place at the start; all of one unit on the same scale."""
    run, names, units = flown.run, flown.rig.actuators, np.array(flown.rig.units)
    spans = {u: 2 * np.abs(run.displacement[:, units == u]).max() for u in dict.fromkeys(units)}
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        color, width = (VERMILION, 1.4) if name in broken else ("0.4", 0.8)
        row = k - run.displacement[:, k] / (spans[unit] or 1.0)
        axes.plot(run.time_s, row, color=color, lw=width)
    high = " or ".join(said(span, unit) for unit, span in spans.items())
    axes.set_yticks(range(len(names)), names)
    axes.set(title=f"Displacement of each actuator:\na row is {high} high")
    axes.invert_yaxis()


def record(flown: TrackedRuns, found: Mapping[str, Any], folder: Path) -> None:
    """Write `track.rrd`: the run, and beside it that of another controller."""
    rig, sizes = flown.rig, ("seed", "control_period_s", "path_size", "sensor_noise")
    about = About(
        study="track",
        identity=f"track-{rig.title}-seed{found['seed']}",
        notes=[f"- {found['verdict']}"],
        parameters={key: found[key] for key in sizes} | version_properties(dict(found)),
        predicted=(found["predicted_rms_before"], found["predicted_rms_after_when_named"]),
        checks=checks(found),
        summary=found["verdict"],
    )
    runs = {rig.title: view_of(rig, flown.run)}
    if flown.other is not None:
        runs[controller_label(found["controller"])] = view_of(rig, flown.other)
    write_views(folder / "track.rrd", about, runs)
