"""Study `table1`: Table I and Figures 4 to 6, the six tracking experiments of section 4.2."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fjh.recording.record import About, write_run
from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.hexapod import metrics, paper
from fjh.rig.hexapod.columns import COLUMNS, Column, hexapod_arrays, secondary, secondary_estimated
from fjh.rig.hexapod.controller import ANGLES, nominal_loops
from fjh.rig.hexapod.machine import detector_noise_rad
from fjh.rig.hexapod.mismatch import ALL_SIZES, has_suspensions
from fjh.rig.hexapod.rig import hexapod_rig, pursuing
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.options import Controller, JacobianChoice, MachineFile
from fjh.rig.other_controller import controller_factory, controller_label, simulate_with
from fjh.rig.rig import Rig
from fjh.rig.run import Run, rms
from fjh.study.input_checks import check_file
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from fjh.study.plotting import COLUMN_IN, DESIRED, MEASURED, PAGE_IN, START, new_figure, one_legend
from fjh.study.result import Check, Picture, Result, TableView, check, origin
from fjh.study.workers import call, in_parallel
from sim import Array, ModelError, load_model
from sim.mjcf import model_sha256

ConfigurationName = Literal["calibrated", "demand-limit"]
CONFIGURATIONS: dict[ConfigurationName, TestbedConfig] = {
    "calibrated": TestbedConfig(),
    # Of the settings that docs/uncorrected.md maps, the one that fits the fewest numbers.
    "demand-limit": TestbedConfig(spiral_direction=-1, demand_limit_urad=95.0),
}
"""Constants of the testbed by configuration. Spiral, crossovers and detector noise are fitted to
columns W_a to W_e."""
LAST_COLUMN = {"calibrated": "predicted", "demand-limit": "fitted"}
"""Origin of the errors in column W_a_uncorrected, by configuration. Other columns have the errors
of W_a, since J_m M = I for any weights and known lock."""

MOTIONS = ("gamma_urad", "t_x_um", "t_y_um", "t_z_um")  # columns of `secondary`
BY_NAME = {column.name: column for column in COLUMNS}
REPRESENTATIVE = ("W_a", "W_d", "W_a_uncorrected")
"""Columns that are simulated also with mismatch and with another controller: no failure, strut 1
locked and known, strut 1 locked and unknown."""

NOT_SIMULATED = (np.nan, np.nan)
MISMATCH_TOLERANCE = 0.1
"""Largest relative distance of an RMS error from the nominal linear model's on the same floor."""


