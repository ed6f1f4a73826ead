"""Study `release`: a strut without coil force, or without coil and spring; docs/theory.md."""

from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from fjh.recording.record import About, write_run
from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, hexapod_arrays, secondary
from fjh.rig.hexapod.controller import ANGLES
from fjh.rig.hexapod.fault_tolerance import elastic_system, strut_and_payload_stiffness
from fjh.rig.hexapod.metrics import (
    percent,
    plant_constants,
    prediction_tolerance,
    recording_properties,
)
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.prediction import loop_peak
from fjh.rig.rig import Rig
from fjh.rig.run import Run
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, GREEN
from fjh.study.plotting import DESIRED, MEASURED, PAGE_IN, START, new_figure
from fjh.study.result import Check, Picture, Result, TableView, check, origin
from fjh.study.workers import call, in_parallel
from ftc import Goal
from ftc.fdi import Fault, fault_model
from prioritized import Classes, FailureAtlas, failure_atlas
from sim import Array, Failure, Plant, linearize, load_model
from sim.mjcf import weightless
from sim.plant import FailureKind

STRUT = 0  # that fails, strut 1 as in the paper
RATIOS = tuple(10.0**k for k in range(3, -4, -1))  # stiffness of its suspension / its flexures
COMMAND_RAD = np.array([100e-6, 0.0])  # of the payload at rest
SETTLING_S = 8.0  # more than ten time constants of the softest motion: 110 N s/m on 197 N/m
MISMATCH_LIMIT_PERCENT = 1.0  # largest difference between simulated and predicted motion

EQUAL = Goal(joint_weight=(1.0,) * 6)
GOALS: dict[FailureKind, dict[str, Goal]] = {
    "free": {"uncorrected": EQUAL, "corrected": replace(EQUAL, free=(STRUT,))},
    "loose": {
        "uncorrected": EQUAL,
        "corrected": replace(EQUAL, spring_lost=(STRUT,)),
        "as_locked": replace(EQUAL, locked_at={STRUT: 0.0}),
    },
}
"""Goals of the mapping, by failure and correction: none; for the failure, with springs that
determine the strut's position; or as for a strut that its damper holds at the centre."""


@dataclass(frozen=True)
class Case:
    """Parameters of a spiral: failure of strut 1, its time, correction of the mapping."""

    name: str
    kind: FailureKind | None = None
    time_s: float = 0.0
    correction: str = "uncorrected"
    goal: Goal = EQUAL

    @property
    def failures(self) -> list[Failure]:
        """Failures of the plant."""
        return [] if self.kind is None else [Failure(STRUT, self.kind, self.time_s)]


def cases(half_s: float) -> list[Case]:
    """Return all spirals: healthy; strut 1 failed at the start or at `half_s`, all corrections."""
    times_s = {"from_start": 0.0, "in_flight": half_s}
    return [Case("healthy")] + [
        Case(f"{kind}_{when}_{correction}", kind, time_s, correction, goal)
        for kind, (when, time_s) in product(GOALS, times_s.items())
        for correction, goal in GOALS[kind].items()
    ]


class Spiral(NamedTuple):
    """Simulated spiral, with its row and the payload twists (N, 6) predicted from its inputs."""

    case: Case
    run: Run
    row: dict[str, Any]
    linear: Array
    quasi_static: Array
    plant: dict[str, Any]


