"""Study `goals`: four secondary goals, which must not change the pointing; docs/priorities.md."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from argument_checks.ties import greatest
from experiments import goals_physics as physics
from experiments.goals_physics import GoalRun, Loops, Strategy
from fjh.recording.file import RecordingInfo
from fjh.recording.layout import write_scenes
from fjh.recording.properties import checked, constants
from fjh.recording.record import About, write_views
from fjh.recording.scene import condition_scene
from fjh.recording.signals import Plot
from fjh.recording.view import Change, RunView, as_run_arrays, stated_of
from fjh.rig.arm import ARM_MJCF
from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.hexapod.controller import nominal_loops
from fjh.rig.hexapod.metrics import plant_constants
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.run import rms
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, BLUE, PURPLE, VERMILION
from fjh.study.plotting import PAGE_IN, logarithmic, new_figure, one_legend
from fjh.study.provenance import version_properties
from fjh.study.result import Check, Picture, Result, TableView, check, origin
from fjh.study.workers import call, in_parallel
from sim import Array, load_model

REFERENCE = "unlimited"
"""Name of the reference run, without limit and without goal."""
EVALUATED_FROM_S = physics.SLEW_S + 0.5
"""Start of the evaluation [s], twenty time constants of the slower loop after the slew's end."""
CHANGES = {
    "rms_change_urad": "change of the RMS of the pointing error",
    "peak_change_urad": "change of its peak",
    "difference_rms_urad": "RMS of the change of pointing, tick by tick",
    "difference_peak_urad": "largest change of pointing at one tick",
}
"""Measures of the change of pointing by a goal; another noise seed must change it more."""
DETAILS = "temperature_c", "singular_values"
"""Names of further arrays that a recording shows, if the run has them."""


@dataclass(frozen=True)
class SecondaryGoal:
    """Secondary goal, with a run in which it is necessary.

    Attributes:
        name: Name in `goals.json`.
        title: Title in figures and recordings.
        simulate: Function that simulates one run.
        measure: Name of the measure with its unit, as in the data file.
        label: Label of the measure in figures.
        limit: Limit of the measure.
        keeps_below: Whether the measure must stay below the limit; otherwise above.
        duration_s: Durations of the run, in full and with --quick.
        angles: Names of the two pointing errors.
    """

    name: str
    title: str
    simulate: Callable[[Strategy, float, Loops], GoalRun]
    measure: str
    label: str
    limit: float
    keeps_below: bool
    duration_s: tuple[float, float]
    angles: tuple[str, str] = ("alpha", "beta")

    @property
    def on_arm(self) -> bool:
        """True if the machine is the serial arm; otherwise it is the hexapod."""
        return self.name == "singularity"


GOALS = (
    SecondaryGoal(
        name="reliability",
        title="Reliability on the fly",
        simulate=physics.simulate_reliability,
        measure="hottest_coil_c",
        label="hottest coil, °C",
        limit=physics.LIMIT_C,
        keeps_below=True,
        duration_s=(16.0, 8.0),
    ),
    SecondaryGoal(
        name="stroke",
        title="Stroke limits of the struts",
        simulate=physics.simulate_stroke,
        measure="stroke_margin_um",
        label="least stroke left, µm",
        limit=10.0,  # where the coil current is at its limit, too
        keeps_below=False,
        duration_s=(10.0, 5.0),
    ),
    SecondaryGoal(
        name="obstacle",
        title="An obstacle beside the payload",
        simulate=physics.simulate_obstacle,
        measure="clearance_um",
        label="clearance, µm",
        limit=10.0,  # below it a collision is imminent
        keeps_below=False,
        duration_s=(10.0, 5.0),
    ),
    SecondaryGoal(
        name="singularity",
        title="A singularity of the serial arm",
        simulate=physics.simulate_singularity,
        measure="condition_number",
        label="condition number of $J_m$",
        limit=5.0,
        keeps_below=True,
        duration_s=(12.0, 8.0),
        angles=("along", "across"),
    ),
)

