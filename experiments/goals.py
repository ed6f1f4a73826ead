"""The study `goals`: four secondary goals that pointing must not notice; docs/priorities.md."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from argument_checks.ties import greatest
from experiments import goals_physics as physics
from experiments.goals_physics import Flown, Loops, Strategy
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
from fjh.study.workers import in_parallel
from sim import Array, load_model

REFERENCE = "unlimited"
"""The run that does nothing where there is nothing to avoid: what the error would be anyway."""
JUDGED_FROM_S = physics.SLEW_S + 0.5
"""The slew's own error has died away by then: twenty time constants of the slower loop."""
CHANGES = {
    "rms_change_urad": "change of the RMS of the pointing error",
    "peak_change_urad": "change of its peak",
    "difference_rms_urad": "RMS of the change of pointing, tick by tick",
    "difference_peak_urad": "largest change of pointing at one tick",
}
"""What another seed does to the two angles, and what a goal must stay below."""
DETAILS = "temperature_c", "singular_values"
"""Arrays that a recording shows beside the measure, of runs that have them."""


@dataclass(frozen=True)
class SecondaryGoal:
    """A secondary goal, and the run that needs it.

    Attributes:
        name: As in `goals.json`.
        title: For people.
        fly: Makes one run.
        measure: With its unit, as in the data file.
        says: The measure, for people.
        limit: Of the measure, which stays below it or above.
        keeps_below: Whether it stays below.
        duration_s: Of the whole study's run, and with --quick.
        angles: Names of the two pointing errors.
    """

    name: str
    title: str
    fly: Callable[[Strategy, float, Loops], Flown]
    measure: str
    says: str
    limit: float
    keeps_below: bool
    duration_s: tuple[float, float]
    angles: tuple[str, str] = ("alpha", "beta")

    @property
    def on_arm(self) -> bool:
        """Whether the machine is the serial arm, else the hexapod."""
        return self.name == "singularity"


GOALS = (
    SecondaryGoal(
        name="reliability",
        title="Reliability on the fly",
        fly=physics.fly_reliability,
        measure="hottest_coil_c",
        says="hottest coil, °C",
        limit=physics.LIMIT_C,
        keeps_below=True,
        duration_s=(16.0, 8.0),
    ),
    SecondaryGoal(
        name="stroke",
        title="Stroke limits of the struts",
        fly=physics.fly_stroke,
        measure="stroke_margin_um",
        says="least stroke left, µm",
        limit=10.0,  # current and stop end together
        keeps_below=False,
        duration_s=(10.0, 5.0),
    ),
    SecondaryGoal(
        name="obstacle",
        title="An obstacle beside the payload",
        fly=physics.fly_obstacle,
        measure="clearance_um",
        says="clearance, µm",
        limit=10.0,  # less is a collision, or as good as one
        keeps_below=False,
        duration_s=(10.0, 5.0),
    ),
    SecondaryGoal(
        name="singularity",
        title="A singularity of the serial arm",
        fly=physics.fly_singularity,
        measure="condition_number",
        says="condition number of $J_m$",
        limit=5.0,
        keeps_below=True,
        duration_s=(12.0, 8.0),
        angles=("along", "across"),
    ),
)

