"""What a robot of an MJCF file is surveyed as: its kinematics at the start, limits, names."""

from pathlib import Path

import mujoco
import numpy as np

from experiments.rig.bodies import model_name
from experiments.rig.options import RobotOptions
from experiments.rig.robot import Robot, left_out_of, robot_of
from experiments.rig.units import ROWS
from experiments.study.interrupts import printable
from experiments.survey.matrix import input_limits
from experiments.survey.survey import Limited, Subject
from prioritized import ConstrainedSystem
from sim import HEXAPOD_MJCF, Array, Drive, ModelError, model_sha256
from sim.mjcf.drive import names_of
from sim.mjcf.transmission import drives

_UNITS = ("rad",) * 3 + ("m",) * 3
_UNSTATED = "the file states none, and each actuator is taken to have 1 rad/s or 1 m/s"
_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_FIXED, _AFFINE = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_AFFINE)


def robot_subject(
    file: Path | None, options: RobotOptions, lower: str | None, upper: str | None
) -> Subject:
    """A robot at its start; no file is the testbed's hexapod.

    Args:
        file: MJCF.
        options: Its task.
        lower: Limits of the actuators' rates, as of a matrix' inputs; None is those of the file.
        upper: Likewise.

    Raises:
        WrongInput: Limits of another number, or of none.
        sim.ModelError: The file, or what it says.
    """
    path = HEXAPOD_MJCF if file is None else file
    robot = robot_of(path, options, settle=False)
    driven = drives(robot.scene.own)
    names = tuple(own for own, *_ in names_of(driven))
    jac, rates = robot.rigid.nominal, _rates(driven)
    if rates is None or lower is not None or upper is not None:
        rates = input_limits(lower, upper, names, _UNSTATED)
    return Subject(
        title=printable(model_name(robot.model, path)),
        sha256=model_sha256(path),
        actuators=names,
        units=tuple(drive.unit for drive in driven),
        rows=ROWS,
        row_units=_UNITS,
        major=options.major,
        system=ConstrainedSystem.of(jac, _springs_count(robot)),
        rates=rates,
        torques=_torques(driven),
        robot=robot,
        warnings=(*left_out_of(robot), *robot.scene.moved, *jac.warnings),
    )


def _springs_count(robot: Robot) -> bool:
    """As of the robot; without position servos nothing says how stiff springs would have to be."""
    try:
        return robot.springs_count
    except ModelError:
        return robot.springs_hold


def _rates(driven: tuple[Drive, ...]) -> Limited | None:
    """Of velocity servos, which alone have limits of rates in MJCF; None where there is none."""
    lower, upper = np.array([_rate_range(drive) for drive in driven]).T
    if not (np.isfinite(lower) | np.isfinite(upper)).any():
        return None
    return Limited((lower, upper), "control ranges of velocity actuators", False)


def _rate_range(drive: Drive) -> tuple[float, float]:
    """What all servos of a drive can command."""
    each = zip(drive.ids, drive.gear, strict=True)
    ends = np.sort([_servo_range(drive.model, k) / gear for k, gear in each], axis=1)
    return float(ends[:, 0].max()), float(ends[:, 1].min())


def _servo_range(model: mujoco.MjModel, actuator: int) -> Array:
    """Commanded speeds of an actuator's length: of `velocity` and `intvelocity`; else infinite."""
    control, endless = int(model.actuator_ctrladr[actuator]), np.array([-np.inf, np.inf])
    kinds = model.actuator_gaintype[actuator], model.actuator_biastype[actuator]
    if kinds != (_FIXED, _AFFINE) or not model.actuator_ctrllimited[control]:
        return endless
    gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
    integrates = model.actuator_dyntype[actuator] == _INTEGRATOR
    follows_speed = gain != 0.0 and bias[1] == 0.0 and bias[2] == -gain
    return model.actuator_ctrlrange[control] if integrates or follows_speed else endless


def _torques(driven: tuple[Drive, ...]) -> Limited:
    """Ranges of the forces of all actuators of a drive together, as the file states them."""
    each = np.array([drive.force_range for drive in driven])
    if not np.isfinite(each).any():
        n = len(each)
        said = "the file states none, and each actuator is taken to have 1 N or 1 N m"
        return Limited((-np.ones(n), np.ones(n)), said, True)
    return Limited((each[:, 0], each[:, 1]), "force ranges of the file, without gravity", False)