SETTINGS: dict[str, Any] = {
    "judged_from_s": EVALUATED_FROM_S,
    "relax_s": physics.RELAX_S,
    "reliability_target_urad": physics.HOT_TARGET_URAD,
    **{f"coil_{name}": value for name, value in asdict(physics.COILS).items()},
    "coil_warm_c": physics.WARM_C,
    "coil_heaviest_weight": physics.HEAVIEST,
    "coil_reweigh_ticks": physics.REWEIGH_TICKS,
    "stroke_target_urad": physics.FAR_TARGET_URAD,
    "stroke_active_part": physics.ACTIVE,
    "stroke_longer": physics.LONGER,
    "obstacle_target_urad": physics.OBSTRUCTED_TARGET_URAD,
    "obstacle_gap_m": physics.GAP_M,
    "obstacle_radius_m": physics.RADIUS_M,
    "obstacle_safe_m": physics.SAFE_M,
    "obstacle_locked_strut": physics.LOCKED_STRUT,
    "arm_locked_joints": physics.SHOULDER,
    "arm_axis_deg": physics.AXIS_DEG,
    "arm_angle_rad": physics.ANGLE_RAD,
    "arm_gain_per_s": physics.GAIN_PER_S,
    "arm_fade_s": physics.FADE_S,
    "arm_period_s": physics.PERIOD_S,
    "arm_loop_gain_per_s": physics.LOOP_GAIN_PER_S,
    "arm_tracker_noise_rad": physics.TRACKER_NOISE_RAD,
}


def strategies(seed: int, *, quick: bool) -> list[Strategy]:
    """Return the runs of a goal: pursued, not pursued, pseudo-inverses, other noise seeds."""
    weights = (10.0,) if quick else (1.0, 10.0, 100.0)
    pursued = Strategy("pursued", pursues=True, major_weight=None, limited=True, seed=seed)
    unlimited = replace(pursued, name=REFERENCE, pursues=False, limited=False)
    return [
        pursued,
        replace(pursued, name="nothing", pursues=False),
        *(replace(pursued, name=f"pseudo_inverse_{w:g}", major_weight=w) for w in weights),
        unlimited,
        *(replace(unlimited, name=f"{REFERENCE}_seed_{k}", seed=seed + k) for k in (1, 2)),
    ]


def goals(
    *,
    seed: Annotated[int, seed_of("the detector noise")] = 0,
    quick: Annotated[bool, Option(help="Shorter runs, one weight of the pseudo-inverse.")] = False,
    on_progress: OnProgress,
) -> Result:
    """Pursue four secondary goals, and measure whether pointing changes.

    The goals are to keep coils cool, struts off their stops, the payload away from an obstacle, and
    an arm away from a singularity. Each is simulated with the mapping, without the goal, and with a
    weighted pseudo-inverse. With the mapping the pointing must change less than by another noise
    seed. Takes 75 s on two cores, 30 s with --quick.

    Writes goals.json, its tables as goals.md and Parquet, a figure, and for each goal its data
    (.npz) and its recording (.rrd).

    Example: fjh paper goals --seed 2 --out /tmp/goals
    """
    loops, compared = nominal_loops(load_model(), physics.BENCH), strategies(seed, quick=quick)
    shared = [{"work": goal.simulate, "duration_s": goal.duration_s[quick]} for goal in GOALS]
    calls = [its | {"strategy": how, "loops": loops} for its, how in product(shared, compared)]
    done = iter(in_parallel(call, calls, on_progress))
    runs = {goal.name: {strategy.name: next(done) for strategy in compared} for goal in GOALS}
    settings = origin(seed, arm=ARM_MJCF) | {
        "jacobian": "constant",
        "bench": asdict(physics.BENCH) | plant_constants(load_model()),
        **{f"{goal.name}_duration_s": goal.duration_s[quick] for goal in GOALS},
        **SETTINGS,
        "data": [f"{goal.name}.npz" for goal in GOALS],
        "recordings": [f"{goal.name}.rrd" for goal in GOALS],
    }
    pairs = [(goal, strategy, runs[goal.name]) for goal in GOALS for strategy in compared]
    by_run = [angle_rows(goal, how, its[how.name], its[REFERENCE]) for goal, how, its in pairs]
    angles = pd.concat(by_run, ignore_index=True)
    tables = {
        "runs": pd.DataFrame([run_row(goal, how, its[how.name]) for goal, how, its in pairs]),
        "angles": angles,
        "another_seed": another_seed(angles),
    }
    return Result(
        settings=settings,
        tables=tables,
        checks=checks(**tables),
        views=printed_tables(**tables),
        pictures=[Picture("goals", CAPTION, ALT, partial(figure, runs, **tables))],
        arrays={f"{goal.name}.npz": arrays(goal, runs[goal.name]) for goal in GOALS},
        records=[partial(record, goal, runs[goal.name], settings, **tables) for goal in GOALS],
    )