def table1(
    *,
    seed: Annotated[int, seed_of("the detector noise")] = 0,
    quick: Annotated[
        bool, Option(help="Only the first 4 s of the 16 s spiral, one mismatched plant.")
    ] = False,
    jacobian: Annotated[
        JacobianChoice,
        Option(
            help="Jacobian of the mapping: analytic, at the estimated pose in every control tick, "
            "or constant, at the nominal pose as in eq. (39). Both are simulated; the table shows "
            "this one."
        ),
    ] = "analytic",
    configuration: Annotated[
        ConfigurationName,
        Option(
            help="Constants of the testbed: calibrated, fitted to columns W_a to W_e; "
            "demand-limit, fitted to the last column as well by a clockwise spiral and a limit of "
            "95 urad on the pointing that the compensators may demand (docs/uncorrected.md)."
        ),
    ] = "calibrated",
    model: MachineFile = None,
    controller: Controller = None,
    on_progress: OnProgress,
) -> Result:
    """Reproduce Table I and Figures 4 to 6 of the paper.

    The hexapod tracks a spiral for 16 s in six cases (columns W_a to W_e and W_a uncorrected),
    without failure and with strut 1 locked. The pointing errors are compared with the linear model
    of the testbed and with the paper. Three cases are also simulated with plants that differ from
    the controller's model. Takes a minute and a half on two cores, 30 s with --quick.

    Writes table1.json, its tables as table1.md and Parquet, Figures 4 to 6, and for each column of
    Table I its data (.npz, 1 kHz) and its recording (.rrd, 200 Hz). With --controller there are
    three columns of that controller: without failure, with strut 1 locked and known, and with strut
    1 locked and unknown.

    Example: fjh table1 --configuration demand-limit --seed 7 --out /tmp/mine
    """
    if controller is not None:
        controller_factory(controller)  # a wrong name is refused before anything runs
    machine, bench = load_model(model and check_file(model)), CONFIGURATIONS[configuration]
    loops, constants = nominal_loops(machine, bench), metrics.plant_constants(machine)
    rig = hexapod_rig(Testbed(machine, bench, loops))
    path = bench.spiral_rad(bench.quick_duration_s if quick else bench.duration_s)
    other_choice: JacobianChoice = "constant" if jacobian == "analytic" else "analytic"
    rigs = {
        (kind, name): pursuing(rig, column.goal, jacobian=choice)
        for kind, choice in (("own", jacobian), ("other Jacobian", other_choice))
        for name, column in BY_NAME.items()
    }
    own_rigs = {name: rigs["own", name] for name in BY_NAME}
    _ = rig.machine.equilibrium  # computed once for all processes
    mismatched = rigs_with_mismatch(own_rigs, seed, quick=quick)
    rigs["next seed", "W_a"] = own_rigs["W_a"]
    rigs |= {("controller", name): own_rigs[name] for name in REPRESENTATIVE if controller}
    rigs |= {("mismatched", name): mismatched[name] for name in mismatched}
    calls: list[Callable[[], Any]] = [
        partial(predicted_rad, own_rigs[name], column, path, seed)
        for name, column in BY_NAME.items()
    ]
    for (kind, name), rig_of_run in rigs.items():
        plugin = controller if kind == "controller" else None
        noise = seed + 1 if kind == "next seed" else seed
        calls.append(partial(_simulate, rig_of_run, BY_NAME[name], path, noise, plugin))
    done = in_parallel(call, [{"work": work} for work in calls], on_progress)
    predicted = dict(zip(BY_NAME, done, strict=False))
    results = dict(zip(rigs, done[len(BY_NAME) :], strict=True))
    runs = {key: run for key, (run, _) in results.items()}

    origins = {"W_a": "fitted", "W_a_uncorrected": LAST_COLUMN[configuration]}
    rows: dict[tuple[str, str], dict[str, Any]] = {
        ("own", name): column_row(column, runs["own", name], name, origins.get(name, "= W_a"))
        | by_angle("paper_*_rms_urad", paper.TABLE_I_URAD[name])
        | by_angle("predicted_*_rms_urad", 1e6 * predicted[name])
        | by_angle("other_jacobian_*_rms_urad", 1e6 * runs["other Jacobian", name].rms())
        for name, column in BY_NAME.items()
    }
    for name, rig_of_run in mismatched.items():
        run = runs["mismatched", name]
        rows["own", name] |= mismatched_errors(rig_of_run, BY_NAME[name], run, seed)
    for name in REPRESENTATIVE if controller else ():
        run, failure = results["controller", name]
        label = f"{controller_label(str(controller))}_{name}"
        labels = {"controller": controller, "compared_with": name, "failure": failure}
        rows["controller", name] = column_row(BY_NAME[name], run, label, "other") | labels
    columns = pd.DataFrame([*rows.values()])
    margins = pd.DataFrame(map(metrics.loop_measures, loops)).drop(columns="sentence")
    margins.insert(0, "angle", ANGLES)
    further = further_runs(columns, runs)
    settings = origin(seed) | {
        "model_sha256": model_sha256(model),
        "jacobian": jacobian,
        "duration_s": len(path) * bench.control_period_s,
        "configuration": configuration,
        "bench": asdict(bench) | constants,
        "mismatch": ALL_SIZES if mismatched else None,
    }
    checked = checks(columns, further, settings["duration_s"])
    save = partial(record, rig, settings, checked, model)
    return Result(
        settings=settings,
        tables={"columns": columns, "further_runs": further, "loops": margins},
        checks=checked,
        views=printed_tables(columns, further, margins, settings),
        notes=[f"{row['name']}: {row['failure']}." for row in rows.values() if row.get("failure")],
        pictures=pictures(runs, controller),
        records=[partial(save, row, runs[key]) for key, row in rows.items()],
    )


def _simulate(
    rig: Rig, column: Column, path: Array, seed: int, controller: str | None
) -> tuple[Run, str | None]:
    """Simulate a run; return it and, if another controller failed, a sentence on that, or None."""
    if controller is not None:
        return simulate_with(rig, controller, path, failures=column.failures, seed=seed)
    return rig.fly(rig.controller(), path, failures=column.failures, seed=seed), None


