"""Studies `sweep` and `atlas`: many closed loops against the linear model; docs/priorities.md."""

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
"""Largest relative distance of an RMS from the linear model's under the same noise, in addition to
one step of the converters. In 40 runs with varied weights, failures, loops, noise and converters
the largest distance was 44 % of the sum."""
MOST_POINTS = 2000  # in a figure: more cannot be distinguished

MIRROR = (1, 0, 5, 4, 3, 2)
"""Permutation of the struts by a mirror symmetry of the machine."""
CLASSES = {
    "rigid": ("pointing exact", BLUE),
    "springs": ("exact with springs only", SKY),
    "drifts": ("payload drifts", PURPLE),
    "one_direction": ("one direction left", VERMILION),
    "none": ("none left", BLACK),
}
"""Labels and colours of the classes of conditions."""


# A run and its row.


@cache
def hexapod_plant() -> tuple[mujoco.MjModel, Array, tuple[Any, Array]]:
    """Return the hexapod, its stiffness (12, 12), and its linear plant, once per process."""
    model = load_model()
    return model, fault_tolerance.strut_and_payload_stiffness(model), nominal_plant(model)


def row_of(run: SweepRun) -> Row:
    """Simulate a run; return its row.

    Returns:
        Parameters, `status` and measured quantities, if any. The status of a completed run is that
        of its mapping ("exact" if it performs the pointing task), or "unstable" if the loop of the
        linear model is unstable. Otherwise it is "diverged" (the state is not finite) or "refused"
        (the loops cannot be closed, or the physics cannot be stepped).
    """
    model, stiffness, _ = hexapod_plant()
    row = run.parameters() | dict.fromkeys((*COLUMNS, *PREDICTED, *MEASURED))
    try:
        # The mapping after the failures, at J_0.
        mapping = StrutMapping(hexapod(model), run.reconfigured, "constant", stiffness)
        predicted = _predicted(run)
        status = mapping.at(mapping.nominal).mapping.status
        row |= predicted | {"status": status.name.lower()}
        row["dac_step_urad"] = _dac_step_urad(run, mapping)
        if predicted and PREDICTED[0] not in predicted:
            row["status"] = "unstable"
        return row | measured_columns(simulate_run(run))
    except SimulationDiverged as error:
        row |= {"status": "diverged", "message": str(error)}
        return row | {"diverged_at_s": error.time_s}
    except ModelError as error:
        return row | {"status": "refused", "message": str(error)}


def simulate_run(run: SweepRun) -> Run:
    """Simulate a run; raise the errors of the simulation."""
    rig, path = _rig(run), run.bench.spiral_rad(run.duration_s)
    controller = rig.controller()
    if run.known and run.failure_time_s > 0 and run.failures:
        controller = rig.reconfigured(run.goal, run.reconfigured, run.failure_time_s)
    return rig.fly(controller, path, failures=run.failures, seed=run.seed)


def _rig(run: SweepRun) -> Rig:
    goal = run.reconfigured if run.failure_time_s == 0 else run.goal
    return pursuing(_rig_of(run.bench), goal, jacobian=run.jacobian)


@lru_cache(maxsize=8)
def _rig_of(bench: TestbedConfig) -> Rig:
    """Return the hexapod with these constants, linearized and settled once for all runs."""
    model, stiffness, plant = hexapod_plant()
    return hexapod_rig(Testbed(model, bench, designed(*plant, bench), stiffness))


def _predicted(run: SweepRun) -> Row:
    """Return the largest pole of the sampled linear loop, and RMS errors if the loop is stable.

    The row is empty if the linear model does not apply, because the plant changes during the run or
    a strut without spring falls to its stop.
    """
    if any(failure.time_s > 0 or failure.kind == "loose" for failure in run.failures):
        return {}
    rig, faults = _rig(run), [Fault.of(failure) for failure in run.failures]
    row: Row = {"predicted_pole_radius": pole_radius(open_loop(rig, rig.goal, faults))}
    if row["predicted_pole_radius"] > MARGINAL:
        return row
    path = run.bench.spiral_rad(run.duration_s)
    noise = detector_noise_rad(run.bench, run.seed, len(path))
    predicted_run = rig.predict(path, failures=run.failures, told=False, noise=noise)
    return row | dict(zip(PREDICTED, (1e6 * rms(predicted_run.error)).tolist(), strict=True))


