"""The studies `sweep` and `atlas`: many loops beside the linear model; docs/priorities.md."""

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cache, lru_cache, partial
from math import inf, prod
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from argument_checks.ties import ascending, greatest, ranks
from experiments.study import HERE, Row, Where, basis_of, rows_of
from experiments.sweep_design import CHOICES, MOST_RUNS, Design, SweepRun, read_design, runs_of
from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.classification import POSSIBLE, names_of
from fjh.rig.conditions import every_condition
from fjh.rig.hexapod import fault_tolerance
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, secondary
from fjh.rig.hexapod.controller import StrutMapping, designed, nominal_plant
from fjh.rig.hexapod.machine import detector_noise_rad
from fjh.rig.hexapod.rig import hexapod_rig, pursuing
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.prediction import MARGINAL, open_loop, pole_radius
from fjh.rig.rig import Rig
from fjh.rig.run import Run, rms
from fjh.study.errors import WrongInput
from fjh.study.input_checks import check_file
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION
from fjh.study.plotting import COLUMN_IN, PAGE_IN, logarithmic, new_figure, one_legend
from fjh.study.result import Check, Picture, Result, TableView, check, origin
from ftc.fdi import Fault
from prioritized import failure_atlas
from sim import NOMINAL, Array, ModelError, SimulationDiverged, load_model

ANGLES = ("alpha", "beta")
RMS, PREDICTED = ([f"{of}{each}_rms_urad" for each in ANGLES] for of in ("", "predicted_"))
INPUT_PEAK = [f"strut_input_peak_percent_{k}" for k in range(1, 7)]
MEASURED = (
    *(f"{angle}_{what}_urad" for what in ("rms", "peak", "measured_rms") for angle in ANGLES),
    *(f"strut_input_rms_percent_{k}" for k in range(1, 7)),
    *INPUT_PEAK,
    *("gamma_peak_urad", "t_x_peak_um", "t_y_peak_um", "t_z_peak_um"),
    "closure_residual_max_m",
)
COLUMNS = ("status", "message", "diverged_at_s", "dac_step_urad", "predicted_pole_radius")

TOLERANCE = 0.01
"""Largest relative distance of an RMS from the linear model's under the same noise, beside one step
of the converters. Of 40 runs of varied weights, failures, loops, noise and converters the furthest
used 44 % of both."""
MOST_POINTS = 2000  # of a figure: more cannot be told apart

MIRROR = (1, 0, 5, 4, 3, 2)
"""The strut in whose place each strut comes, by a symmetry of the machine."""
VERDICTS = {
    "rigid": ("pointing exact", BLUE),
    "springs": ("exact with springs only", SKY),
    "drifts": ("payload drifts", PURPLE),
    "one_direction": ("one direction left", VERMILION),
    "none": ("none left", BLACK),
}
"""What is left of pointing in the atlas, in words and colours."""


# A run and its row.


@cache
def machine() -> tuple[mujoco.MjModel, Array, tuple[Any, Array]]:
    """The hexapod, where free struts go (12, 12), and the plant of its loops: once a process."""
    model = load_model()
    return model, fault_tolerance.strut_and_payload_stiffness(model), nominal_plant(model)


def row_of(run: SweepRun) -> Row:
    """The row of a run, which is simulated here.

    Returns:
        Its parameters, its `status`, and what was measured, as far as there is any. A run to the
        end has the status of its mapping, "exact" where it meets the pointing task, or "unstable",
        if the linear model's loop is. Others are "diverged": the physics left the finite numbers;
        or "refused": the loops cannot be closed on this bench, or physics not stepped at its rate.
    """
    model, stiffness, _ = machine()
    row = run.parameters() | dict.fromkeys((*COLUMNS, *PREDICTED, *MEASURED))
    try:
        # As it is after the failures, at J_0.
        mapping = StrutMapping(hexapod(model), run.reconfigured, "constant", stiffness)
        predicted = _predicted(run)
        status = mapping.at(mapping.nominal).mapping.status
        row |= predicted | {"status": status.name.lower()}
        row["dac_step_urad"] = _dac_step_urad(run, mapping)
        if predicted and PREDICTED[0] not in predicted:
            row["status"] = "unstable"
        return row | measured(simulated(run))
    except SimulationDiverged as diverged:
        found = {"status": "diverged", "message": str(diverged), "diverged_at_s": diverged.time_s}
        return row | found
    except ModelError as refused:
        return row | {"status": "refused", "message": str(refused)}