def rigs_with_mismatch(rigs: Mapping[str, Rig], seed: int, *, quick: bool) -> dict[str, Rig]:
    """Return rigs with all mismatches, on different plants, by column; only one if `quick`.

    The result is empty for a machine without suspension springs, which the mismatch needs.
    """
    names = [name for name in REPRESENTATIVE if has_suspensions(rigs[name].model)]
    selected = names[: 1 if quick else None]
    return {name: rigs[name].with_mismatch("all", seed + k) for k, name in enumerate(selected)}


def predicted_rad(
    rig: Rig, column: Column, path: Array, seed: int, floor_m_per_s2: Array | None = None
) -> Array:
    """Predict the RMS errors (2,) [rad] with the linear model of the nominal plant.

    The errors are expected values over the noise; with a limit on the demand or a moving floor they
    are those for the noise of this seed.

    Raises:
        sim.ModelError: The loops are unstable in the linear model.
    """
    bench, noise = rig.control.testbed.bench, None
    if bench.demand_limit_urad is not None or floor_m_per_s2 is not None:
        noise = detector_noise_rad(bench, seed, len(path))
    arguments = {"failures": column.failures, "told": False, "floor_m_per_s2": floor_m_per_s2}
    predicted = rig.predict(path, noise=noise, **arguments)
    if predicted.leaves is not None:
        raise ModelError(f"the loops of {column.name} are unstable on this machine")
    return predicted.rms


def of_angles(key: str) -> list[str]:
    """Return the keys for alpha and beta, with the angle in place of `*`."""
    return [key.replace("*", angle) for angle in ANGLES]


def by_angle(key: str, values: Sequence[float] | Array) -> dict[str, Any]:
    """Return the values of alpha and beta by the keys of :func:`of_angles`."""
    return dict(zip(of_angles(key), values, strict=True))


def column_row(column: Column, run: Run, name: str, source: str) -> dict[str, Any]:
    """Return the row of a run of a column; `source` is the origin of its errors."""
    return {
        "name": name,
        "locked": column.struts("locked"),
        "free": column.struts("free"),
        "joint_weight": column.goal.joint_weight,
        "secondary_weight_t_x_t_y_t_z_gamma": column.goal.secondary_weight,
        "origin": source,
        "recording": f"{name}.rrd",
        "data": f"{name}.npz",
        **by_angle("*_rms_urad", 1e6 * run.rms()),
        **by_angle("*_measured_rms_urad", 1e6 * rms(run.desired - run.measured)),
        **by_angle("mismatched_*_rms_urad", NOT_SIMULATED),
        **by_angle("mismatched_predicted_*_rms_urad", NOT_SIMULATED),
        "strut_input_rms_percent": rms(run.inputs),
        "strut_input_peak_percent": np.abs(run.inputs).max(axis=0),
        "secondary_peak": peaks(secondary(run)),
        "secondary_peak_estimated": peaks(secondary_estimated(run)) if source != "other" else None,
        "closure_residual_max_m": run.closure_max_m,
    }


def peaks(motion: Array) -> dict[str, float]:
    """Return the largest [gamma, t_x, t_y, t_z] of a secondary motion (N, 4), [urad] and [um]."""
    return dict(zip(MOTIONS, (1e6 * np.abs(motion).max(axis=0)).tolist(), strict=True))


def mismatched_errors(rig: Rig, column: Column, run: Run, seed: int) -> dict[str, Any]:
    """Return the errors of a run on another plant, and those predicted for the nominal one.

    Prediction and run have the same noise and floor. Errors are relative to the drifted zero of the
    detector, which no controller can observe.
    """
    machine, ticks = rig.machine, len(run.time_s)
    simulated_rad = rms(run.desired - (run.true + machine.zero_rad(ticks)))
    expected_rad = predicted_rad(rig, column, run.desired, seed, machine.floor(ticks))
    return by_angle("mismatched_*_rms_urad", 1e6 * simulated_rad) | by_angle(
        "mismatched_predicted_*_rms_urad", 1e6 * expected_rad
    )