def _dac_step_urad(run: SweepRun, mapping: StrutMapping) -> float:
    """Return the largest pointing change [urad] by one step of one strut's converter."""
    amplifier = run.bench.amplifier(newton_per_m=float(hexapod_plant()[0].actuator_gainprm[0, 0]))
    step_m = amplifier.displacements(np.eye(6) * 100 / 2 ** (run.bench.dac_bits - 1))
    steps_rad = [mapping.major_motion(strut_m, NOMINAL) for strut_m in step_m]
    return 1e6 * float(np.linalg.norm(steps_rad, axis=1).max())


def measured_columns(run: Run) -> Row:
    """Return the measured quantities of a completed run."""
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


def repeatable_runs(
    summary: dict[str, Any],
) -> tuple[list[SweepRun], Callable[[SweepRun], tuple[Row, Run]]]:
    """Return the runs of a `sweep.json` or an `atlas.json`, and the function that repeats one.

    Raises:
        WrongInput: There are more runs than a design may have.
    """
    design = Design(**summary["basis"]["design"])
    if design.runs > MOST_RUNS:
        raise WrongInput(f"a design has at most {MOST_RUNS} runs, got {design.runs}")
    return runs_of(design, summary["basis"]["seed"]), repeat


def repeat(run: SweepRun) -> tuple[Row, Run]:
    """Simulate a run again; return its measured quantities and the run."""
    simulated = simulate_run(run)
    return measured_columns(simulated), simulated


# Comparison with the linear model.