SETTINGS: dict[str, Any] = {
    "judged_from_s": JUDGED_FROM_S,
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
    """All runs of one goal: the three strategies, and what noise alone changes."""
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

    The goals are to keep coils cool, struts off their stops, the payload away from an obstacle,
    and an arm away from a singularity. Each is simulated with the mapping, without the goal, and
    with a weighted pseudo-inverse. With the mapping the pointing must change less than with another
    noise seed. 75 s on two cores, 30 s with --quick.

    Writes goals.json, its tables as goals.md and Parquet, a figure, and for each goal its data
    (.npz) and its recording (.rrd).

    Example: fjh paper goals --seed 2 --out /tmp/goals
    """
    loops, ways = nominal_loops(load_model(), physics.BENCH), strategies(seed, quick=quick)
    calls = [
        {"goal": goal, "strategy": way, "duration_s": goal.duration_s[quick], "loops": loops}
        for goal in GOALS
        for way in ways
    ]
    found = iter(in_parallel(_fly, calls, on_progress))
    flown = {goal.name: {way.name: next(found) for way in ways} for goal in GOALS}
    settings = origin(seed, arm=ARM_MJCF) | {
        "jacobian": "constant",
        "bench": asdict(physics.BENCH) | plant_constants(load_model()),
        **{f"{goal.name}_duration_s": goal.duration_s[quick] for goal in GOALS},
        **SETTINGS,
        "data": [f"{goal.name}.npz" for goal in GOALS],
        "recordings": [f"{goal.name}.rrd" for goal in GOALS],
    }
    pairs = [(goal, way, flown[goal.name]) for goal in GOALS for way in ways]
    angles = pd.concat(
        [angle_rows(goal, way, its[way.name], its[REFERENCE]) for goal, way, its in pairs],
        ignore_index=True,
    )
    tables = {
        "runs": pd.DataFrame([run_row(goal, way, its[way.name]) for goal, way, its in pairs]),
        "angles": angles,
        "another_seed": another_seed(angles),
    }
    return Result(
        settings=settings,
        tables=tables,
        checks=checks(**tables),
        views=shown(**tables),
        pictures=[Picture("goals", CAPTION, ALT, partial(figure, flown, **tables))],
        arrays={f"{goal.name}.npz": arrays(goal, flown[goal.name]) for goal in GOALS},
        records=[partial(record, goal, flown[goal.name], settings, **tables) for goal in GOALS],
    )


def _fly(goal: SecondaryGoal, strategy: Strategy, duration_s: float, loops: Loops) -> Flown:
    return goal.fly(strategy, duration_s, loops)


def run_row(goal: SecondaryGoal, strategy: Strategy, flown: Flown) -> dict[str, Any]:
    """What is measured of a run, but for its pointing."""
    worst = float(flown.measure.max() if goal.keeps_below else flown.measure.min())
    return {
        "goal": goal.name,
        **asdict(strategy),
        "measure": goal.measure,
        "worst": worst,
        "limit": goal.limit,
        "keeps_below": goal.keeps_below,
        "kept": worst < goal.limit if goal.keeps_below else worst > goal.limit,
        "closure_residual_max_m": flown.closure_residual_max_m,
    }


def angle_rows(
    goal: SecondaryGoal, strategy: Strategy, flown: Flown, reference: Flown
) -> pd.DataFrame:
    """Pointing errors of a run, and how they differ from those of the reference, by angle."""
    judged = flown.time_s >= (0.0 if goal.on_arm else JUDGED_FROM_S)
    error_urad, expected_urad = (1e6 * one.error_rad[judged] for one in (flown, reference))
    difference_urad = 1e6 * (flown.error_rad - reference.error_rad)
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
    """Largest changes by the noise seed alone: between any two, tick by tick from the first."""
    seeds = angles[angles.name.str.startswith(REFERENCE)]
    by_angle = seeds.groupby(["goal", "angle"], sort=False)[["rms_urad", "peak_urad"]]
    between = (by_angle.max() - by_angle.min()).groupby("goal", sort=False).max()
    ticks = seeds.groupby("goal", sort=False)[["difference_rms_urad", "difference_peak_urad"]].max()
    between.columns = ["rms_change_urad", "peak_change_urad"]
    return between.join(ticks).reset_index()


def larger(angles: pd.DataFrame) -> pd.DataFrame:
    """The larger size of both angles, by goal and run."""
    sizes = angles.set_index(["goal", "name"]).drop(columns="angle").abs()
    return sizes.groupby(["goal", "name"], sort=False).max()


def over_another_seed(angles: pd.DataFrame, another_seed: pd.DataFrame) -> pd.DataFrame:
    """Changes of each run over those that another seed makes, by goal and run."""
    return larger(angles)[list(CHANGES)].div(another_seed.set_index("goal"), level="goal")


def checks(runs: pd.DataFrame, angles: pd.DataFrame, another_seed: pd.DataFrame) -> list[Check]:
    """Limits kept with the goal and violated without; pointing changes below the noise."""
    flown = runs.set_index(["goal", "name"])
    beyond = (flown.worst - flown.limit).where(flown.keeps_below, flown.limit - flown.worst)
    pursued, nothing = (
        beyond.xs(name, level="name", drop_level=False) for name in ("pursued", "nothing")
    )
    changes = over_another_seed(angles, another_seed).xs("pursued", level="name", drop_level=False)
    kept = "distance of the secondary measure from its limit, which must be violated,"
    found = [
        *check("closure residual [m]", flown.closure_residual_max_m, CLOSURE_LIMIT_M),
        *check("secondary measure beyond its limit", pursued, 0.0),
        *check(kept, -nothing, 0.0),
    ]
    for key, what in CHANGES.items():
        found += check(f"{what}, over that by another seed,", changes[key], 1.0)
    return found


def shown(runs: pd.DataFrame, angles: pd.DataFrame, another_seed: pd.DataFrame) -> list[TableView]:
    """The printed table: a row for each run, and one for what another seed changes."""
    flown = runs[~runs.name.str.startswith(f"{REFERENCE}_seed")]
    flown = flown.join(larger(angles), on=["goal", "name"])
    rows = pd.concat([flown, another_seed.assign(name="other seed")])
    order = list(another_seed.goal)
    rows = rows.sort_values("goal", kind="stable", key=lambda names: names.map(order.index))
    return [
        TableView(
            "Extreme of the secondary measure, and pointing error of the larger angle",
            rows,
            "goal name worst:z.1f limit:g rms_urad:.3f difference_rms_urad:.3f",
            "worst: hottest coil, C (reliability); least stroke left, um (stroke); clearance, um "
            "(obstacle); condition number (singularity). difference_rms: RMS of the change from "
            "unlimited at each tick.",
        )
    ]


def arrays(goal: SecondaryGoal, flown: Mapping[str, Flown]) -> dict[str, Array]:
    """Arrays of all strategies, their names in front; of the other seeds the errors alone."""
    found = {"time_s": flown[REFERENCE].time_s}
    for name, one in flown.items():
        kept = {"error_rad": one.error_rad}
        if not name.startswith(f"{REFERENCE}_seed"):
            kept |= {goal.measure: one.measure} | one.arrays
        found |= {f"{name}_{key}": value for key, value in kept.items()}
    return found


def record(
    goal: SecondaryGoal,
    flown: Mapping[str, Flown],
    settings: Mapping[str, Any],
    folder: Path,
    **tables: pd.DataFrame,
) -> None:
    """Write the recording: the goal pursued, and nothing done, side by side."""
    bench = {} if goal.on_arm else settings["bench"]
    sha256 = settings["model_sha256"]["arm" if goal.on_arm else "fjh"]
    measure, side = goal.says.replace("$", ""), "below" if goal.keeps_below else "above"
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
    file, pair = folder / f"{goal.name}.rrd", {key: flown[key] for key in ("pursued", "nothing")}
    if goal.on_arm:
        model = load_model(ARM_MJCF)
        scenes = {
            key: condition_scene(model, one.time_s, one.arrays["joint_rad"], _plots(goal, one))
            for key, one in pair.items()
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
            as_run_arrays({"time_s": one.time_s, **one.arrays}),
            model,
            extras=_plots(goal, one)[1:],  # a run shows its pointing error anyway
        )
        for key, one in pair.items()
    }
    write_views(file, about, views)


def _plots(goal: SecondaryGoal, flown: Flown) -> list[Plot]:
    error, angles = "Pointing error, desired - true [urad]", [f"{a} [urad]" for a in goal.angles]
    columns = [("measure", goal.says.replace("$", ""), flown.measure[:, None])]
    columns += [(key, key, flown.arrays[key]) for key in DETAILS if key in flown.arrays]
    return [Plot("error", error, angles, flown.time_s, 1e6 * flown.error_rad)] + [
        Plot(key, title, [f"{key} {k + 1}" for k in range(values.shape[1])], flown.time_s, values)
        for key, title, values in columns
    ]


CAPTION = (
    "Four secondary goals, pursued through the mapping and not pursued. Below: RMS of the change "
    "of the pointing at each control tick, relative to a run with nothing to avoid, over the "
    "change that another noise seed makes. Coils that are not kept cool do not change the pointing."
)
ALT = (
    "Four panels: coil temperature, stroke left, clearance and condition number cross their limits "
    "when the goal is not pursued, and keep clear of them when it is. Below, marks of the pursued "
    "goals left of the line of another noise seed, those not pursued and those of pseudo-inverses "
    "with small weights far to the right."
)
WAYS: dict[str, dict[str, Any]] = {
    "nothing": {"color": VERMILION, "marker": "o", "label": "goal not pursued"},
    "pursued": {"color": BLUE, "marker": "o", "label": "goal pursued through the mapping"},
}


def figure(
    flown: Mapping[str, Mapping[str, Flown]],
    runs: pd.DataFrame,
    angles: pd.DataFrame,
    another_seed: pd.DataFrame,
) -> Figure:
    """The measure of each goal over time, and below how far the pointing changed."""
    figure = new_figure(PAGE_IN, 6.0)
    panels = figure.subplot_mosaic([[0, 1], [2, 3], [4, 4]], height_ratios=[1, 1, 1.1])
    for k, goal in enumerate(GOALS):
        _measure(panels[k], goal, flown[goal.name])
    changes = over_another_seed(angles, another_seed).difference_rms_urad.unstack("name")
    _changes(panels[4], changes.loc[[goal.name for goal in GOALS]], runs)
    one_legend(figure, 3)
    return figure


def _measure(axes: Axes, goal: SecondaryGoal, flown: Mapping[str, Flown]) -> None:
    worst, unit = {}, goal.says.partition(",")[2]
    for name, style in WAYS.items():
        measure = flown[name].measure
        place = greatest(measure if goal.keeps_below else -measure)
        axes.plot(flown[name].time_s, measure, markevery=[place], **style)
        worst[name] = round(float(measure[place]), 1) + 0.0
    axes.axhline(goal.limit, color=BLACK, ls="-.", label="limit")
    axes.set_title(
        f"{goal.title}:\n{worst['pursued']:g}{unit} when pursued, {worst['nothing']:g} when not"
    )
    axes.set(xlabel="time, s", ylabel=goal.says)
    if not unit:
        logarithmic(axes, "y")


def _changes(axes: Axes, changes: pd.DataFrame, runs: pd.DataFrame) -> None:
    """How far each way to treat a goal changes the pointing, over what another seed changes."""
    weights = runs[runs.major_weight > 0].drop_duplicates("name").set_index("name").major_weight
    rows, said = range(len(changes)), ", ".join(f"{weight:g}" for weight in weights)
    for row, compromised in enumerate(changes[weights.index].to_numpy()):
        label = f"pseudo-inverse, weight {said} (from right)"
        axes.plot(compromised, [row] * len(weights), "D--", color=PURPLE, label=label)
    for name, style in WAYS.items():
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