def further_runs(columns: pd.DataFrame, runs: Mapping[tuple[str, str], Run]) -> pd.DataFrame:
    """Return a row for each kind of further runs, with the largest difference of RMS errors.

    For runs with the other Jacobian or the next seed the reference are the columns; for runs with
    mismatch it is the linear model. Keys of `runs` are kind and name of the column.
    """
    own_rows, off = columns[columns.origin != "other"], "largest_rms_difference_urad"
    rms_urad, other, mismatched, expected = (
        own_rows[of_angles(f"{kind}*_rms_urad")].to_numpy(dtype=float)
        for kind in ("", "other_jacobian_", "mismatched_", "mismatched_predicted_")
    )
    reseeded = 1e6 * runs["next seed", "W_a"].rms()
    rows = [
        {"runs": "other Jacobian", off: np.abs(other - rms_urad).max()},
        {"runs": "next seed", off: np.abs(reseeded - rms_urad[0]).max()},
    ]
    relative = np.abs(mismatched / expected - 1)
    if not np.isnan(relative).all():
        rows.append({"runs": "mismatched", "largest_relative_difference": np.nanmax(relative)})
    gaps_m = pd.Series({key: run.closure_max_m for key, run in runs.items()}).groupby(level=0).max()
    return pd.DataFrame(rows).assign(closure_residual_max_m=lambda frame: frame.runs.map(gaps_m))


def checks(columns: pd.DataFrame, further: pd.DataFrame, duration_s: float) -> list[Check]:
    """Return checks of closure, RMS errors against the linear model, and another controller."""
    by_name, result = columns.set_index("name"), list[Check]()
    own_rows, other_rows = by_name[by_name.origin != "other"], by_name[by_name.origin == "other"]
    mismatched = own_rows[own_rows.filter(like="mismatched_").notna().any(axis=1)]
    for rows, kind, when, limit in (
        (own_rows, "", "", metrics.prediction_tolerance(duration_s)),
        (mismatched, "mismatched_", " with all mismatches", MISMATCH_TOLERANCE),
    ):
        for angle in ANGLES:
            expected = rows[f"{kind}predicted_{angle}_rms_urad"]
            off = (rows[f"{kind}{angle}_rms_urad"] - expected).abs() / expected.abs()
            what = f"relative difference of the RMS error of {angle}{when} from the linear model's"
            result += check(what, off, limit)
    result += check("closure residual [m]", by_name.closure_residual_max_m, CLOSURE_LIMIT_M)
    residual_m = further.set_index("runs").closure_residual_max_m
    result += check("closure residual [m]", residual_m, CLOSURE_LIMIT_M)
    for name, row in other_rows.iterrows():
        has_failed = pd.notna(row.failure)
        what = f"failures of the controller ({row.failure if has_failed else 'none'})"
        result += check(what, float(has_failed), 0.5, str(name))
    return result


NUMBERS = (
    ("origin", "origin", ""),
    *(
        (label.replace("*", angle), key.replace("*", angle), ".4f")
        for angle in ANGLES
        for label, key in (
            ("* [urad]", "*_rms_urad"),
            ("  linear model", "predicted_*_rms_urad"),
            ("  detector", "*_measured_rms_urad"),
            ("  paper", "paper_*_rms_urad"),
            ("  mismatched", "mismatched_*_rms_urad"),
            ("    predicted", "mismatched_predicted_*_rms_urad"),
        )
    ),
    ("input [%]", "largest_input_percent", ".3f"),
    *((f"peak {' ['.join(key.rsplit('_', 1))}]", key, ".3f") for key in MOTIONS),
    ("closure [m]", "closure_residual_max_m", ".1e"),
)
"""Labels, keys and formats of the rows of the printed Table I."""


def printed(columns: pd.DataFrame, *names: str, cut: bool) -> pd.DataFrame:
    """Return runs in the paper's arrangement: a row for each quantity, a column for each run.

    If the runs are only part of the spiral (`cut`), the paper's numbers are left out.
    """
    selected = columns.set_index("name", drop=False).loc[list(names)]
    selected = selected.join(pd.DataFrame([*selected.secondary_peak], selected.index))
    selected["largest_input_percent"] = selected.strut_input_rms_percent.map(max)
    return pd.DataFrame(
        {"quantity": label}
        | {name: "" if pd.isna(x) else format(x, digits) for name, x in selected[key].items()}
        for label, key, digits in NUMBERS
        if selected[key].notna().any() and not (cut and key.startswith("paper"))
    )


