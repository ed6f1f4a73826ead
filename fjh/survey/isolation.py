"""Isolability of single failures: by sets of sensors of a robot, by the effects of a matrix.

For a robot it is computed from the steady response of the linear model at the start to a dither in
the null space of the major task (docs/diagnosis.md); nothing is simulated.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from scipy.sparse.csgraph import connected_components

from argument_checks.ties import least
from fjh.rig.dither import MEASURED_S, rig_dither
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import Sensing, Switch
from fjh.rig.rig import Rig
from fjh.rig.units import ROWS, by_unit
from fjh.study.errors import WrongInput
from fjh.survey.system import AnalyzedSystem
from ftc.fdi import CERTAIN, DEFAULT_CONFIG, DitherDesign, Fault, ranked_sensors, separations
from sim import Array

SENSES: tuple[Sensing, ...] = ("task", "joints", "both")
MOST_ACTUATORS = 12  # with more actuators the search for a dither takes minutes
MOST_ADDED = 3  # largest number of further sensors that are proposed

_STILL = 1e-9  # smaller fractions of the largest motion are round-off
_ONE_VELOCITY = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def isolation_of(
    system: AnalyzedSystem, sensors: Switch, servo: float | None
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return a row for each set of sensors, and settings, or the reason why there are no rows."""
    robot, count = system.robot, len(system.actuators)
    if robot is None:
        B, tolerance = system.constrained_system.J_T, system.constrained_system.rank_tolerance
        row = indistinguishable_columns(B, system.actuators, tolerance)
        return pd.DataFrame([row]), {"isolation_refused": None}
    # Only the control loops need position servos; all else uses the file as it is.
    options, at = replace(robot.options, servo=servo, sense="both"), None
    if system.instead is not None:
        at = robot.scene.start.qpos
    try:
        if sensors == "off":
            raise WrongInput("it was not requested")
        if count > MOST_ACTUATORS:
            raise WrongInput(f"it takes minutes for {count} actuators, more than {MOST_ACTUATORS}")
        rig = robot_rig(system.file, options, at)
        sensed = [isolation_row(rig, sense)[1] for sense in SENSES]
    except (WrongInput, ValueError) as error:
        return pd.DataFrame(), {"isolation_refused": str(error)}
    rows = [system.row_units[row] for row in system.major]
    return pd.DataFrame(sensed), {
        "isolation_refused": None,
        "measuring_time_s": MEASURED_S,
        **by_unit("path_size", rig.size, rows),
        **by_unit("sensor_noise", rig.noise, rows),
        **by_unit("encoder_noise", rig.encoder_noise, system.units),
    }


def indistinguishable_columns(B: Array, names: Sequence[Any], tolerance: float) -> dict[str, Any]:
    """Return the inputs of an effectiveness matrix that no sensor of its effects distinguishes.

    A failure of an input changes the effects along its column: failures with parallel columns are
    indistinguishable for any inputs and sensors, and inputs without effect are undetectable. The
    `nearest` distinguishable inputs have the least angle [deg] between columns, with each effect in
    units of its row's norm.

    Args:
        B: Effects per input, shape (m, n).
        names: Names of the inputs.
        tolerance: Largest sine of an angle, and relative norm of a column, that count as zero.
    """
    rows = np.linalg.norm(B, axis=1, keepdims=True)
    scaled = B / np.where(rows > 0.0, rows, 1.0)
    size = np.linalg.norm(scaled, axis=0)
    seen = np.flatnonzero(size > tolerance * size.max(initial=0.0))
    unit = scaled[:, seen] / size[seen]
    both = (unit[:, :, None] + sign * unit[:, None, :] for sign in (-1, 1))
    distance = np.minimum(*(np.linalg.norm(difference, axis=0) for difference in both))
    count, of_group = connected_components(distance <= 2 * tolerance, directed=False)
    groups = [[names[k] for k in seen[of_group == group]] for group in range(count)]
    nearest, angle = [], None
    if count > 1:
        between = np.where(of_group[:, None] == of_group, np.inf, distance)
        i, j = divmod(least(between.ravel()), len(seen))
        nearest = [names[seen[i]], names[seen[j]]]
        angle = float(np.rad2deg(2 * np.arcsin(distance[i, j] / 2)))
    return {
        "sensors": "effects",
        "isolable": sum(len(group) == 1 for group in groups),
        "alike": [group for group in groups if len(group) > 1],
        "without_effect": [names[k] for k in np.setdiff1d(np.arange(B.shape[1]), seen)],
        "nearest": nearest,
        "smallest_angle_deg": angle,
    }