def simulate(rig: Rig, case: Case, path: Array, seed: int) -> Spiral:
    """Simulate a spiral, and predict its motion by the linear model and the elastic mapping.

    Raises:
        sim.SimulationDiverged: The state is not finite.
    """
    is_known = case.goal != EQUAL
    controller = rig.reconfigured(EQUAL, case.goal, case.time_s) if is_known else rig.controller()
    run = rig.fly(controller, path, failures=case.failures, seed=seed)
    command_m = rig.control.testbed.amplifier().displacements(run.inputs)
    faults = [Fault.of(failure) for failure in case.failures]
    # Lost coils or springs do not change the loop closures: the state is continuous.
    onset = int(np.searchsorted(run.time_s, case.time_s))
    before = fault_model(rig.nominal).states(command_m[:onset])
    after = fault_model(rig.nominal, faults).states(command_m[onset:], before[-1])
    linear = np.concatenate([before[:-1], after[:-1]]) @ Plant(rig.model).linear().C_twist.T
    static = command_m @ elastic_system(rig.model).kinematics().J.T
    if case.kind is not None:
        soft = {STRUT: 0.0} if case.kind == "loose" else {}
        failed = elastic_system(rig.model, soft).with_failures(free=[STRUT]).kinematics()
        static[onset:] = command_m[onset:][:, failed.actuators] @ failed.J.T
    twist, plant = true_twist(run), plant_constants(rig.model)
    row: dict[str, Any] = {
        "name": case.name,
        "kind": case.kind,
        "failure_time_s": case.time_s if case.kind else None,
        "told": case.correction,
        "duration_s": len(path) * rig.period_s,
        **{key: plant[key] for key in ("gravity_m_per_s2", "suspension_preload_n")},
    }
    predicted_rad = np.full(2, np.nan)
    if case.time_s == 0.0:
        predicted_rad = rig.predict(path, failures=case.failures, told=False, goal=case.goal).rms
    for k, angle in enumerate(ANGLES):
        row[f"{angle}_rms_urad"] = 1e6 * run.rms()[k]
        row[f"predicted_{angle}_rms_urad"] = 1e6 * predicted_rad[k]
        row[f"{angle}_peak_urad"] = 1e6 * np.abs(run.error[:, k]).max()
    row |= {
        "sensitivity_peak": loop_peak(rig, case.goal, faults),
        "motion_mismatch_linear_model_percent": percent(twist - linear, twist),
        "motion_mismatch_quasi_static_percent": percent(twist - static, twist),
        "strut_1_peak_um": 1e6 * np.abs(run.displacement[:, STRUT]).max(),
        "closure_residual_max_m": run.closure_max_m,
        "recording": f"{case.name}.rrd",
        "data": f"{case.name}.npz",
    }
    return Spiral(case, run, row, linear, static, plant)


def true_twist(run: Run) -> Array:
    """Return the true payload motion [alpha, beta, gamma, t_x, t_y, t_z], shape (N, 6)."""
    return np.hstack([run.true, secondary(run)])


# The payload at rest.


def equilibrium_row(model: mujoco.MjModel, ratio: float) -> dict[str, Any]:
    """Return the row of the payload at rest for alpha = 100 urad, with strut 1 without coil force.

    Args:
        model: Hexapod without gravity.
        ratio: Stiffness of strut 1's suspension over the lateral stiffness of its two flexures.
    """
    geometry = hexapod(model)
    length_m = np.linalg.norm((geometry.top_m - geometry.bottom_m)[STRUT])
    bends = [model.joint(f"{end}_bend_x{STRUT + 1}").id for end in ("bottom", "top")]
    lateral_n_per_m = model.jnt_stiffness[bends].sum() / length_m**2
    soft = {STRUT: ratio * lateral_n_per_m}
    failed = elastic_system(model, soft).with_failures(free=[STRUT]).kinematics()
    healthy = elastic_system(model).kinematics()
    uncorrected = healthy.velocity_mapping(MAJOR, joint_weight=np.ones(6))(COMMAND_RAD)
    remapped = failed.expand(failed.velocity_mapping(MAJOR, joint_weight=np.ones(6))(COMMAND_RAD))
    others, column = uncorrected[failed.actuators], healthy.J[:, STRUT]
    strut = list(failed.passive).index(healthy.active[STRUT])

    def released() -> Plant:
        plant = Plant(model)
        plant.release(STRUT)
        plant.model.jnt_stiffness[model.actuator_trnid[STRUT, 0]] = soft[STRUT]
        return plant

    # Here coils are forces against springs, so that struts with coils are compliant.
    linear = linearize((plant := released()).model, plant.data)
    predicted = {
        "elastic": failed.J @ others,
        "linear_model": -linear.C_twist @ np.linalg.solve(linear.A, linear.B @ uncorrected),
        "as_if_locked": np.delete(healthy.J, STRUT, axis=1) @ others,
    }
    twist, extension_m = settle(plant, uncorrected)
    corrected, _ = settle(released(), remapped)
    error = {name: percent(twist - value, twist) for name, value in predicted.items()}
    return {
        "suspension_over_swing": ratio,
        "suspension_n_per_m": soft[STRUT],
        "swing_n_per_m": lateral_n_per_m,
        # Of all flexures for a change of the strut's length, the other struts fixed.
        "all_flexures_n_per_m": column @ strut_and_payload_stiffness(model)[6:, 6:] @ column,
        "alpha_simulated_urad": 1e6 * twist[0],
        **{f"alpha_{name}_urad": 1e6 * value[0] for name, value in predicted.items()},
        "strut_1_simulated_um": 1e6 * extension_m,
        "strut_1_elastic_um": 1e6 * failed.passive_rates(others)[strut],
        **{f"mismatch_{name}_percent": value for name, value in error.items()},
        "alpha_corrected_urad": 1e6 * corrected[0],
        "beta_corrected_urad": 1e6 * corrected[1],
        "worst_gain_rad_per_m": failed.manipulability(MAJOR).worst_gain,
    }