def printed_tables(
    columns: pd.DataFrame, further: pd.DataFrame, loops: pd.DataFrame, settings: Mapping[str, Any]
) -> list[TableView]:
    """Return the printed tables."""
    cut, other_rows = metrics.is_cut(settings), columns[columns.origin == "other"]
    tables = [
        TableView(
            f"Table I, {settings['configuration']}: RMS of desired minus true angle, "
            f"{settings['duration_s']:g} s of the spiral",
            printed(columns, *BY_NAME, cut=cut),
            " ".join(["quantity", *BY_NAME]).replace("W_a_unc", "W_a_uncorrected=unc"),
            "Strut 1 is locked in the last three columns; uncorrected is W_a. Detector: desired "
            "minus measured angle, as in the paper. Mismatched: on another plant.",
        ),
        TableView(
            "Further runs: difference from the table, or from the prediction",
            further,
            "runs largest_rms_difference_urad:.1e largest_relative_difference:.3f "
            "closure_residual_max_m=closure_residual_m:.1e",
        ),
        TableView(
            "Pointing loops",
            loops,
            "angle crossover_hz:.2f gain_margin_db:.1f phase_crossover_hz:.1f phase_margin_deg:.1f",
        ),
    ]
    if len(other_rows):
        title = f"Controller {other_rows.controller.iloc[0]}: the same failures and the same noise"
        table = printed(columns, *other_rows.name, cut=cut)
        tables.insert(1, TableView(title, table, " ".join(table.columns)))
    return tables


def record(
    rig: Rig,
    settings: Mapping[str, Any],
    checked: Sequence[Check],
    machine_file: Path | None,
    row: Mapping[str, Any],
    run: Run,
    folder: Path,
) -> None:
    """Write the data and the recording of a column."""
    name, controller, urad = row["name"], row.get("controller"), dict[str, list[float]]()
    if not controller:
        urad["linear model"] = [row[key] for key in of_angles("predicted_*_rms_urad")]
        if not metrics.is_cut(settings):  # the paper's numbers are of the whole spiral
            urad["paper"] = [row[key] for key in of_angles("paper_*_rms_urad")]
    predicted = [1e-6 * value for value in urad["linear model"]] if urad else None
    known = "uncorrected" if "uncorrected" in name else "corrected"
    locked = ", ".join(f"strut {k + 1} locked, {known}" for k in row["locked"]) or "no failure"
    how = f"controller {controller}" if controller else f"{settings['jacobian']} Jacobian"
    text = f"seed {settings['seed']}, {settings['duration_s']:g} s, {how}; {locked}."
    chosen = "locked", "free", "joint_weight", "secondary_weight_t_x_t_y_t_z_gamma", "controller"
    # The viewer uses one layout for all recordings of an identity.
    parts = "table1", settings["configuration"], name, f"seed{settings['seed']}"
    about = About(
        study="table1",
        identity="-".join(part for part in parts if part != "calibrated"),
        title=name,
        notes=[f"Column {name} of Table I: {text}", *filter(None, [row.get("failure")])],
        parameters=metrics.recording_properties(dict(settings))
        | {key: row[key] for key in chosen if row.get(key)},
        compared=urad,
        predicted=(predicted, predicted),
        checks=checked,
    )
    path, arrays = folder / row["recording"], hexapod_arrays(run)
    write_run(path, rig, run, about, arrays=arrays, known=known, machine_file=machine_file)


SECONDARY = (
    ("$t_x$, µm", 1, BLUE),
    ("$t_y$, µm", 2, SKY),
    ("$t_z$, µm", 3, ORANGE),
    ("$\\gamma$, µrad", 0, PURPLE),
)
"""Label, column of `secondary`, and colour of the motions, in the order of the paper's weights."""
ERROR, ERRORS = "error: desired minus true", ("$\\alpha$ error, µrad", "$\\beta$ error, µrad")


