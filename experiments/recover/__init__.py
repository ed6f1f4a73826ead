"""Study `recover`: unannounced failures and events; docs/recover.md."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd

from experiments.recover import plan, predictions
from experiments.recover.figure import pictures
from experiments.recover.plan import BENCH, Case, exact_rig, sizes_of
from experiments.recover.row import (
    COLUMNS,
    LATE_FAILURES,
    dither_cost,
    informed_late,
    row_of,
    simulate,
    simulate_other,
)
from experiments.recover.tables import WORST, checks, grouped, noise_of, notes, printed_tables
from experiments.study import HERE, Row, Where, basis_of, rows_of
from fjh.recording.record import About, write_run
from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.events import EVENTS
from fjh.rig.hexapod.columns import hexapod_arrays
from fjh.rig.hexapod.fault_tolerance import DITHER
from fjh.rig.hexapod.metrics import plant_constants, recording_properties
from fjh.rig.mismatch import EXACT
from fjh.rig.options import DEFAULT_OPTIONS, Controller, RobotOptions, check_bounds
from fjh.rig.other_controller import controller_factory, controller_label, controller_sha256
from fjh.rig.rig import Rig
from fjh.rig.run import Run
from fjh.rig.units import by_unit
from fjh.rig.within import check_within
from fjh.study.errors import WrongInput
from fjh.study.input_checks import check_file
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.result import Check, Result, origin
from fjh.study.workers import call, in_parallel
from ftc.fdi import DEFAULT_CONFIG
from sim import CLOSURE_TOLERANCE, Failure
from sim.mjcf import model_sha256

HOURS, TURN_S = 2.0, 4.0
"""Default hours without failures, and default duration of a turn of another robot's circle [s]."""
OF_TRACK = Option("Same as in `fjh track`.", listed=False)

RECORDED = {
    "locked": (Failure(0, "locked", 8.25),),
    "free": (Failure(0, "free", 8.25),),
    "cascade": (
        Failure(0, "locked", 4.0),
        Failure(3, "free", 6.0),
        Failure(1, "locked", 8.0),
        Failure(4, "locked", 10.0),
    ),
}
"""Failures of the recorded runs, by name. After the cascade only struts 3 and 6 work, which act in
one direction of the (alpha, beta) plane."""


def recover(
    *,
    seed: Annotated[int, seed_of("the random failures and plants, and the detector noise")] = 0,
    quick: Annotated[bool, Option(help="Only a few runs of each sort.")] = False,
    model: Annotated[
        Path | None,
        Option("MJCF file of another robot, on a circle; takes options of fjh track.", "MODEL.xml"),
    ] = None,
    hours: Annotated[
        float, Option(metavar="H", help="Hours to simulate without failures; fewer with --quick.")
    ] = HOURS,
    events: Annotated[
        bool, Option(help="Simulate events other than failures (docs/recover.md): 15 minutes.")
    ] = False,
    controller: Controller = None,
    where: Where = HERE,
    robot: Annotated[RobotOptions, OF_TRACK] = DEFAULT_OPTIONS,
    turn: Annotated[float, OF_TRACK] = TURN_S,
    dither: Annotated[str, OF_TRACK] = "designed",
    folder: Path,
    on_progress: OnProgress,
) -> Result:
    """Simulate unannounced actuator failures; measure detection, isolation and recovery.

    Struts lock, or lose coil force, at random times, on plants that differ from the controller's
    model. The supervisor is compared with a controller that is informed at once, and with one
    without diagnosis. Takes half an hour on two cores, half a minute with --quick; --events and
    --model simulate other cases instead. After Ctrl-C, --resume continues.

    Writes recover.json, the rows as recover.parquet, tables, a figure, some runs and recordings.

    Example: fjh paper recover --quick --seed 3
    """
    check_within("hours", hours, 1e-3, 1e6)
    check_bounds("turn", turn)
    of_hexapod = {"hours": hours != HOURS, "controller": controller, "scheduler": where.scheduler}
    of_robot = {"turn": turn != TURN_S, "dither": dither != "designed"}
    of_robot |= {f.name: getattr(robot, f.name) != f.default for f in fields(RobotOptions)}
    refuse_others(of_hexapod, of_robot, is_robot=model is not None, events=events)
    if controller is not None:
        controller_factory(controller)  # raises for a wrong name, before anything runs
    jobs = list[Job]()
    if model is None:
        sampling = hexapod_basis(seed, quick, events, controller)
        cases = plan.hexapod_cases(sampling, 1 if quick else plan.healthy_for(hours))
        jobs = [] if events else additional_jobs(cases[0], controller, seed, quick)
        dithers = {"task": asdict(DITHER)}
    else:
        file = check_file(model).resolve()
        names = () if not events else plan.QUICK_ROBOT_EVENTS if quick else tuple(EVENTS)
        how = {"turn_s": turn, "dither": dither, "seed": seed, "quick": quick}
        sampling = {"robot": asdict(robot), "robot_sha256": model_sha256(file), **how}
        sampling |= {"events": names} if events else {}
        cases, dithers = plan.robot_cases(file, robot, events=names, **how)

    def progress(first: int) -> OnProgress:
        return lambda done, _: on_progress(first + done, len(cases) + len(jobs))

    basis, rig = basis_of(**sampling), exact_rig(cases[0].model, cases[0].options)
    rows = rows_of(
        cases, row_of, basis, where, name="recover", folder=folder, on_progress=progress(0)
    )
    rows = rows.reindex(columns=[*dict.fromkeys((*COLUMNS, *rows))])
    rows_by_table = {name: list[Any]() for name, _ in jobs}
    results = in_parallel(call, [{"work": work} for _, work in jobs], progress(len(cases)))
    for (name, _), entries in zip(jobs, results, strict=True):
        rows_by_table[name] += entries
    recorded, noise = rows_by_table.pop("shown", []), noise_of(rig)
    rows_by_table |= {"shown": [row for row, _ in recorded]} if recorded else {}
    tables = grouped(rows, noise)
    tables |= {name: pd.DataFrame(entries) for name, entries in rows_by_table.items()}
    if controller is not None:
        tables["controller"] = controller_table(controller, rows, tables["shown"])
    settings = settings_of(rig, dithers, cases, basis) | {"sorts": dict(Counter(rows.sort))}
    checked = checks(settings, rows, tables)
    return Result(
        settings,
        tables,
        checked,
        printed_tables(tables),
        notes(rows, tables),
        pictures(rows, tables, noise),
        records=[partial(record, settings, checked, row, run) for row, run in recorded],
        rows=rows,
    )