def simulated(run: SweepRun) -> Run:
    """The run; raises as the simulation does."""
    rig, path = _rig(run), run.bench.spiral_rad(run.duration_s)
    controller = rig.controller()
    if run.known and run.failure_time_s > 0 and run.failures:
        controller = rig.reconfigured(run.goal, run.reconfigured, run.failure_time_s)
    return rig.fly(controller, path, failures=run.failures, seed=run.seed)


def _rig(run: SweepRun) -> Rig:
    """The hexapod with what the mapping knows from the start as goal."""
    goal = run.reconfigured if run.failure_time_s == 0 else run.goal
    return pursuing(_rig_of(run.bench), goal, jacobian=run.jacobian)


@lru_cache(maxsize=8)
def _rig_of(bench: TestbedConfig) -> Rig:
    """The hexapod with these constants, linearized and settled once for all its runs."""
    model, stiffness, plant = machine()
    return hexapod_rig(Testbed(model, bench, designed(*plant, bench), stiffness))


def _predicted(run: SweepRun) -> Row:
    """Largest pole of the linear, sampled loop, and the RMS errors if the loop is stable.

    Empty where the plant is not the linear model's: it changes during the run, or a strut falls on
    its stop, as one without its spring does.
    """
    if any(failure.time_s > 0 or failure.kind == "loose" for failure in run.failures):
        return {}
    rig, faults = _rig(run), [Fault.of(failure) for failure in run.failures]
    row: Row = {"predicted_pole_radius": pole_radius(open_loop(rig, rig.goal, faults))}
    if row["predicted_pole_radius"] > MARGINAL:
        return row
    path = run.bench.spiral_rad(run.duration_s)
    noise = detector_noise_rad(run.bench, run.seed, len(path))
    found = rig.predict(path, failures=run.failures, told=False, noise=noise)
    return row | dict(zip(PREDICTED, (1e6 * rms(found.error)).tolist(), strict=True))


def _dac_step_urad(run: SweepRun, mapping: StrutMapping) -> float:
    """Pointing moved by one step of one strut's converter: the loops cannot command less."""
    amplifier = run.bench.amplifier(newton_per_m=float(machine()[0].actuator_gainprm[0, 0]))
    step_m = amplifier.displacements(np.eye(6) * 100 / 2 ** (run.bench.dac_bits - 1))
    steps_rad = [mapping.major_motion(strut_m, NOMINAL) for strut_m in step_m]
    return 1e6 * float(np.linalg.norm(steps_rad, axis=1).max())


def measured(run: Run) -> Row:
    """What the row has of a run to the end."""
    values = (
        1e6 * run.rms(),
        1e6 * np.abs(run.error).max(0),
        1e6 * rms(run.desired - run.measured),
        rms(run.inputs),
        np.abs(run.inputs).max(0),
        1e6 * np.abs(secondary(run)).max(0),
        [run.closure_max_m],
    )
    return dict(zip(MEASURED, np.concatenate(values).tolist(), strict=True))


def again(summary: dict[str, Any]) -> tuple[list[SweepRun], Callable[[SweepRun], tuple[Row, Run]]]:
    """The runs that a `sweep.json` or an `atlas.json` is of, and what flies one once more.

    Raises:
        WrongInput: They are more than a design may have.
    """
    design = Design(**summary["basis"]["design"])
    if design.runs > MOST_RUNS:
        raise WrongInput(f"a design has at most {MOST_RUNS} runs, got {design.runs}")
    return runs_of(design, summary["basis"]["seed"]), fly


def fly(run: SweepRun) -> tuple[Row, Run]:
    """What is measured of the run, and the run."""
    whole = simulated(run)
    return measured(whole), whole


# Rows beside the linear model.