def run_row(goal: SecondaryGoal, strategy: Strategy, run: GoalRun) -> dict[str, Any]:
    """Return the row of a run: its strategy, and its measure against the limit."""
    worst = float(run.measure.max() if goal.keeps_below else run.measure.min())
    return {
        "goal": goal.name,
        **asdict(strategy),
        "measure": goal.measure,
        "worst": worst,
        "limit": goal.limit,
        "keeps_below": goal.keeps_below,
        "kept": worst < goal.limit if goal.keeps_below else worst > goal.limit,
        "closure_residual_max_m": run.closure_residual_max_m,
    }


def angle_rows(
    goal: SecondaryGoal, strategy: Strategy, run: GoalRun, reference: GoalRun
) -> pd.DataFrame:
    """Return the pointing errors of a run and their change from the reference, a row per angle."""
    evaluated = run.time_s >= (0.0 if goal.on_arm else EVALUATED_FROM_S)
    error_urad, expected_urad = (1e6 * one.error_rad[evaluated] for one in (run, reference))
    difference_urad = 1e6 * (run.error_rad - reference.error_rad)
    peak_urad, expected_peak_urad = (np.abs(e).max(axis=0) for e in (error_urad, expected_urad))
    columns = {
        "rms_urad": rms(error_urad),
        "peak_urad": peak_urad,
        "rms_change_urad": rms(error_urad) - rms(expected_urad),
        "peak_change_urad": peak_urad - expected_peak_urad,
        "difference_rms_urad": rms(difference_urad),
        "difference_peak_urad": np.abs(difference_urad).max(axis=0),
    }
    which = {"goal": goal.name, "name": strategy.name, "angle": list(goal.angles)}
    return pd.DataFrame(which | columns)


def another_seed(angles: pd.DataFrame) -> pd.DataFrame:
    """Return the largest changes that other noise seeds cause, by goal.

    RMS and peak are compared between all pairs of seeds, errors at ticks with the first seed.
    """
    seeds = angles[angles.name.str.startswith(REFERENCE)]
    by_angle = seeds.groupby(["goal", "angle"], sort=False)[["rms_urad", "peak_urad"]]
    between = (by_angle.max() - by_angle.min()).groupby("goal", sort=False).max()
    ticks = seeds.groupby("goal", sort=False)[["difference_rms_urad", "difference_peak_urad"]].max()
    between.columns = ["rms_change_urad", "peak_change_urad"]
    return between.join(ticks).reset_index()


def larger(angles: pd.DataFrame) -> pd.DataFrame:
    """Return the larger magnitude of the two angles, by goal and run."""
    sizes = angles.set_index(["goal", "name"]).drop(columns="angle").abs()
    return sizes.groupby(["goal", "name"], sort=False).max()


def over_another_seed(angles: pd.DataFrame, another_seed: pd.DataFrame) -> pd.DataFrame:
    """Return the changes of each run divided by those of another noise seed, by goal and run."""
    return larger(angles)[list(CHANGES)].div(another_seed.set_index("goal"), level="goal")


def checks(runs: pd.DataFrame, angles: pd.DataFrame, another_seed: pd.DataFrame) -> list[Check]:
    """Return checks that only the goal keeps the limit and pointing changes less than by noise."""
    by_run = runs.set_index(["goal", "name"])
    beyond = (by_run.worst - by_run.limit).where(by_run.keeps_below, by_run.limit - by_run.worst)
    pursued, nothing = (
        beyond.xs(name, level="name", drop_level=False) for name in ("pursued", "nothing")
    )
    changes = over_another_seed(angles, another_seed).xs("pursued", level="name", drop_level=False)
    violation = "distance of the secondary measure from its limit, which must be violated,"
    result = [
        *check("closure residual [m]", by_run.closure_residual_max_m, CLOSURE_LIMIT_M),
        *check("secondary measure beyond its limit", pursued, 0.0),
        *check(violation, -nothing, 0.0),
    ]
    for key, what in CHANGES.items():
        result += check(f"{what}, over that by another seed,", changes[key], 1.0)
    return result


