"""Study `systems`: simulation of the paper's other mechanisms; docs/theory.md."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import cycle
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from fjh.recording.file import RecordingInfo
from fjh.recording.layout import write_scenes
from fjh.recording.plane import Plane
from fjh.recording.properties import checked, constants
from fjh.recording.scene import Scene, condition_scene
from fjh.recording.signals import Plot
from fjh.rig.classification import classify
from fjh.rig.conditions import FREE, LOCKED, codes_of, condition_text, failed, failures_of
from fjh.rig.units import ROWS
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, LINES
from fjh.study.plotting import PAGE_IN, new_figure
from fjh.study.provenance import version_properties
from fjh.study.result import Check, Picture, Result, TableView, check, origin
from fjh.study.workers import in_parallel
from prioritized import ConstrainedSystem, Kinematics, failure_atlas
from sim import HEXAPOD_MJCF, Array, Plant, jacobians, linearize, load_model
from sim.mjcf import mass_matrix, model_sha256
from sim.plant import failed_plant

STEP = 1e-4  # [m] or [rad]: far above the closures' nanometres, small relative to a hand of 0.1 m
PERIOD_S = 0.01
CORNERS = 8  # of the polygon
PUSH_S, PROBE = 0.05, 1e-6  # a push, and the wrench of the first one, [N] or [N m]
REST = 1e-6  # remaining fraction of a motion that counts as at rest
COASTING_PER_S = 0.01  # decay rate below that of any servo: slower motions coast
# Smallest motion, per commanded step or as a fraction of the displacement after a push: actuators
# at rest move less than 1e-5, and the smallest motion is 0.015 [m] of a hand's object per [rad].
VISIBLE = 1e-3
LIMIT = 0.01  # largest relative distance between simulated and predicted motions and forces


@dataclass(frozen=True)
class Mechanism:
    """Mechanism of an MJCF file, with its task and the conditions to simulate."""

    path: Path
    title: str
    task: tuple[int, ...]  # rows of the payload twist [angular; linear]
    major: tuple[int, ...]  # rows of the task
    conditions: tuple[str, ...]  # a letter for each actuator: S healthy, L locked, F free

    @property
    def name(self) -> str:
        """Name in `systems.json`."""
        return self.path.stem

    @property
    def rows(self) -> list[int]:
        """Rows of the payload twist in the major task."""
        return [self.task[row] for row in self.major]

    @property
    def unit(self) -> str:
        """Unit of the major task: rad or m."""
        return "rad" if self.rows[0] < 3 else "m"


MODELS = HEXAPOD_MJCF.parent
MECHANISMS = (
    Mechanism(
        MODELS / "arm.xml",
        "7-joint serial arm, pointing",
        task=(0, 1, 2, 3, 4, 5),
        major=(0, 1),
        conditions=("SSSSSSS", "SLSSSSS", "SSSLSSS", "SSSFSSS", "SSSSSSF", "SLSSSSF"),
    ),
    Mechanism(
        MODELS / "hand.xml",
        "planar two-finger hand, placing an object",
        task=(2, 3, 4),
        major=(1, 2),
        conditions=("SSSS", "LSSS", "FSSS", "FFSS", "LSFS", "LLSS"),
    ),
    Mechanism(
        MODELS / "arms.xml",
        "two cooperating arms, carrying a load",
        task=(0, 1, 2, 3, 4, 5),
        major=(3, 4, 5),
        conditions=("SSSSSSSSSSSS", "SLSSSSSSSSSS", "SFSSSSSSSSSS", "SLSSSSSFSSSS", "FFFFFFSSSSSS"),
    ),
    Mechanism(
        MODELS / "platform.xml",
        "planar platform on four legs, positioning",
        task=(2, 3, 4),
        major=(1, 2),
        conditions=("SSSS", "LSSS", "FSSS", "FFSS", "LFSS"),
    ),
)


# Behaviour of a failed mechanism in simulation, measured without any Jacobian; only the waiting
# times are from the linear model.


@dataclass(frozen=True)
class Probed:
    """Mechanism in one condition, of which each measurement uses a new plant."""

    model: mujoco.MjModel
    mechanism: Mechanism
    condition: str

    def plant(self) -> Plant:
        """Return the failed plant at its nominal pose."""
        return failed_plant(self.model, failures_of(self.condition))

    @cached_property
    def settling_s(self) -> float:
        """Time until the slowest servo-controlled motion is at rest [s], in whole periods."""
        plant = self.plant()
        decay = -np.linalg.eigvals(linearize(plant.model, plant.data).A).real
        slowest = decay[decay > COASTING_PER_S].min(initial=np.inf)
        return PERIOD_S * np.ceil(-np.log(REST) / slowest / PERIOD_S)


def respond(rig: Probed, survivors: Array) -> tuple[Array, Array]:
    """Measure the displacements at rest after a unit step of each surviving actuator.

    Displacements are those of survivors, (n', n'), and task, (m, n'), with a column for each step.
    """
    active, twist = [], []
    for k in survivors:
        plant = rig.plant()
        plant.step(STEP * np.eye(rig.model.nu)[k], rig.settling_s)
        active.append(plant.displacements()[survivors] / STEP)
        twist.append(plant.displacement() / STEP)
    return np.array(active).T, np.array(twist).T[list(rig.mechanism.task)]


def coast(rig: Probed) -> Array:
    """Measure the self-motion that continues after a push along each task row, shape (m, m).

    The measurement is after the waiting time, when controlled motions are at rest. Each column is
    the displacement during a tenth of this time, as a fraction of the largest displacement.
    """
    task, coasting = list(rig.mechanism.task), []
    for row in task:
        # The displacement by a first, tiny push determines the size of the second.
        _, peak = pushed(rig, PROBE * np.eye(6)[row])
        moved, peak = pushed(rig, PROBE * STEP / peak * np.eye(6)[row])
        coasting.append(moved / peak)
    return np.array(coasting).T[task]


def pushed(rig: Probed, wrench: Array) -> tuple[Array, float]:
    """Return the displacement in a tenth of the waiting time after a push, and the largest."""
    plant, still = rig.plant(), np.zeros(rig.model.nu)
    plant.push(wrench)
    plant.step(still, PUSH_S)
    plant.push(np.zeros(6))
    at_once = plant.displacement()
    plant.step(still, rig.settling_s)
    before = plant.displacement()
    plant.step(still, max(PERIOD_S, round(0.1 * rig.settling_s, 2)))
    after = plant.displacement()
    return after - before, float(np.abs([at_once, after]).max())


def drive_polygon(
    rig: Probed, kin: Kinematics, rng: np.random.Generator
) -> tuple[dict[str, Array], float]:
    """Drive the major task around an octagon of radius STEP, then along further major directions.

    Returns:
        Arrays of time (T,), desired and reached task (T, m1), and joints (T, nq), with units in
        their names; and the largest distance of a corner from its prediction, in units of STEP.
    """
    major, unit = rig.mechanism.major, rig.mechanism.unit
    m1, angle = len(major), 2 * np.pi * (np.arange(CORNERS) / CORNERS + rng.random())
    octagon = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ np.eye(2, m1)
    corners = STEP * np.vstack([octagon, np.eye(m1)[2:], -np.eye(m1)[2:]])
    mapping = kin.velocity_mapping(major, joint_weight=np.ones(len(kin.actuators)))
    plant, periods = rig.plant(), round(rig.settling_s / PERIOD_S)
    twist, qpos = [], []
    for command in np.repeat(kin.expand(mapping(corners)), periods, axis=0):
        plant.step(command, PERIOD_S)
        twist.append(plant.displacement())
        qpos.append(plant.data.qpos.copy())
    reached = np.array(twist)[:, rig.mechanism.rows]
    predicted = corners - mapping.residual(corners)
    error = np.abs(reached[periods - 1 :: periods] - predicted).max() / STEP
    path = {
        "time_s": np.arange(1, len(twist) + 1) * PERIOD_S,
        "qpos": np.array(qpos),
        f"desired_{unit}": np.repeat(corners, periods, axis=0),
        f"reached_{unit}": reached,
    }
    return path, float(error)


def exert_force(
    rig: Probed, system: ConstrainedSystem, kin: Kinematics, rng: np.random.Generator
) -> dict[str, float]:
    """Exert a random force, and internal force, by the force mapping against an equal load.

    Returns:
        torque_error: Relative difference of the servo torques from those of the mapping.
        closure_error: Difference of the joint forces of closures and locks from the predicted
            constraint forces, relative to the largest of constraint forces, torques, and joint
            forces of the load.
        yielded_steps: Payload displacement in steps, of which a servo loaded with its torque alone
            moves one.
    """
    task, major = list(rig.mechanism.task), list(rig.mechanism.major)
    mapping = kin.force_mapping(major, torque_weight=np.ones(len(kin.actuators)))
    f_major = rng.normal(size=len(major))
    squeeze = rng.normal(size=len(kin.active_constraint)) @ kin.active_constraint
    torques, force = mapping(f_major, torque=squeeze), np.zeros(len(task))
    force[major] = f_major - mapping.residual(f_major)
    secondary = np.setdiff1d(np.arange(len(task)), major)
    force[secondary] = mapping.secondary_force(f_major, torque=squeeze)
    gain = rig.model.actuator_gainprm[:, 0]
    # The largest torque, as load of its servo alone, would move that by one step.
    scale = STEP / np.abs(kin.expand(torques) / gain).max()
    torques, force = scale * torques, scale * force
    plant, expected = rig.plant(), kin.expand(torques)
    plant.push(-np.eye(6)[:, task] @ force)
    plant.step(expected / gain, rig.settling_s)  # a servo at zero exerts gain * command
    stuck = np.eye(system.J_C.shape[1])[system.stuck]  # section 2.3.2: a row for each stuck joint
    closures = np.vstack([system.J_C, stuck]).T @ -kin.constraint_force(force, torques)  # eq. (5)
    sizes = closures, system.J_T.T @ force, torques
    return {
        "torque_error": relative(plant.coil_force_n() - expected, torques),
        "closure_error": relative(plant.data.qfrc_constraint - closures, *sizes),
        "yielded_steps": float(np.abs(plant.displacement()).max() / STEP),
    }


def relative(difference: Array, *wholes: Array) -> float:
    """Return the norm of a difference relative to that of the largest whole; 0 if all are zero."""
    size = max(np.linalg.norm(whole) for whole in wholes)
    return float(np.linalg.norm(difference) / size) if size else 0.0


def motion_error(kin: Kinematics, active: Array, moved: Array) -> float:
    """Return the relative error of the predicted payload motion J active and active constraint.

    Each task row is relative to its own motion, so that units do not mix.
    """
    forbidden = kin.active_constraint @ active
    off = np.linalg.norm(moved - kin.J @ active, axis=1)
    rows = off / np.maximum(np.linalg.norm(moved, axis=1), VISIBLE)
    return float(max(rows.max(), np.linalg.norm(forbidden) / np.linalg.norm(active)))


def largest_angle(moved: Array, basis: Array) -> float:
    """Return the sine of the largest angle between motions and a subspace; 0 without motion."""
    size = np.linalg.norm(moved, 2)
    if size < VISIBLE:
        return 0.0
    return float(np.linalg.norm(moved - basis @ (basis.T @ moved), 2) / size)


# Each condition, classified and simulated.

# Always checked; `major_error` only without self-motion, which persists from corner to corner.
ERRORS = ("motion_error", "drift_error", "torque_error", "closure_error", "yielded_steps")
FLAGS = ("unmanipulable", "unmanipulable_task", "irresolvable")
FLAGS += ("unstable", "unstable_major", "unstable_secondary")


class ConditionResult(NamedTuple):
    """Result of a mechanism in one condition: row, text of the recording, and driven polygon."""

    mechanism: Mechanism
    row: dict[str, Any]
    report: str
    path: dict[str, Array]

    @property
    def polygon(self) -> tuple[Array, Array]:
        """Desired and reached major task, [urad] or [um], shape (T, m1)."""
        desired, reached = (f"{what}_{self.mechanism.unit}" for what in ("desired", "reached"))
        return 1e6 * self.path[desired], 1e6 * self.path[reached]


def classified(
    model: mujoco.MjModel, mechanism: Mechanism, condition: str
) -> tuple[ConstrainedSystem, Kinematics]:
    """Return the failed mechanism at its nominal pose, with its task rows, and its kinematics.

    The metric of passive velocities is the mass matrix, because passive joints without friction
    start from rest and have no momentum along self-motions.
    """
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="payload", axes="base")
    system = ConstrainedSystem(jac.J_T[list(mechanism.task)], jac.J_C, jac.active)
    codes, numbers = codes_of(condition), range(len(condition))
    system = system.with_failures(*(failed(codes, numbers, kind) for kind in (LOCKED, FREE)))
    return system, system.kinematics(passive_metric=mass_matrix(model, data))


def classify_and_simulate(mechanism: Mechanism, condition: str, seed: int) -> ConditionResult:
    """Classify a condition, simulate it, and compare both."""
    model, rng = load_model(mechanism.path), np.random.default_rng(seed)
    rig = Probed(model, mechanism, condition)
    system, kin = classified(model, mechanism, condition)
    major, codes, numbers = list(mechanism.major), codes_of(condition), range(model.nu)
    report = kin.manipulability(major)
    bases = report.bases
    (active, moved), coasting = respond(rig, kin.actuators), coast(rig)
    path, major_error = drive_polygon(rig, kin, rng)
    errors = {
        "motion_error": motion_error(kin, active, moved),
        "drift_error": largest_angle(coasting, bases["unstable"]),
        "major_error": major_error,
        **exert_force(rig, system, kin, rng),
    }
    evaluated = ERRORS if report.unstable_major else [*ERRORS, "major_error"]
    # Dimensions in the report and in the simulation.
    rank = partial(np.linalg.matrix_rank, tol=VISIBLE)
    counts = {
        "major_directions": (len(major) - bases["unmanipulable"].shape[1], rank(moved[major])),
        "self_motion": (bases["unstable"].shape[1], rank(coasting)),
        "self_motion_major": (bases["unstable_major"].shape[1], rank(coasting[major])),
        "constrained_active": (len(bases["constrained_active"]), len(active) - rank(active)),
    }
    # The system's failures are part of every condition of its atlas.
    [classification] = classify(failure_atlas(system, major, codes=np.zeros((1, model.nu))))
    row = {
        "mechanism": mechanism.name,
        "index": mechanism.conditions.index(condition),
        "condition": condition_text(codes, [str(k + 1) for k in numbers]),
        "locked": failed(codes, numbers, LOCKED),
        "free": failed(codes, numbers, FREE),
        "major": [ROWS[row] for row in mechanism.rows],
        "verdict": classification,
        **{flag: getattr(report, flag) for flag in FLAGS},
        **{what: predicted for what, (predicted, _) in counts.items()},
        "internal_forces": len(bases["irresolvable"]),
        "lost_task_directions": bases["unmanipulable_task"].shape[1],
        f"worst_gain_{mechanism.unit}_per_actuator_unit": report.worst_gain,
        "smallest_gap": min(report.gaps.values()),
        **{f"simulated_{what}": simulated for what, (_, simulated) in counts.items()},
        "agrees": all(predicted == simulated for predicted, simulated in counts.values()),
        **errors,
        "largest_error": max(errors[name] for name in evaluated),
        "recording": f"{mechanism.name}.rrd",
        "data": f"{mechanism.name}.npz",
    }
    return ConditionResult(mechanism, row, str(report), path)


# The study.


def systems(
    *,
    seed: Annotated[int, seed_of("the random directions")] = 0,
    quick: Annotated[bool, Option(help="Three conditions of each mechanism.")] = False,
    on_progress: OnProgress,
) -> Result:
    """Compare the classification of four other mechanisms with their simulation.

    An arm, a hand, two cooperating arms and a platform are simulated without and with failures:
    every actuator makes a step, the payload is pushed, follows an octagon in its major task, and
    exerts a force. Takes 12 s on two cores, 8 s with --quick.

    Writes systems.json, its tables as systems.md and Parquet, a figure, and for each mechanism its
    data (.npz) and its recording (.rrd).

    Example: fjh paper systems --seed 1 --out /tmp/mechanisms
    """
    calls = [
        {"mechanism": mechanism, "condition": condition, "seed": seed}
        for mechanism in MECHANISMS
        for condition in mechanism.conditions[: 3 if quick else None]
    ]
    results: list[ConditionResult] = in_parallel(classify_and_simulate, calls, on_progress)
    groups = {m: [one for one in results if one.mechanism == m] for m in MECHANISMS}
    table = pd.DataFrame([one.row for one in results])
    settings = origin(seed) | {
        "model_sha256": {mechanism.name: model_sha256(mechanism.path) for mechanism in groups},
        "step_m_or_rad": STEP,
    }
    all_checks = checks(table)
    checks_text = checked(all_checks)
    return Result(
        settings=settings,
        tables={"systems": table},
        checks=all_checks,
        views=printed_tables(table),
        pictures=[Picture("systems", CAPTION, ALT, partial(figure, groups))],
        arrays={
            # Names end with the number of the condition.
            f"{mechanism.name}.npz": {
                f"{name}_{k}": A for k, one in enumerate(group) for name, A in one.path.items()
            }
            for mechanism, group in groups.items()
        },
        records=[partial(record, group, settings, checks_text) for group in groups.values()],
    )


def checks(systems: pd.DataFrame) -> list[Check]:
    """Return checks of directions and sizes of simulated motions against classes and mapping."""
    rows = systems.set_index(["mechanism", "condition"])
    what = "difference between simulation and classification in directions of motion (0 or 1)"
    result = check(what, 1.0 - rows.agrees.astype(float), 0.5)
    for name in ERRORS:
        result += check(name, rows[name], LIMIT)
    return result + check("major_error", rows[~rows.unstable_major].major_error, LIMIT)


def printed_tables(systems: pd.DataFrame) -> list[TableView]:
    """Return the printed table."""
    return [
        TableView(
            "Classification of each condition, and the largest error of its prediction",
            systems,
            "mechanism condition verdict=major_task largest_error=relative_error:.0e "
            "self_motion=self-motions constrained_active=forbidden_rates",
            "Drifts: self-motion moves the major task. Forbidden: combinations of actuator rates.",
        )
    ]


def record(
    group: Sequence[ConditionResult], settings: dict[str, Any], checks_text: str, folder: Path
) -> None:
    """Write the recording of a mechanism, with a scene for each condition."""
    mechanism = group[0].mechanism
    reports = {result.row["condition"]: result.report for result in group}
    name, what = mechanism.name, "The payload follows an octagon in its major task."
    properties = {"seed": settings["seed"], "step_m_or_rad": STEP, "period_s": PERIOD_S}
    properties["model_sha256"] = settings["model_sha256"][name]
    properties |= version_properties(settings)
    results = {"study": "systems", "robot": name, "verdict": what, "checks": checks_text}
    results["failures"] = "; ".join(reports)
    notes = [f"# {mechanism.title}", "", what, ""]
    for label, report in reports.items():
        notes += [f"## {label}", "", *(f"- {line}" for line in report.splitlines()), ""]
    text = "\n".join([*notes, *constants(properties)])
    identity = f"systems-{name}-seed{settings['seed']}"
    about = RecordingInfo(identity, mechanism.title, text, properties, results)
    model = load_model(mechanism.path)
    scenes = {result.row["condition"]: scene(model, result) for result in group}
    write_scenes(folder / f"{name}.rrd", about, scenes, pages=False)


def scene(model: mujoco.MjModel, result: ConditionResult) -> Scene:
    """Return the mechanism in 3D, its major task in a plane, and its error."""
    (desired, reached), time_s = result.polygon, result.path["time_s"]
    names, unit = result.row["major"], f"u{result.mechanism.unit}"
    labels = [f"{name} off [{unit}]" for name in names]
    plot = Plot("off", f"desired - reached [{unit}]", labels, time_s, desired - reached)
    curves, (right, up) = (desired[:, :2], reached[:, :2]), names[:2]
    plane = Plane(f"{up} over {right}", (right, up), unit, *curves, np.concatenate(curves))
    return condition_scene(model, time_s, result.path["qpos"], [plot], plane=plane)


CAPTION = (
    "Major task of each mechanism around an octagon, healthy and failed, in simulation. Thick "
    "lines connect the positions at rest for the commanded corners (dots), dashed if the task is "
    "classified as lost. Thin lines are the path from the first corner to the eighth."
)
ALT = (
    "A panel for each mechanism: at rest its task is at every corner of the octagon, except for "
    "the dashed lines, whose task is classified as lost."
)


def figure(groups: Mapping[Mechanism, Sequence[ConditionResult]]) -> Figure:
    """Plot the path of each mechanism's major task around an octagon, in every condition."""
    rows, dots = -(-len(groups) // 2), []
    figure = new_figure(PAGE_IN, 2.6 * rows + 0.2)
    figure.suptitle("Major task around an octagon, healthy and with failed actuators, simulated")
    for place, (mechanism, group) in enumerate(groups.items(), 1):
        axes = figure.add_subplot(rows, 2, place)
        # Lines get thinner, so that coinciding ones are all visible.
        widths = np.linspace(3.4, 0.8, len(group))
        for result, color, width in zip(group, cycle(LINES), widths, strict=False):
            style = "--" if result.row["unstable_major"] or result.row["unmanipulable"] else "-"
            at_rest, transient = around(result.polygon[1])
            axes.plot(*at_rest.T, style, color=color, lw=width, label=result.row["condition"])
            axes.plot(*transient.T, style, color=color, lw=0.4)
        corners, _ = around(group[0].polygon[0])
        dots = axes.plot(*corners.T, "o", color=BLACK, ms=3)
        first, second = (f"{ROWS[row]}, µ{mechanism.unit}" for row in mechanism.rows[:2])
        axes.set(title=mechanism.title, xlabel=first, ylabel=second)
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(title="failed actuators", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.legend(dots, ["commanded corners"], loc="outside lower center")
    return figure


def around(path: Array) -> tuple[Array, Array]:
    """Return the positions at rest for all corners, closed, (CORNERS + 1, 2), and the path."""
    other_corners = 2 * (path.shape[1] - 2)  # along further major directions
    per_corner = len(path) // (CORNERS + other_corners)
    octagon = path[per_corner - 1 : CORNERS * per_corner, :2]
    return np.vstack([octagon[::per_corner], octagon[:1]]), octagon