def beside_model(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, and how far they are off the linear model.

    Columns: `off_percent`, of the predicted RMS, the larger of both angles; `off_over_allowed`, one
    and more being too much; `compared`, whether a run can be: predicted, completed, not saturated.
    """
    predicted = rows[PREDICTED].to_numpy(float)
    off = np.abs(rows[RMS].to_numpy(float) - predicted)
    allowed = TOLERANCE * predicted + rows[["dac_step_urad"]].to_numpy(float)
    return rows.assign(
        off_percent=100 * (off / predicted).max(axis=1),
        off_over_allowed=(off / allowed).max(axis=1),
        compared=rows[PREDICTED[0]].notna() & (rows[INPUT_PEAK].max(axis=1) < 99.9),
    )


def prediction(beside: pd.DataFrame) -> pd.DataFrame:
    """All runs that the linear model covers, in one row."""
    found = beside[beside.compared]
    row = {
        "compared": len(found),
        "off": (found.off_over_allowed >= 1).sum(),
        "median_percent": found.off_percent.median(),
        "largest_percent": found.off_percent.max(),
    }
    return pd.DataFrame([row])


def groups(rows: pd.DataFrame) -> pd.DataFrame:
    """Errors by the number of struts that fail during a run, and whether the mapping is told."""
    failures = rows.struts.str.count("[^S]").where(rows.failure_time_s < rows.duration_s, 0)
    measures = {
        f"{angle}_{word}_urad": (f"{angle}_rms_urad", partial(pd.Series.quantile, q=q))
        for angle in ANGLES
        for word, q in (("median", 0.5), ("percentile_95", 0.95))
    }
    told = rows.known | (failures == 0)
    grouped = rows.assign(failures=failures, told=told).groupby(["failures", "told"])
    return grouped.agg(runs=("case", "size"), **measures).reset_index()


def influence(rows: pd.DataFrame, varied: list[str]) -> pd.DataFrame:
    """Spearman's rank correlation of each quantity with the RMS errors, the strongest first.

    There is none with errors that are all alike, as where no limit is reached.
    """
    ended = rows[rows[RMS[0]].notna()]
    errors = ended[RMS].set_axis([*ANGLES], axis=1).apply(ranks)
    values = ended[varied].dropna(axis=1)
    values = values.loc[:, (values.nunique() > 1) & (len(ended) > 2) & (errors.nunique() > 1).all()]
    found = {angle: values.corrwith(errors[angle], method="spearman") for angle in ANGLES}
    found = pd.DataFrame(found).rename_axis("name").reset_index()
    return found.iloc[ascending(-found[[*ANGLES]].abs().max(axis=1))]


def checks(beside: pd.DataFrame) -> list[Check]:
    """RMS errors against the linear model, and closure residuals, of the runs that it covers."""
    found = beside[beside.compared]
    if found.empty:
        return []
    worst, what = found.iloc[greatest(found.off_over_allowed)], "difference between the RMS error"
    what += f" and the linear model's, divided by {100 * TOLERANCE:g} % plus one converter step,"
    gap_m = found.closure_residual_max_m.max(skipna=False)
    return [
        *check(what, worst.off_over_allowed, 1.0, f"run {worst.case}"),
        *check("closure residual [m]", gap_m, CLOSURE_LIMIT_M, "all runs"),
    ]


# The sweep.


def flown(
    name: str, design: Design, seed: int, where: Where, folder: Path, on_progress: OnProgress
) -> tuple[dict[str, Any], pd.DataFrame]:
    """Settings of the study of this name, and the rows of the design."""
    basis, how = basis_of(design=asdict(design), seed=seed), {"name": name, "folder": folder}
    rows = rows_of(runs_of(design, seed), row_of, basis, where, on_progress=on_progress, **how)
    own = {"basis": basis, "runs": len(rows), "duration_s": design.duration_s}
    return origin(seed) | own, rows.astype({"message": "string"})


def sweep(
    *,
    seed: Annotated[int, seed_of("the layout and the detector noise")] = 0,
    quick: Annotated[bool, Option(help="40 runs of 0.5 s, for any design.")] = False,
    design: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="TOML file that says what is varied.  [default: experiments/sweep.toml]",
        ),
    ] = None,
    where: Where = HERE,
    folder: Path,
    on_progress: OnProgress,
) -> Result:
    """Simulate many closed loops with varied weights, failures and constants.

    The design is a Latin hypercube or a grid over weights, failures, failure times and constants of
    the testbed; each run is compared with the linear model. The default has 1000 runs of 4 s:
    10 to 30 minutes on two cores, 20 s with --quick.

    Rows are kept in OUT/unfinished.jsonl as they finish: Ctrl-C leaves them, and --resume
    continues. The numbers are identical to the bit for any number of workers and interruptions, on
    processors of one kind.

    Writes sweep.json, the rows as sweep.parquet, tables as sweep.md and Parquet, and a figure.

    Example: fjh paper sweep --quick --workers 2 --out /tmp/mine
    """
    chosen = read_design(design and check_file(design))
    if quick:
        chosen = replace(chosen, runs=min(chosen.runs, 40), duration_s=0.5)
    settings, rows = flown("sweep", chosen, seed, where, folder, on_progress)
    beside = beside_model(rows)
    ranges = [name for name, factor in chosen.factors.items() if isinstance(factor, dict)]
    status = rows.status.value_counts().sort_index().rename("runs").reset_index()
    columns = ["failures", "told", "runs", "alpha", "alpha_p95", "beta", "beta_p95"]
    told, found, ranked = groups(rows), prediction(beside), influence(rows, ranges)
    return Result(
        settings,
        {"groups": told, "status": status, "prediction": found, "influence": ranked},
        checks(beside),
        views=[
            TableView(
                "RMS error, urad, by the struts that fail during the run, and whether the mapping "
                "is told: median and 95th percentile",
                told.set_axis(columns, axis=1),
                "failures told runs alpha:.3f alpha_p95:.3f beta:.3f beta_p95:.3f",
            ),
            TableView("How the runs ended", status, "status runs"),
            TableView(
                "RMS errors beside the linear model's, over the runs that it covers",
                found,
                "compared off median_percent:.2g largest_percent:.2g",
                f"off: by more than {100 * TOLERANCE:g} % and one step of the converters.",
            ),
            TableView(
                "Spearman's rank correlation of what is varied with the RMS error",
                ranked,
                "name alpha:+.2f beta:+.2f",
            ),
        ],
        pictures=[
            Picture(
                "sweep",
                "RMS errors, simulated and of the linear model, which leaves out the steps of the "
                "converters; and what the errors of all runs depend on.",
                "On the left points on the diagonal, some hollow ones just above it; on the right "
                "pairs of bars, the longest on top.",
                partial(figure, beside, ranked),
            )
        ],
        rows=rows,
    )


def figure(beside: pd.DataFrame, influence: pd.DataFrame) -> Figure:
    """Both RMS errors over their predictions; bars of rank correlation."""
    figure = new_figure(PAGE_IN, max(3.2, 1.2 + 0.15 * len(influence)))
    left, right = figure.subplots(1, 2)
    found, rows = beside[beside.compared], np.arange(len(influence))
    points = found.iloc[:: max(1, len(found) // MOST_POINTS)]
    dot, ring = {"ms": 2, "mew": 0}, {"ms": 3.5, "mew": 0.6, "mfc": "none"}
    for k, (angle, color) in enumerate(zip(ANGLES, (BLUE, VERMILION), strict=True)):
        far = (points[RMS[k]] / points[PREDICTED[k]] - 1).abs() > TOLERANCE
        for which, style, what in ((~far, dot, "within"), (far, ring, "off by more than")):
            some, label = points[which], f"$\\{angle}$, {what} {100 * TOLERANCE:g} %"
            left.plot(some[PREDICTED[k]], some[RMS[k]], "o", color=color, label=label, **style)
        height, label = 0.4, f"$\\{angle}$"
        right.barh(rows + height * (k - 0.5), influence[angle], height, color=color, label=label)
    left.set(xlabel="RMS error, linear model, µrad", ylabel="RMS error, simulated, µrad")
    if len(found):
        span = np.nanmin(points[PREDICTED]), np.nanmax(points[PREDICTED])
        left.plot(span, span, color=BLACK, lw=0.6, zorder=0, label="equal")
        logarithmic(left, "xy")
        agree, median = (found.off_over_allowed < 1).sum(), found.off_percent.median()
        said = f"The error is as predicted in {agree} of {len(found)} runs:"
        left.set_title(f"{said}\nmedian difference {median:.2g} %")
    right.set(xlabel="Spearman's rank correlation", xlim=(-1, 1), ylim=(len(rows) - 0.4, -0.6))
    right.set(xticks=(-1, -0.5, 0, 0.5, 1), yticks=rows, yticklabels=influence.name)
    if len(influence):
        first = influence.iloc[0]
        largest = max(abs(first.alpha), abs(first.beta))
        right.set_title(f"The error depends most on\n{first['name']}, {largest:.2f}", loc="right")
        right.legend(loc="lower right")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


# The atlas.


def atlas(
    *,
    seed: Annotated[int, seed_of("the detector noise")] = 0,
    quick: Annotated[bool, Option(help="W_a only, 0.5 s.")] = False,
    where: Where = HERE,
    folder: Path,
    on_progress: OnProgress,
) -> Result:
    """Simulate the 138 failure conditions that differ by symmetry; compare them with theory.

    In a failure condition each strut works, is locked, or is free (without force); the mapping
    knows the condition. Of the 729, those that differ by rotation and mirror symmetry of the
    machine are simulated for 2 s of the spiral with the weights W_a to W_e of Table I and with the
    Jacobian of the nominal and of the estimated pose, and compared with their classification and
    the linear model. Nine minutes on two cores, one with --quick. Clusters, interruption and
    --resume are as in fjh sweep.

    Writes atlas.json, the rows as atlas.parquet, tables as atlas.md and Parquet, and a figure.

    Example: fjh paper atlas --quick
    """
    factors = {
        "struts": representatives(),
        "weight": ["W_a"] if quick else list(CHOICES["weight"][:5]),
        "jacobian": list(CHOICES["jacobian"]),
    }
    runs = prod(map(len, factors.values()))
    design = Design("grid", runs, 0.5 if quick else 2.0, factors)
    settings, rows = flown("atlas", design, seed, where, folder, on_progress)
    rows = rows.assign(**classified().loc[rows.struts].reset_index(drop=True))
    beside = beside_model(rows)
    found, off = verdicts(beside), disagreements(beside)
    columns = ["verdict", "jacobian", "runs", "model_alpha", "alpha", "model_beta", "beta"]
    return Result(
        settings | {"conditions": len(factors["struts"]), "weights": factors["weight"]},
        {"verdicts": found, "disagreements": off},
        atlas_checks(beside),
        views=[
            TableView(
                "RMS error, urad, by what is left of pointing: medians, and of the linear model",
                found.set_axis([*columns, "compared", "off"], axis=1),
                "verdict jacobian runs model_alpha:.3f alpha:.3f model_beta:.3f beta:.3f off:.2f",
                "off: largest difference from the model, in percent, converter steps included, of "
                "runs without saturated amplifiers.",
            ),
            TableView(
                "Runs off the linear model, explained by a singularity of the nominal pose or not",
                off,
                "struts weight jacobian verdict off_over_allowed:.3g explained",
            ),
        ],
        pictures=[
            Picture(
                "atlas_flown",
                "The failure conditions that differ by symmetry, each with the weight and Jacobian "
                "of its largest error. Crosses are singular at the nominal pose only: near it the "
                "mapping has a gain of 1e5, and amplifiers saturate.",
                "Over the number of failed struts: points with both pointing directions left on "
                "one low level, the others ten times as high, some crosses far above.",
                partial(atlas_figure, beside),
            )
        ],
        rows=rows,
    )


def representatives() -> list[str]:
    """The first of each set of conditions that turning by 120 degrees and mirroring make equal."""

    def first(condition: str) -> str:
        turned = [condition[k:] + condition[:k] for k in (0, 2, 4)]
        mirrored = ["".join(each[k] for k in MIRROR) for each in turned]
        return max(turned + mirrored)  # S, L, F: backwards in the alphabet

    return [each for each in every_condition(6) if first(each) == each]


@cache
def classified() -> pd.DataFrame:
    """The classification of all 729 conditions, by their letters; (alpha, beta) is the task."""
    atlas = failure_atlas(fault_tolerance.elastic_system(load_model()), MAJOR)
    elastic = atlas.elastic
    assert elastic is not None  # the hexapod has springs
    columns = {
        "verdict": names_of(fault_tolerance.pointing_classifications(atlas)),
        "failures": (atlas.codes != 0).sum(axis=1),
        "rigid_possible": atlas.possible,
        "rigid_unstable_major": atlas.unstable_major,
        "rigid_worst_gain_rad_per_m": atlas.worst_gain,
        "elastic_possible": elastic.possible,
        "elastic_major_rank": elastic.major_rank,
        "elastic_worst_gain_rad_per_m": elastic.worst_gain,
    }
    return pd.DataFrame(columns, index=pd.Index(every_condition(6)))


def verdicts(beside: pd.DataFrame) -> pd.DataFrame:
    """Prediction and simulation of each verdict with each Jacobian."""
    medians = {
        f"{source}_{angle}_median_urad": (names[k], "median")
        for k, angle in enumerate(ANGLES)
        for source, names in (("predicted", PREDICTED), ("simulated", RMS))
    }
    covered = beside.assign(off_percent=beside.off_percent.where(beside.compared))
    return (
        covered.groupby(["verdict", "jacobian"], sort=False)
        .agg(
            runs=("case", "size"),
            **medians,
            compared=("compared", "sum"),
            largest_off_percent=("off_percent", "max"),
        )
        .reset_index()
    )


def disagreements(beside: pd.DataFrame) -> pd.DataFrame:
    """Runs off their prediction, the farthest first: what theory explains, and what contradicts it.

    Explained is a condition that has lost pointing, simulated with the Jacobian of the estimated
    pose: its singularity is one of the nominal pose only. Beside it the mapping reaches the lost
    direction with a gain of 1e5, and what the integrators wound up there saturates the amplifiers.
    With the constant Jacobian the same condition must be as predicted, and so must all others.
    """
    # Runs that did not end, or have no prediction, are off as well.
    agree = (beside.off_over_allowed < 1) & beside.compared
    off = ~agree | ((beside.status == "exact") != beside.elastic_possible)
    explained = ~beside.verdict.isin(POSSIBLE) & (beside.jacobian == "analytic")
    found = beside.assign(explained=explained)[off]
    columns = ["case", "struts", "weight", "jacobian", "verdict", "status"]
    columns += [*PREDICTED, *RMS, "off_over_allowed", "explained"]
    return found.iloc[ascending(-found.off_over_allowed.fillna(inf))][columns]


def atlas_checks(beside: pd.DataFrame) -> list[Check]:
    """Number of runs that contradict the classification, and closure residuals."""
    where, found = "all conditions", disagreements(beside)
    contradicted = found[~found.explained]
    for run in contradicted.head(1).itertuples():
        where = f"{run.struts} with {run.weight} and the {run.jacobian} Jacobian"
    what = "number of runs that contradict the classification"
    largest_m = beside.closure_residual_max_m[beside.compared].max(skipna=False)
    return [
        *check(what, len(contradicted), 1, where),
        *check("closure residual [m]", largest_m, CLOSURE_LIMIT_M, "all runs"),
    ]


def atlas_figure(beside: pd.DataFrame) -> Figure:
    """Largest error of each condition, over the number of failed struts."""
    figure = new_figure(COLUMN_IN, 3.6)
    axes, error = figure.subplots(), beside[RMS].max(axis=1)
    found = beside.assign(error=error, model=beside[PREDICTED].max(axis=1))[error.notna()]
    found = found.iloc[ascending(-found.error)].drop_duplicates("struts")
    alike = found.groupby("failures").struts
    beyond = 0.7 * alike.cumcount() / (alike.transform("size") - 1).clip(lower=1) - 0.35
    place = found.failures + beyond.where(alike.transform("size") > 1, 0.0)
    singular = found.case.isin(disagreements(beside).query("explained").case)
    for (verdict, off), some in found.groupby(["verdict", singular], sort=False):
        (words, color), marker = VERDICTS[verdict], "x" if off else "o"
        style = {"color": color, "mfc": "none", "label": words + ", singular pose" * off}
        axes.plot(place[some.index], some.error, marker, **style)
    axes.plot(place, found.model, "_", color=GREEN, label="linear model")
    safe = beside.failures[~beside.elastic_possible].min() - 1
    none, largest = (error[beside.failures <= count].max() for count in (0, safe))
    axes.set_title(
        f"With any {safe} struts failed both angles are tracked:\n"
        f"RMS error at most {largest:.2f} µrad, {none:.2f} with none failed"
    )
    axes.set(xlabel="struts failed, locked or free", ylabel="RMS error, larger angle, µrad")
    axes.set_xticks(range(7))
    logarithmic(axes, "y")
    one_legend(figure, 2)
    return figure
