"""Which failures of one actuator can be told apart: of a robot by its sensors, of a matrix by it.

Of a robot by the steady response to a dither that the major task does not feel, at the robot's
start, as docs/diagnosis.md says. By the linear model alone: nothing is simulated.
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
from fjh.survey.subject import Subject
from ftc.fdi import CERTAIN, DEFAULT_CONFIG, DitherDesign, Fault, ranked_sensors, separations
from sim import Array

SENSES: tuple[Sensing, ...] = ("task", "joints", "both")
MOST_ACTUATORS = 12  # with more the search of a dither takes minutes
MOST_ADDED = 3  # further sensors that are looked for

_STILL = 1e-9  # part of the largest motion that is round-off
_ONE_VELOCITY = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def isolation_of(
    subject: Subject, sensors: Switch, servo: float | None
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """A row for each set of sensors, and settings: under what, or why nothing can be said."""
    robot, count = subject.robot, len(subject.actuators)
    if robot is None:
        alike = alike_columns(subject.system.J_T, subject.actuators, subject.system.rank_tolerance)
        return pd.DataFrame([alike]), {"isolation_refused": None}
    # The loops are of position servos; all else takes the file as it is.
    options, at = replace(robot.options, servo=servo, sense="both"), None
    if subject.instead is not None:
        at = robot.scene.start.qpos
    try:
        if sensors == "off":
            raise WrongInput("it was not asked for")
        if count > MOST_ACTUATORS:
            raise WrongInput(f"it takes minutes for {count} actuators, more than {MOST_ACTUATORS}")
        rig = robot_rig(subject.file, options, at)
        sensed = [told_apart(rig, sense)[1] for sense in SENSES]
    except (WrongInput, ValueError) as error:
        return pd.DataFrame(), {"isolation_refused": str(error)}
    rows = [subject.row_units[row] for row in subject.major]
    return pd.DataFrame(sensed), {
        "isolation_refused": None,
        "measuring_time_s": MEASURED_S,
        **by_unit("path_size", rig.size, rows),
        **by_unit("sensor_noise", rig.noise, rows),
        **by_unit("encoder_noise", rig.encoder_noise, subject.units),
    }


def alike_columns(B: Array, names: Sequence[Any], tolerance: float) -> dict[str, Any]:
    """Which inputs of an effectiveness matrix no sensor of its effects tells apart.

    A failure of an input changes the effects along its column. Two failures whose columns are
    parallel look alike, however well the effects are measured and whatever the inputs do; any
    others differ in direction. Inputs without effect are not seen at all. The `nearest` others have
    the least angle, each effect in units of its row's norm.

    Args:
        B: Effects per input, shape (m, n).
        names: Of the inputs.
        tolerance: Sine of an angle that is none; and part of the largest column that is no effect.
    """
    rows = np.linalg.norm(B, axis=1, keepdims=True)
    scaled = B / np.where(rows > 0.0, rows, 1.0)
    size = np.linalg.norm(scaled, axis=0)
    seen = np.flatnonzero(size > tolerance * size.max(initial=0.0))
    unit = scaled[:, seen] / size[seen]
    both = (unit[:, :, None] + sign * unit[:, None, :] for sign in (-1, 1))
    apart = np.minimum(*(np.linalg.norm(each, axis=0) for each in both))
    count, of_group = connected_components(apart <= 2 * tolerance, directed=False)
    groups = [[names[k] for k in seen[of_group == group]] for group in range(count)]
    nearest, angle = [], None
    if count > 1:
        between = np.where(of_group[:, None] == of_group, np.inf, apart)
        i, j = divmod(least(between.ravel()), len(seen))
        nearest = [names[seen[i]], names[seen[j]]]
        angle = float(np.rad2deg(2 * np.arcsin(apart[i, j] / 2)))
    return {
        "sensors": "effects",
        "isolable": sum(len(group) == 1 for group in groups),
        "alike": [group for group in groups if len(group) > 1],
        "without_effect": [names[k] for k in np.setdiff1d(np.arange(B.shape[1]), seen)],
        "nearest": nearest,
        "smallest_angle_deg": angle,
    }


def with_sensors(rig: Rig, sense: Sensing) -> Rig:
    """The same robot whose diagnosis looks at these sensors; task rows come first."""
    noise = None if sense == "task" else rig.control.encoder_noise
    return replace(rig, control=replace(rig.control, sense=sense, encoder_noise=noise))


def told_apart(rig: Rig, sense: Sensing) -> tuple[DitherDesign, dict[str, Any]]:
    """The dither that is best for some sensors, and the row of what they tell apart with it.

    Single failures: each actuator locked, free and with half its force. Further sensors are each
    the best beside those before it; there are none where none helps.

    Raises:
        ValueError: Nothing can move beside the major task.
    """
    looking = with_sensors(rig, sense)
    watched, design = looking.watched, rig_dither(looking, "designed")
    if design is None:
        raise ValueError("the major task leaves no motion by which failures could be told apart")
    apart, dither = design.separations, design.dither
    exact = separations(watched, dither, MEASURED_S, CERTAIN)
    isolable, added = apart.isolable(), dict[str, int]()
    left, most = further_sensors(rig, sense), len(isolable)
    while left and len(added) < MOST_ADDED and most < len(apart.faults):
        best = ranked_sensors(watched, left, dither, MEASURED_S, DEFAULT_CONFIG.uncertainty)[0]
        if (with_it := len(best.separations.isolable())) <= most:
            break
        added[best.name] = most = with_it
        row, noise = left.pop(best.name)
        watched = watched.measured(np.vstack([watched.plant.C, row]), [*watched.noise, noise])

    def named(faults: Iterable[Fault]) -> list[str]:
        return [f"{rig.actuators[each.actuator]} {each.kind}" for each in faults]

    return design, {
        "sensors": sense,
        "failures": len(apart.faults),
        "isolable": len(isolable),
        "isolable_with_exact_model": len(exact.isolable()),
        "not_isolable": named(each for each in apart.faults if each not in isolable),
        "undetected": named(apart.undetected()),
        "alike": [[rig.actuators[k] for k in group] for group in apart.indistinguishable()],
        "least_separation": apart.least,
        "dither_hz": dither.frequency_hz,
        "dither_amplitude": dither.amplitude,
        "dither_direction": list(dither.direction),
        "further_sensors": list(added),
        "isolable_with_further": list(added.values()),
    }


def further_sensors(rig: Rig, sense: Sensing) -> dict[str, tuple[Array, float]]:
    """Rows per state of what a sensor that the robot does not have may measure, and its noise.

    Encoders of the actuators, the other rows of the twist, and encoders of hinges and slides that
    nothing drives, by name. All are as precise as forward kinematics from the actuators' encoders.
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
    found = {f"encoder of {name}": row for name, row in (of_joints | passive).items()}
    found |= {
        f"sensor of {name}": row
        for k, (name, row) in enumerate(zip(ROWS, linear.C_twist, strict=True))
        if k not in rig.major or sense == "joints"
    }
    per_encoder = np.linalg.pinv(encoders[:, : moves.shape[1]])
    moved = {
        name: np.abs(row[: len(per_encoder)] @ per_encoder).max() for name, row in found.items()
    }
    return {
        name: (row, float(rig.encoder_noise * moved[name]))
        for name, row in found.items()
        if moved[name] > _STILL * max(moved.values())
    }