def with_sensors(rig: Rig, sense: Sensing) -> Rig:
    """Return the robot with a diagnosis that uses these sensors."""
    noise = None if sense == "task" else rig.control.encoder_noise
    return replace(rig, control=replace(rig.control, sense=sense, encoder_noise=noise))


def isolation_row(rig: Rig, sense: Sensing) -> tuple[DitherDesign, dict[str, Any]]:
    """Return the best dither for a set of sensors, and a row on the failures isolable with it.

    Each actuator may be locked, free, or have half of its force. Further sensors are added one by
    one, always the one that isolates most further failures, if any does.

    Raises:
        ValueError: The major task leaves no motion for a dither.
    """
    sensed = with_sensors(rig, sense)
    observed, design = sensed.diagnosis_model, rig_dither(sensed, "designed")
    if design is None:
        raise ValueError("the major task leaves no motion by which failures could be isolated")
    separated, dither, uncertainty = design.separations, design.dither, DEFAULT_CONFIG.uncertainty
    exact = separations(observed, dither, MEASURED_S, CERTAIN)
    isolable, added = separated.isolable(), dict[str, int]()
    candidates, most = further_sensors(rig, sense), len(isolable)
    while candidates and len(added) < MOST_ADDED and most < len(separated.faults):
        ranked = ranked_sensors(observed, candidates, dither, MEASURED_S, uncertainty)
        if (count := len(ranked[0].separations.isolable())) <= most:
            break
        name = ranked[0].name
        added[name] = most = count
        row, noise = candidates.pop(name)
        observed = observed.measured(np.vstack([observed.plant.C, row]), [*observed.noise, noise])

    def labels(faults: Iterable[Fault]) -> list[str]:
        return [f"{rig.actuators[fault.actuator]} {fault.kind}" for fault in faults]

    return design, {
        "sensors": sense,
        "failures": len(separated.faults),
        "isolable": len(isolable),
        "isolable_with_exact_model": len(exact.isolable()),
        "not_isolable": labels(fault for fault in separated.faults if fault not in isolable),
        "undetected": labels(separated.undetected()),
        "alike": [[rig.actuators[k] for k in group] for group in separated.indistinguishable()],
        "least_separation": separated.least,
        "dither_hz": dither.frequency_hz,
        "dither_amplitude": dither.amplitude,
        "dither_direction": list(dither.direction),
        "further_sensors": list(added),
        "isolable_with_further": list(added.values()),
    }


def further_sensors(rig: Rig, sense: Sensing) -> dict[str, tuple[Array, float]]:
    """Return output row (s,) and noise of each sensor that the robot lacks, by name.

    These are encoders of the actuators, the other rows of the twist, and encoders of passive hinges
    and slides. Each is as precise as forward kinematics from the actuators' encoders.
    """
    linear, model = rig.machine.robot.linear, rig.machine.robot.scene.task_model
    assert linear.motion is not None  # that of a plant
    encoders, moves = linear.C_active, linear.motion
    driven = {drive.joint for drive in rig.machine.robot.task_plant.drives}
    free = [k for k in range(model.njnt) if k not in driven and model.jnt_type[k] in _ONE_VELOCITY]
    passive = {
        linear.joints[k]: np.append(moves[k], 0.0 * moves[k]) for k in model.jnt_dofadr[free]
    }
    of_joints = dict(zip(rig.actuators, encoders, strict=True)) if sense == "task" else {}
    outputs = {f"encoder of {name}": row for name, row in (of_joints | passive).items()}
    outputs |= {
        f"sensor of {name}": row
        for k, (name, row) in enumerate(zip(ROWS, linear.C_twist, strict=True))
        if k not in rig.major or sense == "joints"
    }
    per_encoder = np.linalg.pinv(encoders[:, : moves.shape[1]])
    moved = {
        name: np.abs(row[: len(per_encoder)] @ per_encoder).max() for name, row in outputs.items()
    }
    return {
        name: (row, float(rig.encoder_noise * moved[name]))
        for name, row in outputs.items()
        if moved[name] > _STILL * max(moved.values())
    }