def ground_row(model: mujoco.MjModel) -> dict[str, Any]:
    """Return the row of the equilibrium with gravity after strut 1 has lost spring and preload."""
    plant = Plant(model)
    plant.break_loose(STRUT)
    twist, extension_m = settle(plant, np.zeros(6))
    return {
        "strut_1_um": 1e6 * extension_m,
        "stop_um": 1e6 * model.jnt_range[model.joint(f"strut{STRUT + 1}").id, 0],
        "alpha_urad": 1e6 * twist[0],
        "beta_urad": 1e6 * twist[1],
    }


def settle(plant: Plant, command_m: Array) -> tuple[Array, float]:
    """Return the payload twist (6,) and the released strut's extension [m] at rest."""
    plant.step(command_m, SETTLING_S)
    return plant.displacement(), float(plant.displacements()[STRUT])


# All 3^6 conditions, with rigid and elastic struts.


def both(atlas: FailureAtlas) -> dict[str, Classes]:
    """Return the classifications of an atlas with rigid and with elastic struts."""
    assert atlas.elastic is not None  # the hexapod has springs
    return {"rigid": atlas, "elastic": atlas.elastic}


def single_failure_row(atlas: FailureAtlas, strut: int, kind: str, struts: str) -> dict[str, Any]:
    """Return the row of a single failure, with what remains of pointing."""
    classes, row = both(atlas)[struts], atlas.row(**{kind: [strut]})
    lost = classes.lost_secondary[row]
    return {
        "strut": strut + 1,
        "kind": kind,
        "struts": struts,
        "possible": classes.possible[row],
        "worst_gain_rad_per_m": classes.worst_gain[row],
        "unstable_major": classes.unstable_major[row],
        "lost_gamma_t_x_t_y_t_z": (lost[:, lost.any(axis=0)].T + 0.0).tolist(),
    }


def atlas_row(atlas: FailureAtlas, struts: str) -> dict[str, Any]:
    """Return the row with the number of conditions in which the hexapod can point."""
    classes = both(atlas)[struts]
    return {
        "struts": struts,
        "conditions": len(atlas.codes),
        "possible": classes.possible.sum(),
        "smallest_gap": classes.gap.min(),
    }


def atlas_arrays(atlas: FailureAtlas) -> dict[str, Array]:
    """Return all classifications as arrays with a row for each condition."""
    arrays = {
        f"{struts}_{field.name}": getattr(classes, field.name)
        for (struts, classes), field in product(both(atlas).items(), fields(Classes))
    }
    # Without limits some fields are None.
    return {"codes": atlas.codes} | {name: A for name, A in arrays.items() if A is not None}


# The study.


def release(
    *,
    seed: Annotated[int, seed_of("the detector noise")] = 0,
    quick: Annotated[bool, Option("Spirals of 4 s, and three values of the stiffness.")] = False,
    on_progress: OnProgress,
) -> Result:
    """Simulate a strut without coil force, then without coil force and spring.

    Strut 1 fails at the start or during the spiral, known or unknown to the mapping. Every spiral
    is compared with the linear model. The payload at rest is compared with the elastic mapping over
    six decades of suspension stiffness. Takes 35 s on two cores, 15 s with --quick.

    A strut without spring has no preload to carry the weight: with gravity it falls to its stop.
    Therefore its spirals, and the payload at rest, are without gravity.

    Writes release.json, its tables as release.md and Parquet, a figure, all 3^6 conditions
    (atlas.npz), and for each spiral its data (.npz) and its recording (.rrd).

    Example: fjh paper release --quick
    """
    ground, testbed = load_model(), nominal_testbed()
    orbit, bench = weightless(ground), testbed.bench
    on_ground = hexapod_rig(replace(testbed, stiffness=strut_and_payload_stiffness(ground)))
    in_orbit = hexapod_rig(replace(on_ground.control.testbed, model=orbit))
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    shared = {"work": simulate, "path": bench.spiral_rad(duration_s), "seed": seed}
    calls = [
        shared | {"case": case, "rig": in_orbit if case.kind == "loose" else on_ground}
        for case in cases(duration_s / 2)
    ]
    at_rest = {"work": equilibrium_row, "model": orbit}
    equilibria = [at_rest | {"ratio": ratio} for ratio in RATIOS[:: 3 if quick else 1]]
    done = in_parallel(call, [*calls, *equilibria], on_progress)
    spirals: list[Spiral] = done[: len(calls)]
    atlas = failure_atlas(elastic_system(ground), MAJOR)
    singles = product(range(6), ("locked", "free"), both(atlas))
    rows = {
        "spirals": [spiral.row for spiral in spirals],
        "sweep": done[len(calls) :],
        "on_the_ground_without_spring": [ground_row(ground)],
        "atlas": [atlas_row(atlas, struts) for struts in both(atlas)],
        "single_failures": [single_failure_row(atlas, *failure) for failure in singles],
    }
    tables = {name: pd.DataFrame(table) for name, table in rows.items()}
    settings = origin(seed) | {
        "jacobian": "constant",
        "duration_s": duration_s,
        "bench": asdict(bench) | plant_constants(ground),
    }
    checked, by_name = checks(**tables), {spiral.case.name: spiral for spiral in spirals}
    return Result(
        settings=settings,
        tables=tables,
        checks=checked,
        views=printed_tables(**tables),
        pictures=[Picture("release", CAPTION, ALT, partial(figure, tables["sweep"], by_name))],
        arrays={"atlas.npz": atlas_arrays(atlas)},
        records=[partial(record, spiral, settings, checked) for spiral in spirals],
    )