def refuse_others(
    hexapod: Mapping[str, Any], robot: Mapping[str, Any], *, is_robot: bool, events: bool
) -> None:
    """Check that no option for other cases is given; the mappings are true for changed options.

    Raises:
        WrongInput: An option for other cases is given.
    """
    others = hexapod if is_robot else robot
    for name in (name for name, is_given in others.items() if is_given):
        relation = "cannot be used with" if is_robot else "needs"
        raise WrongInput(f"--{name.replace('_', '-')} {relation} --model")
    if robot["sense"]:
        raise WrongInput("--sense cannot be used with --model: all sensings are simulated")
    for name in ("hours", "controller") if events else ():
        if hexapod[name]:
            raise WrongInput(f"--{name} cannot be used with --events")
    if hexapod["controller"] and hexapod["scheduler"]:
        raise WrongInput("--controller is imported on this computer alone: omit --scheduler")


def hexapod_basis(seed: int, quick: bool, events: bool, controller: str | None) -> dict[str, Any]:
    """Return the parameters from which failures or events of the hexapod are sampled."""
    if events:
        names, count = (plan.QUICK_EVENTS, 1) if quick else (tuple(EVENTS), plan.EVENTS_EACH)
        healthy_s = 2.0 if quick else 600.0
        return {"seed": seed, "events": {"names": names, "each": count, "healthy_s": healthy_s}}
    blocks, healthy_s = (plan.QUICK, 2.0) if quick else (plan.WHOLE, BENCH.duration_s)
    failures_basis = {"blocks": blocks, "healthy_s": healthy_s, "controller": controller}
    own = {} if controller is None else {"controller_sha256": controller_sha256(controller)}
    return {"seed": seed, "flights": failures_basis} | own


Job = tuple[str, Callable[[], list[Any]]]
"""Name of a table, and a function that makes rows of the table on a worker."""


def additional_jobs(first: Case, controller: str | None, seed: int, quick: bool) -> list[Job]:
    """Return further analyses of the hexapod, fewer with --quick."""
    count, controllers = 1 if quick else None, dict.fromkeys((None, controller))
    struts, late = range(6)[:count], () if quick else LATE_FAILURES
    names, settings = [*RECORDED][:count], [*predictions.SETTINGS][:count]
    jobs: list[Job] = [
        *(("shown", partial(recorded_run, n, seed, quick, c)) for c in controllers for n in names),
        *(("informed_late", partial(informed_late, failure)) for failure in late),
        *(("ambiguity", partial(predictions.ambiguity_rows, name, struts)) for name in settings),
        ("dither_cost", partial(dither_cost, first, 1.0 if quick else BENCH.duration_s)),
        ("beliefs", partial(predictions.stability_rows, struts)),
    ]
    return jobs if quick else [("dither_design", predictions.dither_design), *jobs]