def pictures(runs: Mapping[tuple[str, str], Run], controller: str | None) -> list[Picture]:
    """Return the summary figure, Figures 4 to 6, and with another controller one of both."""
    own_runs = {name: run for (kind, name), run in runs.items() if kind == "own"}
    other_runs = {name: run for (kind, name), run in runs.items() if kind == "controller"}
    result = [
        Picture(
            "result",
            "Effect of the reconfiguration and of the secondary weights, in simulation.",
            "Left, the pointing error with strut 1 locked: that of six healthy struts after "
            "reconfiguration, larger without. Right, t_x: almost zero with ten times the weight.",
            partial(figure_result, own_runs),
        ),
        Picture(
            "figure4",
            "The paper's Fig. 4: weighted strut displacements minimized.",
            "The spiral of the pointing error is the same under W_a, W_b and W_c. Inputs of struts "
            "1, 3, 5 are small under W_b, of 2, 4, 6 under W_c.",
            partial(figure_4, own_runs),
        ),
        Picture(
            "figure5",
            "The paper's Fig. 5: strut 1 locked, mapping not reconfigured.",
            "A spiral of the detector reading and the desired one. Errors of both angles are "
            "larger than those of six healthy struts.",
            partial(figure_5, own_runs),
        ),
        Picture(
            "figure6",
            "The paper's Fig. 6: strut 1 locked, mapping reconfigured, secondary motion minimized.",
            "The spiral of the pointing error is the same under W_d and W_e. Under W_e t_x and t_y "
            "almost vanish, and t_z and gamma are larger than under W_d.",
            partial(figure_6, own_runs),
        ),
    ]
    if controller:
        caption = f"This project's controller and {controller}, under the same failures and noise."
        alt = "Pointing error over time under both controllers; one panel for each failure."
        plot = partial(figure_controller, own_runs, other_runs, controller)
        result.append(Picture("controller", caption, alt, plot))
    return result


def figure_result(runs: Mapping[str, Run]) -> Figure:
    """Plot the size of the pointing error over time, and t_x with two weights."""
    figure = new_figure(PAGE_IN, 3.0)
    left, right = figure.subplots(1, 2)
    for name, case, style in (
        ("W_a_uncorrected", "strut 1 locked, mapping not reconfigured", {"color": VERMILION}),
        ("W_a", "six healthy struts", {"color": BLACK}),
        ("W_e", "strut 1 locked, mapping reconfigured", {"color": BLUE, "ls": "--"}),
    ):
        size_urad = np.linalg.norm(1e6 * runs[name].error, axis=1)
        label = f"{case}: RMS {rms(size_urad):.1f} µrad"
        left.plot(runs[name].time_s, size_urad, label=label, **style)
    left.set(title="Major task: pointing along a spiral", ylabel="pointing error, µrad")
    for name, color, case in (
        ("W_d", ORANGE, "$W_d$, all secondary motions weighted equally"),
        ("W_e", BLUE, "$W_e$, $t_x$ and $t_y$ weighted ten times"),
    ):
        t_x_um = 1e6 * secondary(runs[name])[:, 1]
        label = f"{case}: peak {abs(t_x_um).max():.3g} µm"
        right.plot(runs[name].time_s, t_x_um, color=color, label=label)
    right.set(title="Secondary motion, strut 1 locked", ylabel="translation $t_x$, µm")
    for axes in (left, right):
        over_time(axes, runs["W_a"])
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False)
    return figure


def figure_4(runs: Mapping[str, Run]) -> Figure:
    """Plot the pointing error and the strut inputs for W_a, W_b and W_c."""
    names = "W_a", "W_b", "W_c"
    figure, limit_urad = new_figure(PAGE_IN, 4.4), largest_urad(runs[name] for name in names)
    errors, inputs = figure.subplots(2, len(names), height_ratios=[1.2, 1], sharey="row")
    for name, plane, axes in zip(names, errors, inputs, strict=True):
        error_plane(plane, runs[name], limit_urad, name)
        for k, current in enumerate(runs[name].inputs.T):
            label, color = ("struts 2, 4, 6", ORANGE) if k % 2 else ("struts 1, 3, 5", BLUE)
            axes.plot(runs[name].time_s, current, lw=0.6, color=color, label=label)
        over_time(axes, runs[name])
    errors[0].set_ylabel(ERRORS[1])
    inputs[0].set_ylabel("strut input, %")
    one_legend(figure, 3)
    return figure