def checks(
    spirals: pd.DataFrame,
    sweep: pd.DataFrame,
    on_the_ground_without_spring: pd.DataFrame,
    **_: pd.DataFrame,
) -> list[Check]:
    """Return checks of closure, and of motion, errors and rest positions against predictions."""
    by_name, limit = spirals.set_index("name"), MISMATCH_LIMIT_PERCENT
    equilibria = sweep.set_index(sweep.suspension_over_swing.map("stiffness ratio {:g}".format))
    predicted = by_name.astype({f"predicted_{angle}_rms_urad": float for angle in ANGLES})
    predicted = predicted.dropna(subset="predicted_alpha_rms_urad")
    result = []
    for angle in ANGLES:
        model = predicted[f"predicted_{angle}_rms_urad"]
        error = (predicted[f"{angle}_rms_urad"] - model).abs() / model
        what = f"relative difference between the RMS error of {angle} and the linear model's"
        result += check(what, error, prediction_tolerance(by_name.duration_s.min()))
    for model in ("elastic", "linear_model"):
        what = f"difference between the {model.replace('_', ' ')} and the simulation [%]"
        result += check(what, equilibria[f"mismatch_{model}_percent"], limit)
    motion = by_name[by_name.kind.notna()].motion_mismatch_linear_model_percent
    error = (equilibria.alpha_corrected_urad - 1e6 * COMMAND_RAD[0]).abs()
    fall = on_the_ground_without_spring.loc[0]
    from_stop = 100 * abs(fall.strut_1_um / fall.stop_um - 1)
    return [
        *result,
        *check("difference between the simulated motion and the linear model [%]", motion, limit),
        *check("closure residual [m]", by_name.closure_residual_max_m, CLOSURE_LIMIT_M),
        *check("pointing error of the corrected mapping [%]", error, limit),
        *check("distance of strut 1 from its stop [%]", from_stop, limit, "without its spring"),
    ]


def printed_tables(
    spirals: pd.DataFrame, sweep: pd.DataFrame, **_: pd.DataFrame
) -> list[TableView]:
    """Return the printed tables."""
    return [
        TableView(
            "Strut 1 without coil force: RMS of desired minus true angle",
            spirals,
            "name alpha_rms_urad=alpha_urad:.3f predicted_alpha_rms_urad=predicted_alpha_urad:.3f "
            "beta_rms_urad=beta_urad:.3f predicted_beta_rms_urad=predicted_beta_urad:.3f "
            "alpha_peak_urad:.1f sensitivity_peak:.2f",
            "Free: without coil force. Loose: without coil force and spring, no gravity. "
            "Predicted: by the linear model.",
        ),
        TableView(
            "Alpha reached at rest for a command of 100 urad",
            sweep,
            "suspension_over_swing=stiffness_ratio:.0e alpha_simulated_urad=simulated_urad:.2f "
            "alpha_elastic_urad=elastic_mapping_urad:.2f "
            "alpha_as_if_locked_urad=as_if_locked_urad:.2f alpha_corrected_urad=corrected_urad:.2f",
            "Stiffness of the suspension over that of the flexures. As if locked: predicted for a "
            "strut locked at its centre. Corrected: simulated, failure known to the mapping.",
        ),
    ]