def recorded_run(
    name: str, seed: int, quick: bool, controller: str | None
) -> list[tuple[Row, Run]]:
    """Simulate a recorded run with all mismatches; return its row and the run.

    The run is the spiral from its start or, if `quick`, from shortly before the failures.
    """
    begin_s = RECORDED[name][0].time_s - plan.BEFORE_S if quick else 0.0
    duration_s = RECORDED[name][-1].time_s + 2.0 - begin_s
    case = Case("pair", plant_seed=seed, seed=seed, dither=plan.about(0.0), failures=RECORDED[name])
    case = replace(case, begin_s=begin_s, duration_s=duration_s, controller=controller)
    row, run = simulate(case) if controller is None else simulate_other(case, controller)
    label = name if controller is None else f"{controller_label(controller)}_{name}"
    row["closure_residual_max_m"] = run.closure_max_m
    return [({"name": label, "controller": controller} | case.parameters() | row, run)]


def controller_table(name: str, rows: pd.DataFrame, recorded: pd.DataFrame) -> pd.DataFrame:
    """Return a summary of another controller in cases with all mismatches and recorded runs."""
    simulated, others = rows[rows.rms_other_after.notna()], recorded[recorded.controller.notna()]
    square = [(simulated[f"rms_{who}_after"] ** 2).mean() for who in ("other", "informed")]
    failures = [*simulated.controller_failure.dropna(), *others.controller_failure.dropna()]
    counts = {"runs": len(simulated) + len(others), "failed": len(failures)}
    over = {"name": name, "after_over_informed": np.sqrt(square[0] / square[1])}
    return pd.DataFrame([over | counts | {"failure": [*failures, None][0]}])


def settings_of(
    rig: Rig, dithers: Mapping[Any, Any], cases: Sequence[Case], basis: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the settings; errors are in sizes of the path, other units are in the names."""
    sizes = {case.mismatch: asdict(sizes_of(rig, case.mismatch)) for case in cases}
    settings = origin(basis["seed"]) | {
        "basis": basis,
        "runs": len(cases),
        "robot": rig.title,
        "actuators": rig.actuators,
        "major": rig.major,
        "path_size": rig.size,
        **by_unit("path_size", rig.size, rig.row_units),
        **by_unit("sensor_noise", rig.noise, rig.row_units),
        **by_unit("encoder_noise", rig.encoder_noise, rig.units),
        "control_period_s": rig.period_s,
        "mismatch": {
            name: {key: size for key, size in own.items() if size != getattr(EXACT, key)}
            for name, own in sizes.items()
        },
        "rules": asdict(DEFAULT_CONFIG),
        "dither": dithers,
        "recovered_from_s": max(case.recovered_s for case in cases),
        "noise": noise_of(rig),
        "worst_allowed": WORST,
        "separation_required": predictions.ISOLABLE,
        "alike_below": predictions.AMBIGUOUS,
        "evidence_s": predictions.EVIDENCE_S,
        "closure_limit_m": CLOSURE_LIMIT_M if rig.file is None else CLOSURE_TOLERANCE,
    }
    if rig.file is None:
        bench = asdict(BENCH) | plant_constants(rig.model)
        return settings | {"bench": bench, "jacobian": "constant"}
    return settings | {"model_sha256": basis["robot_sha256"]}


def record(
    settings: Mapping[str, Any], checks: Sequence[Check], row: Row, run: Run, folder: Path
) -> None:
    """Write the data and the recording of a run."""
    name, controller = row["name"], row["controller"]
    own = {} if controller is None else {"controller": controller}
    about = About(
        study="recover",
        identity=f"recover-{name}-seed{settings['seed']}",
        title=name,
        notes=["The failures are unannounced, and the plant differs from the model."],
        parameters=recording_properties(dict(settings)) | own,
        checks=checks,
        summary=row.get("controller_failure") or "",
    )
    write_run(folder / f"{name}.rrd", exact_rig(), run, about, arrays=hexapod_arrays(run))


def repeatable_runs(
    summary: Mapping[str, Any],
) -> tuple[tuple[Case, ...], Callable[[Case], tuple[Row, Run]]]:
    """Return the runs of a `recover.json`, and the function that repeats one.

    Runs of another controller are not repeated, since the dataset lacks their columns.

    Raises:
        WrongInput: The runs are of another robot, whose file is not among the results.
    """
    basis = summary["basis"]
    if "robot" in basis:
        raise WrongInput("runs of another robot cannot be repeated without its file")
    return plan.hexapod_cases(basis, summary["sorts"].get("healthy", 0)), simulate