def printed_tables(
    runs: pd.DataFrame, angles: pd.DataFrame, another_seed: pd.DataFrame
) -> list[TableView]:
    """Return the printed tables: a row for each goal; for each run, and another seed."""
    plotted = runs[~runs.name.str.startswith(f"{REFERENCE}_seed")]
    plotted = plotted.join(larger(angles), on=["goal", "name"])
    rows = pd.concat([plotted, another_seed.assign(name="other seed")])
    order = list(another_seed.goal)
    rows = rows.sort_values("goal", kind="stable", key=lambda names: names.map(order.index))
    worst = plotted.drop_duplicates(["goal", "name"]).pivot(index="goal", columns="name")
    pursued = worst.worst[["pursued", "nothing"]].assign(
        limit=worst.limit.pursued,
        change=worst.difference_rms_urad.pursued,
        seed=another_seed.set_index("goal").difference_rms_urad,
    )
    return [
        TableView(
            "Extreme of the secondary measure, and RMS change of the pointing (larger angle)",
            pursued.loc[order].reset_index(),
            "goal limit:g nothing=not_pursued:z.1f pursued:z.1f change=change_if_pursued_urad:.3f "
            "seed=change_by_another_seed_urad:.3f",
            "Measures: hottest coil [C] (reliability); least stroke left [um] (stroke); clearance "
            "[um] (obstacle); condition number (singularity).",
        ),
        TableView(
            "All runs: RMS pointing error, and RMS change from the run without limits",
            rows,
            "goal name worst=extreme:z.1f limit:g rms_urad:.3f difference_rms_urad=change_urad:.3f",
        ),
    ]


def arrays(goal: SecondaryGoal, runs: Mapping[str, GoalRun]) -> dict[str, Array]:
    """Return the arrays of all runs, prefixed by the runs' names; for other seeds only errors."""
    arrays_by_name = {"time_s": runs[REFERENCE].time_s}
    for name, run in runs.items():
        run_arrays = {"error_rad": run.error_rad}
        if not name.startswith(f"{REFERENCE}_seed"):
            run_arrays |= {goal.measure: run.measure} | run.arrays
        arrays_by_name |= {f"{name}_{key}": value for key, value in run_arrays.items()}
    return arrays_by_name


def record(
    goal: SecondaryGoal,
    goal_runs: Mapping[str, GoalRun],
    settings: Mapping[str, Any],
    folder: Path,
    **tables: pd.DataFrame,
) -> None:
    """Write the recording of two runs side by side: the goal pursued, and not pursued."""
    bench = {} if goal.on_arm else settings["bench"]
    sha256 = settings["model_sha256"]["arm" if goal.on_arm else "fjh"]
    measure, side = goal.label.replace("$", ""), "below" if goal.keeps_below else "above"
    about = About(
        study="goals",
        identity=f"goals-{goal.name}-seed{settings['seed']}",
        title=goal.title,
        notes=[f"{measure}: must stay {side} {goal.limit:g}."],
        parameters={"seed": settings["seed"], "model_sha256": sha256}
        | SETTINGS
        | version_properties(dict(settings))
        | bench,
        checks=checks(**tables),
        summary=goal.title,
    )
    file = folder / f"{goal.name}.rrd"
    pair = {key: goal_runs[key] for key in ("pursued", "nothing")}
    if goal.on_arm:
        model = load_model(ARM_MJCF)
        scenes = {
            key: condition_scene(model, run.time_s, run.arrays["joint_rad"], _plots(goal, run))
            for key, run in pair.items()
        }
        results = {"study": "goals", "robot": "arm", "failures": "none", "verdict": about.summary}
        results["checks"] = checked(about.checks)
        lines = [f"# {about.title}", "", *about.notes, "", *constants(about.parameters)]
        notes, parameters = "\n".join(lines), dict(about.parameters)
        info = RecordingInfo(about.identity, about.title, notes, parameters, results)
        write_scenes(file, info, scenes, pages=False)
        return
    rig, model = hexapod_rig(), load_model()
    stated = stated_of(rig)
    if goal.name == "obstacle":
        model = physics.cluttered()
        lock = Change(rig.actuators[physics.LOCKED_STRUT], "locked", 0.0)
        stated = replace(stated, incidents=[lock])
    views = {
        key: RunView(
            stated,
            as_run_arrays({"time_s": run.time_s, **run.arrays}),
            model,
            extras=_plots(goal, run)[1:],  # the view has the pointing error already
        )
        for key, run in pair.items()
    }
    write_views(file, about, views)