def record(spiral: Spiral, settings: dict[str, Any], checked: list[Check], folder: Path) -> None:
    """Write the data and the recording of a spiral."""
    case, correction = spiral.case, spiral.case.correction.replace("_", " ")
    lost = {None: "no failure", "free": "coil lost", "loose": "coil and spring lost, in orbit"}
    predicted_rad = np.array([spiral.row[f"predicted_{angle}_rms_urad"] for angle in ANGLES]) / 1e6
    about = About(
        study="release",
        identity=f"release-{case.name}-seed{settings['seed']}",
        title=case.name,
        notes=[
            f"Seed {settings['seed']}, constant Jacobian, W_a; {lost[case.kind]}, {correction}."
        ],
        parameters=recording_properties(settings) | spiral.plant,
        compared={} if case.time_s else {"linear model": list(1e6 * predicted_rad)},
        predicted=(predicted_rad, predicted_rad),
        checks=checked,
    )
    predictions = {"linear": spiral.linear, "quasi_static": spiral.quasi_static}
    arrays = hexapod_arrays(spiral.run) | predictions
    path = folder / f"{case.name}.rrd"
    write_run(path, hexapod_rig(), spiral.run, about, arrays=arrays, known=correction)


CAPTION = (
    "Strut 1 without its coil force: the payload at rest over six decades of the strut's "
    "suspension stiffness, and two spirals during which strut 1 fails."
)
ALT = (
    "Above: the elastic mapping agrees with the simulation at all stiffnesses; a strut that is "
    "taken as locked disagrees where the suspension is soft. Below: t_x when the coil, or coil "
    "and spring, are lost during the spiral; simulation and linear model coincide."
)
PLOTTED = {
    "free_in_flight_corrected": "coil force",
    "loose_in_flight_corrected": "coil force and spring",
}
"""Parts that strut 1 loses, by name of the spirals in the figure."""


def figure(sweep: pd.DataFrame, spirals: dict[str, Spiral]) -> Figure:
    """Plot the payload at rest over stiffness, and spirals with failures of strut 1."""
    figure, ratio = new_figure(PAGE_IN, 5.2), sweep.suspension_over_swing
    figure.suptitle("Strut 1 without its coil force: springs determine where the payload goes")
    (reached, off), lower = figure.subplots(2, 2)
    reached.axhline(1e6 * COMMAND_RAD[0], color=GREEN, lw=0.8, ls="--", label="commanded")
    for name, label, color, style in (
        ("corrected", "simulated, failure known to the mapping", GREEN, "s"),
        ("as_if_locked", "predicted as if strut 1 were locked", START, ":"),
        ("elastic", "predicted by the elastic mapping", DESIRED, "-"),
        ("simulated", "simulated, failure unknown", MEASURED, "o"),
    ):
        reached.semilogx(ratio, sweep[f"alpha_{name}_urad"], style, color=color, label=label)
    reached.set(title="Payload at rest after a command of 100 µrad", ylim=(0, 110))
    reached.set_ylabel("$\\alpha$, µrad")
    reached.legend(loc="lower right")
    for name, label, color, style in (
        ("as_if_locked", "as if strut 1 were locked", START, "s-"),
        ("elastic", "elastic mapping", DESIRED, "o-"),
        ("linear_model", "linear model, coils as forces", MEASURED, "^-"),
    ):
        off.loglog(ratio, sweep[f"mismatch_{name}_percent"], style, color=color, label=label)
    off.set_title("Error of three predictions of the payload at rest")
    off.set_ylabel("difference from the simulation, %")
    off.legend(loc="center left", bbox_to_anchor=(0, 0.29))
    for axes in (reached, off):
        axes.set_xlabel("strut 1: stiffness of suspension / of flexures")
    for axes, (name, lost) in zip(lower, PLOTTED.items(), strict=True):
        case, run, _, linear, static, _ = spirals[name]
        simulated = 1e6 * true_twist(run)[:, 3]
        axes.plot(run.time_s, simulated, color=MEASURED, lw=2, alpha=0.5, label="simulated")
        axes.plot(run.time_s, 1e6 * linear[:, 3], color=DESIRED, lw=0.6, label="linear model")
        label = "elastic mapping (static)"
        axes.plot(run.time_s, 1e6 * static[:, 3], "--", color=START, lw=0.8, label=label)
        axes.axvline(case.time_s, color=BLACK, lw=0.8, ls=":", label="strut 1 fails")
        axes.set_title(f"Spiral with {lost} lost at {case.time_s:g} s")
        axes.set(xlabel="time, s", ylabel="$t_x$, µm")
        axes.legend(loc="upper left")
    return figure