def compare_with_model(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with columns on their distance from the linear model.

    The columns are `off_percent`, the larger distance of the two angles, relative to the predicted
    RMS; `off_over_allowed`, the ratio to the tolerance; and `compared`, whether a run is predicted,
    completed and not saturated.
    """
    predicted = rows[PREDICTED].to_numpy(float)
    off = np.abs(rows[RMS].to_numpy(float) - predicted)
    allowed = TOLERANCE * predicted + rows[["dac_step_urad"]].to_numpy(float)
    return rows.assign(
        off_percent=100 * (off / predicted).max(axis=1),
        off_over_allowed=(off / allowed).max(axis=1),
        compared=rows[PREDICTED[0]].notna() & (rows[INPUT_PEAK].max(axis=1) < 99.9),
    )


def prediction(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row that summarizes all runs that the linear model covers."""
    covered = rows[rows.compared]
    row = {
        "compared": len(covered),
        "off": (covered.off_over_allowed >= 1).sum(),
        "median_percent": covered.off_percent.median(),
        "largest_percent": covered.off_percent.max(),
    }
    return pd.DataFrame([row])


def groups(rows: pd.DataFrame) -> pd.DataFrame:
    """Return errors by the number of struts that fail during a run, known to the mapping or not."""
    failures = rows.struts.str.count("[^S]").where(rows.failure_time_s < rows.duration_s, 0)
    measures = {
        f"{angle}_{word}_urad": (f"{angle}_rms_urad", partial(pd.Series.quantile, q=q))
        for angle in ANGLES
        for word, q in (("median", 0.5), ("percentile_95", 0.95))
    }
    is_known = rows.known | (failures == 0)
    grouped = rows.assign(failures=failures, told=is_known).groupby(["failures", "told"])
    return grouped.agg(runs=("case", "size"), **measures).reset_index()


def influence(rows: pd.DataFrame, varied: list[str]) -> pd.DataFrame:
    """Return Spearman's rank correlation of each quantity with the RMS errors, largest first.

    The correlation is left out if all errors are equal.
    """
    done = rows[rows[RMS[0]].notna()]
    errors = done[RMS].set_axis([*ANGLES], axis=1).apply(ranks)
    values = done[varied].dropna(axis=1)
    values = values.loc[:, (values.nunique() > 1) & (len(done) > 2) & (errors.nunique() > 1).all()]
    correlations = {angle: values.corrwith(errors[angle], method="spearman") for angle in ANGLES}
    correlations = pd.DataFrame(correlations).rename_axis("name").reset_index()
    return correlations.iloc[ascending(-correlations[[*ANGLES]].abs().max(axis=1))]


def checks(rows: pd.DataFrame) -> list[Check]:
    """Return checks of RMS errors against the linear model, and of closure residuals."""
    covered = rows[rows.compared]
    if covered.empty:
        return []
    worst = covered.iloc[greatest(covered.off_over_allowed)]
    what = "difference between the RMS error"
    what += f" and the linear model's, divided by {100 * TOLERANCE:g} % plus one converter step,"
    gap_m = covered.closure_residual_max_m.max(skipna=False)
    return [
        *check(what, worst.off_over_allowed, 1.0, f"run {worst.case}"),
        *check("closure residual [m]", gap_m, CLOSURE_LIMIT_M, "all runs"),
    ]


# The sweep.


def simulate_design(
    name: str, design: Design, seed: int, where: Where, folder: Path, on_progress: OnProgress
) -> tuple[dict[str, Any], pd.DataFrame]:
    """Simulate the runs of a design; return the settings of the study and the rows."""
    basis, place = basis_of(design=asdict(design), seed=seed), {"name": name, "folder": folder}
    rows = rows_of(runs_of(design, seed), row_of, basis, where, on_progress=on_progress, **place)
    more = {"basis": basis, "runs": len(rows), "duration_s": design.duration_s}
    return origin(seed) | more, rows.astype({"message": "string"})


def sweep(
    *,
    seed: Annotated[int, seed_of("the layout and the detector noise")] = 0,
    quick: Annotated[bool, Option(help="40 runs of 0.5 s, for any design.")] = False,
    design: Annotated[
        Path | None,
        Option("TOML file of the varied quantities.  [default: experiments/sweep.toml]", "FILE"),
    ] = None,
    where: Where = HERE,
    folder: Path,
    on_progress: OnProgress,
) -> Result:
    """Simulate many closed loops with varied weights, failures and constants.

    The design is a Latin hypercube or a grid over weights, failures, failure times and constants of
    the testbed; each run is compared with the linear model. The default of 400 runs of 4 s takes
    5 to 15 minutes on two cores, 20 s with --quick.

    Rows are saved in OUT/unfinished.jsonl: after Ctrl-C, --resume continues. On processors of one
    kind the numbers are identical for any number of workers and interruptions.

    Writes sweep.json, the rows as sweep.parquet (docs/priorities.md lists its columns), tables as
    sweep.md and Parquet, and a figure.

    Example: fjh paper sweep --quick --workers 2 --out /tmp/mine
    """
    selected = read_design(design and check_file(design))
    if quick:
        selected = replace(selected, runs=min(selected.runs, 40), duration_s=0.5)
    settings, rows = simulate_design("sweep", selected, seed, where, folder, on_progress)
    compared = compare_with_model(rows)
    ranges = [name for name, factor in selected.factors.items() if isinstance(factor, dict)]
    status = rows.status.value_counts().sort_index().rename("runs").reset_index()
    by_failures, predicted, ranked = groups(rows), prediction(compared), influence(rows, ranges)
    return Result(
        settings,
        {"groups": by_failures, "status": status, "prediction": predicted, "influence": ranked},
        checks(compared),
        views=[
            TableView(
                "RMS error by the number of struts that fail during the run, known to the mapping "
                "or not: median, and 95 % of the runs have less",
                by_failures,
                "failures told=known runs alpha_median_urad=alpha_urad:.3f "
                "alpha_percentile_95_urad=95_%_alpha_urad:.3f beta_median_urad=beta_urad:.3f "
                "beta_percentile_95_urad=95_%_beta_urad:.3f",
            ),
            TableView("Status of the runs", status, "status runs"),
            TableView(
                "RMS errors compared with the linear model's, for the runs that it covers",
                predicted,
                "compared off=different median_percent:.2g largest_percent:.2g",
                f"Different: by more than {100 * TOLERANCE:g} % and one step of the converters.",
            ),
            TableView(
                "Spearman's rank correlation of varied quantities with the RMS error",
                ranked,
                "name alpha:+.2f beta:+.2f",
            ),
        ],
        pictures=[
            Picture(
                "sweep",
                "RMS errors, simulated and of the linear model, which neglects the steps of the "
                "converters; and their rank correlation with the varied quantities.",
                "On the left points on the diagonal, some hollow ones just above it; on the right "
                "pairs of bars, the longest on top.",
                partial(figure, compared, ranked),
            )
        ],
        rows=rows,
    )


def figure(compared: pd.DataFrame, influence: pd.DataFrame) -> Figure:
    """Plot both RMS errors over their predictions, and bars of rank correlation."""
    figure = new_figure(PAGE_IN, max(3.2, 1.2 + 0.15 * len(influence)))
    left, right = figure.subplots(1, 2)
    covered, rows = compared[compared.compared], np.arange(len(influence))
    points = covered.iloc[:: max(1, len(covered) // MOST_POINTS)]
    dot, ring = {"ms": 2, "mew": 0}, {"ms": 3.5, "mew": 0.6, "mfc": "none"}
    for k, (angle, color) in enumerate(zip(ANGLES, (BLUE, VERMILION), strict=True)):
        far = (points[RMS[k]] / points[PREDICTED[k]] - 1).abs() > TOLERANCE
        for which, style, what in ((~far, dot, "within"), (far, ring, "off by more than")):
            subset, label = points[which], f"$\\{angle}$, {what} {100 * TOLERANCE:g} %"
            left.plot(subset[PREDICTED[k]], subset[RMS[k]], "o", color=color, label=label, **style)
        height, label = 0.4, f"$\\{angle}$"
        right.barh(rows + height * (k - 0.5), influence[angle], height, color=color, label=label)
    left.set(xlabel="RMS error, linear model, µrad", ylabel="RMS error, simulated, µrad")
    if len(covered):
        span = np.nanmin(points[PREDICTED]), np.nanmax(points[PREDICTED])
        left.plot(span, span, color=BLACK, lw=0.6, zorder=0, label="equal")
        logarithmic(left, "xy")
        agree, median = (covered.off_over_allowed < 1).sum(), covered.off_percent.median()
        text = f"The error is as predicted in {agree} of {len(covered)} runs:"
        left.set_title(f"{text}\nmedian difference {median:.2g} %")
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

    In a failure condition each strut works, is locked, or is free (without force), and the mapping
    is informed. Of the 729 conditions, those that are not equal by rotation or mirror symmetry are
    simulated for 2 s of the spiral with the weights W_a to W_e of Table I and the Jacobians of the
    nominal and of the estimated pose, and compared with their classification and the linear model.
    Takes nine minutes on two cores, one with --quick. Clusters, interruption and --resume are as in
    fjh paper sweep.

    Writes atlas.json, the rows as atlas.parquet (docs/priorities.md lists its columns), tables as
    atlas.md and Parquet, and a figure.

    Example: fjh paper atlas --quick
    """
    factors = {
        "struts": representatives(),
        "weight": ["W_a"] if quick else list(CHOICES["weight"][:5]),
        "jacobian": list(CHOICES["jacobian"]),
    }
    runs = prod(map(len, factors.values()))
    design = Design("grid", runs, 0.5 if quick else 2.0, factors)
    settings, rows = simulate_design("atlas", design, seed, where, folder, on_progress)
    rows = rows.assign(**classified().loc[rows.struts].reset_index(drop=True))
    compared = compare_with_model(rows)
    classes, contradictions = class_table(compared), disagreements(compared)
    return Result(
        settings | {"conditions": len(factors["struts"]), "weights": factors["weight"]},
        {"verdicts": classes, "disagreements": contradictions},
        atlas_checks(compared),
        views=[
            TableView(
                "Median RMS error, simulated and of the linear model, by class of condition",
                classes,
                "verdict=pointing jacobian runs simulated_alpha_median_urad=alpha_urad:.3f "
                "predicted_alpha_median_urad=model_alpha_urad:.3f "
                "simulated_beta_median_urad=beta_urad:.3f "
                "predicted_beta_median_urad=model_beta_urad:.3f "
                "largest_off_percent=difference_percent:.2f",
                "Largest difference from the model of runs without saturated amplifiers, converter "
                "steps included.",
            ),
            TableView(
                "Runs unlike the linear model; explained by a singularity of the nominal pose",
                contradictions,
                "struts weight jacobian verdict=pointing off_over_allowed=difference/allowed:.3g "
                "explained",
            ),
        ],
        pictures=[
            Picture(
                "atlas_flown",
                "The failure conditions that differ by symmetry, each with the weight and Jacobian "
                "of its largest error. Crosses are singular at the nominal pose only: near it the "
                "mapping has a gain of 1e5, and amplifiers saturate.",
                "Over the number of failed struts: points with both pointing directions left at "
                "one low level, the others ten times as high, some crosses far above.",
                partial(atlas_figure, compared),
            )
        ],
        rows=rows,
    )


def representatives() -> list[str]:
    """Return one condition of each set of conditions that are equal by rotation and mirroring."""

    def first(condition: str) -> str:
        turned = [condition[k:] + condition[:k] for k in (0, 2, 4)]
        mirrored = ["".join(codes[k] for k in MIRROR) for codes in turned]
        return max(turned + mirrored)  # S, L, F: in reverse alphabetical order

    return [condition for condition in every_condition(6) if first(condition) == condition]


@cache
def classified() -> pd.DataFrame:
    """Return the classes of all 729 conditions for the task (alpha, beta), by condition."""
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


def class_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return medians of predicted and simulated errors for each class with each Jacobian."""
    medians = {
        f"{source}_{angle}_median_urad": (names[k], "median")
        for k, angle in enumerate(ANGLES)
        for source, names in (("predicted", PREDICTED), ("simulated", RMS))
    }
    covered = rows.assign(off_percent=rows.off_percent.where(rows.compared))
    more = {"compared": ("compared", "sum"), "largest_off_percent": ("off_percent", "max")}
    grouped = covered.groupby(["verdict", "jacobian"], sort=False)
    return grouped.agg(runs=("case", "size"), **medians, **more).reset_index()


def disagreements(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the runs off their prediction, the largest distance first, with their explanation.

    A run is `explained` if its condition loses pointing and its Jacobian is that of the estimated
    pose, which is singular at the nominal pose only: near it the mapping moves in the lost
    direction with a gain of 1e5, and the wound-up integrators saturate the amplifiers. All other
    runs must be as predicted.
    """
    # Runs that are not completed, or have no prediction, are off as well.
    agrees = (rows.off_over_allowed < 1) & rows.compared
    off = ~agrees | ((rows.status == "exact") != rows.elastic_possible)
    explained = ~rows.verdict.isin(POSSIBLE) & (rows.jacobian == "analytic")
    off_rows = rows.assign(explained=explained)[off]
    columns = ["case", "struts", "weight", "jacobian", "verdict", "status"]
    columns += [*PREDICTED, *RMS, "off_over_allowed", "explained"]
    return off_rows.iloc[ascending(-off_rows.off_over_allowed.fillna(inf))][columns]


def atlas_checks(rows: pd.DataFrame) -> list[Check]:
    """Return checks of the number of runs that contradict the classification, and of closure."""
    where, off_rows = "all conditions", disagreements(rows)
    contradicted = off_rows[~off_rows.explained]
    for run in contradicted.head(1).itertuples():
        where = f"{run.struts} with {run.weight} and the {run.jacobian} Jacobian"
    what = "number of runs that contradict the classification"
    largest_m = rows.closure_residual_max_m[rows.compared].max(skipna=False)
    return [
        *check(what, len(contradicted), 1, where),
        *check("closure residual [m]", largest_m, CLOSURE_LIMIT_M, "all runs"),
    ]


def atlas_figure(rows: pd.DataFrame) -> Figure:
    """Plot the largest error of each condition over the number of failed struts."""
    figure = new_figure(COLUMN_IN, 3.6)
    axes, error = figure.subplots(), rows[RMS].max(axis=1)
    plotted = rows.assign(error=error, model=rows[PREDICTED].max(axis=1))[error.notna()]
    plotted = plotted.iloc[ascending(-plotted.error)].drop_duplicates("struts")
    same_count = plotted.groupby("failures").struts
    beyond = 0.7 * same_count.cumcount() / (same_count.transform("size") - 1).clip(lower=1) - 0.35
    place = plotted.failures + beyond.where(same_count.transform("size") > 1, 0.0)
    singular = plotted.case.isin(disagreements(rows).query("explained").case)
    for (verdict, off), subset in plotted.groupby(["verdict", singular], sort=False):
        (label, color), marker = CLASSES[verdict], "x" if off else "o"
        style = {"color": color, "mfc": "none", "label": label + ", singular pose" * off}
        axes.plot(place[subset.index], subset.error, marker, **style)
    axes.plot(place, plotted.model, "_", color=GREEN, label="linear model")
    safe = rows.failures[~rows.elastic_possible].min() - 1
    none, largest = (error[rows.failures <= count].max() for count in (0, safe))
    axes.set_title(
        f"With any {safe} struts failed both angles are tracked:\n"
        f"RMS error at most {largest:.2f} µrad, {none:.2f} with none failed"
    )
    axes.set(xlabel="struts failed, locked or free", ylabel="RMS error, larger angle, µrad")
    axes.set_xticks(range(7))
    logarithmic(axes, "y")
    one_legend(figure, 2)
    return figure