def _plots(goal: SecondaryGoal, run: GoalRun) -> list[Plot]:
    error, angles = "Pointing error, desired - true [urad]", [f"{a} [urad]" for a in goal.angles]
    columns = [("measure", goal.label.replace("$", ""), run.measure[:, None])]
    columns += [(key, key, run.arrays[key]) for key in DETAILS if key in run.arrays]
    return [Plot("error", error, angles, run.time_s, 1e6 * run.error_rad)] + [
        Plot(key, title, [f"{key} {k + 1}" for k in range(values.shape[1])], run.time_s, values)
        for key, title, values in columns
    ]


CAPTION = (
    "Four secondary goals, pursued through the mapping and not pursued. Below: RMS change of the "
    "pointing from a run with nothing to avoid, divided by the change that another noise seed "
    "causes. Hot coils do not change the pointing."
)
ALT = (
    "Four panels: coil temperature, stroke left, clearance and condition number cross their limits "
    "if the goal is not pursued, and stay within them if it is. Below, marks of pursued goals are "
    "left of the line of another noise seed; marks of goals not pursued, and of pseudo-inverses "
    "with small weights, are far to the right."
)
STYLES: dict[str, dict[str, Any]] = {
    "nothing": {"color": VERMILION, "marker": "o", "label": "goal not pursued"},
    "pursued": {"color": BLUE, "marker": "o", "label": "goal pursued through the mapping"},
}


def figure(
    goal_runs: Mapping[str, Mapping[str, GoalRun]],
    runs: pd.DataFrame,
    angles: pd.DataFrame,
    another_seed: pd.DataFrame,
) -> Figure:
    """Plot the measure of each goal over time, and below it the change of the pointing."""
    figure = new_figure(PAGE_IN, 6.0)
    panels = figure.subplot_mosaic([[0, 1], [2, 3], [4, 4]], height_ratios=[1, 1, 1.1])
    for k, goal in enumerate(GOALS):
        _measure(panels[k], goal, goal_runs[goal.name])
    changes = over_another_seed(angles, another_seed).difference_rms_urad.unstack("name")
    _changes(panels[4], changes.loc[[goal.name for goal in GOALS]], runs)
    one_legend(figure, 3)
    return figure


def _measure(axes: Axes, goal: SecondaryGoal, runs: Mapping[str, GoalRun]) -> None:
    worst, unit = {}, goal.label.partition(",")[2]
    for name, style in STYLES.items():
        measure = runs[name].measure
        place = greatest(measure if goal.keeps_below else -measure)
        axes.plot(runs[name].time_s, measure, markevery=[place], **style)
        worst[name] = round(float(measure[place]), 1) + 0.0
    axes.axhline(goal.limit, color=BLACK, ls="-.", label="limit")
    text = f"{worst['pursued']:g}{unit} when pursued, {worst['nothing']:g} when not"
    axes.set_title(f"{goal.title}:\n{text}")
    axes.set(xlabel="time, s", ylabel=goal.label)
    if not unit:
        logarithmic(axes, "y")


def _changes(axes: Axes, changes: pd.DataFrame, runs: pd.DataFrame) -> None:
    weights = runs[runs.major_weight > 0].drop_duplicates("name").set_index("name").major_weight
    rows, text = range(len(changes)), ", ".join(f"{weight:g}" for weight in weights)
    for row, compromised in enumerate(changes[weights.index].to_numpy()):
        label = f"pseudo-inverse, weight {text} (from right)"
        axes.plot(compromised, [row] * len(weights), "D--", color=PURPLE, label=label)
    for name, style in STYLES.items():
        for row, change in zip(rows, changes[name], strict=True):
            if change > 0:
                axes.plot(change, row, **style)
    axes.axvline(1, color=BLACK, ls=":", label="another noise seed")
    axes.set_title(
        f"A pursued goal changes the pointing at most {changes.pursued.max():.2f} times as much as "
        "another noise seed does"
    )
    logarithmic(axes, "x")
    axes.set_yticks(rows, [goal.title for goal in GOALS])
    axes.set(xlabel="change of the pointing, larger angle, over that by another noise seed")
    axes.set_ylim(len(changes) - 0.5, -0.5)