def figure_5(runs: Mapping[str, Run]) -> Figure:
    """Plot the spiral, and its errors, with strut 1 locked and the mapping of six struts."""
    run, healthy = runs["W_a_uncorrected"], runs["W_a"]
    figure, limit_urad = new_figure(COLUMN_IN, 5.4), largest_urad([run, healthy])
    spiral, *errors = figure.subplots(3, 1, height_ratios=[2.6, 1, 1])
    spiral.plot(*(1e6 * run.measured).T, color=MEASURED, lw=0.6, label="detector")
    spiral.plot(*(1e6 * run.desired).T, color=DESIRED, lw=0.6, ls="--", label="desired")
    spiral.plot(*(1e6 * run.desired[0]), "o", color=START, ms=4, label="start")
    spiral.set(title="strut 1 locked, no correction", aspect="equal")
    spiral.set(xlabel="$\\alpha$, µrad", ylabel="$\\beta$, µrad")
    for k, axes in enumerate(errors):
        axes.plot(run.time_s, 1e6 * run.error[:, k], color=GREEN, lw=0.8, label=ERROR)
        label, style = "six healthy struts, $W_a$", {"color": BLACK, "lw": 0.6, "ls": ":"}
        axes.plot(healthy.time_s, 1e6 * healthy.error[:, k], label=label, **style)
        axes.set_title(f"RMS {1e6 * run.rms()[k]:.2f} µrad", loc="left")
        over_time(axes, run)
        axes.set(ylabel=ERRORS[k], ylim=(-limit_urad, limit_urad), xlabel="time, s" * k)
    one_legend(figure, 2)
    return figure


def figure_6(runs: Mapping[str, Run]) -> Figure:
    """Plot pointing error and secondary motion for W_d and W_e, strut 1 locked and known."""
    names = "W_d", "W_e"
    figure, limit_urad = new_figure(PAGE_IN, 4.2), largest_urad(runs[name] for name in names)
    moved = {name: 1e6 * secondary(runs[name]) for name in names}
    largest = 1.1 * max(abs(motion).max() for motion in moved.values())
    grid = figure.subplots(len(names), 3, width_ratios=[0.8, 1, 1])
    for name, (plane, *panels) in zip(names, grid, strict=True):
        error_plane(plane, runs[name], limit_urad, name)
        plane.set_ylabel(ERRORS[1])
        for panel, motions in zip(panels, (SECONDARY[:2], SECONDARY[2:]), strict=True):
            for label, column, color in motions:
                panel.plot(runs[name].time_s, moved[name][:, column], color=color, label=label)
            over_time(panel, runs[name])
            panel.set(title=f"$W_{name[-1]}$, strut 1 locked", ylim=(-largest, largest))
        panels[0].set_ylabel("displacement, µm")
        panels[1].set_ylabel("displacement, µm or µrad")
    one_legend(figure, 5)
    return figure


def figure_controller(
    own_runs: Mapping[str, Run], other_runs: Mapping[str, Run], controller: str
) -> Figure:
    """Plot the pointing error over time with both controllers."""
    figure = new_figure(PAGE_IN, 2.6)
    titles = "no failure", "strut 1 locked, known", "strut 1 locked, not known"
    panels = figure.subplots(1, len(other_runs), sharey=True)
    for name, title, axes in zip(other_runs, titles, panels, strict=True):
        for label, runs, color in (
            ("prioritized mapping", own_runs, BLACK),
            (controller.partition(":")[2], other_runs, VERMILION),
        ):
            error_urad = 1e6 * np.linalg.norm(runs[name].error, axis=1)
            axes.plot(runs[name].time_s, error_urad, color=color, lw=0.7, label=label)
        axes.set(title=title, xlabel="time, s")
    panels[0].set_ylabel("pointing error, µrad")
    one_legend(figure, 2)
    return figure


def error_plane(axes: Axes, run: Run, limit_urad: float, name: str) -> None:
    """Plot the error of beta over that of alpha."""
    alpha_urad, beta_urad = 1e6 * run.rms()
    axes.plot(*(1e6 * run.error).T, color=GREEN, lw=0.6, label=ERROR)
    axes.set(title=f"$W_{name[-1]}$: RMS {alpha_urad:.2f} and {beta_urad:.2f} µrad", aspect="equal")
    axes.set(xlim=(-limit_urad, limit_urad), ylim=(-limit_urad, limit_urad), xlabel=ERRORS[0])


def over_time(axes: Axes, run: Run) -> None:
    """Set the time axis to the whole run."""
    end_s = round(float(run.time_s[-1]))
    axes.set(xlim=(0, end_s), xticks=range(0, end_s + 1, 4 if end_s > 8 else 1), xlabel="time, s")


def largest_urad(runs: Iterable[Run]) -> float:
    """Return the limit [urad] of an error axis for several runs."""
    return 1.1 * max(abs(1e6 * run.error).max() for run in runs)
