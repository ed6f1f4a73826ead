"""The rig of any robot from its MJCF file."""

from dataclasses import fields
from pathlib import Path

import mujoco
import numpy as np

from fjh.rig.bodies import body_name, model_name
from fjh.rig.options import RobotOptions
from fjh.rig.rig import Rig
from fjh.rig.robot import Robot, robot_of, warnings_of
from fjh.rig.robot_machine import RobotMachine
from fjh.study.errors import WrongInput
from fjh.study.input_checks import check_file
from ftc import ControlTask, DirectDrive, TaskLost, Tracking, tracking
from sim import Array, Plant, Pose
from sim.mjcf import located, names_of


def rig_of(model: Path | None, options: RobotOptions) -> Rig:
    """Return the rig that a command's options request.

    Args:
        model: MJCF file; None is the hexapod, which has its own frame, loops and sensors.
        options: Options of the robot.

    Raises:
        WrongInput: The robot lacks a named part, or cannot perform the task.
        sim.ModelError: The file cannot be read, or its model is unsuitable.
    """
    if model is not None:
        return robot_rig(check_file(model), options)
    for option in fields(options):
        robot_only = option.name not in ("size", "feedforward")
        if robot_only and getattr(options, option.name) != option.default:
            flag = f"--{option.name.replace('_', '-')}"
            raise WrongInput(f"{flag} needs a MODEL.xml: it does not apply to the hexapod")
    return Rig.hexapod(size=options.size, feedforward=options.feedforward == "on")


def robot_rig(file: Path, options: RobotOptions, at: Array | None = None) -> Rig:
    """Return the rig of an MJCF file on its exact plant; `at` are positions (nq,) of the start.

    Raises:
        WrongInput: The robot lacks a named part, or cannot perform the task.
        sim.ModelError: The file cannot be read, or its model is unsuitable.
    """
    robot, rows = robot_of(file, options, at), options.major
    plant = robot.task_plant
    names, limits = names_of(plant.drives), plant.limits()
    limited = options.limits == "stated" and any(np.isfinite(limit).any() for limit in limits)
    track = _tracking(robot, plant, limits if limited else None, file)
    return Rig(
        title=model_name(robot.model, file),
        model=robot.model,
        actuators=tuple(name for name, *_ in names),
        aliases=tuple(tuple(others) for _, *others in names),
        bodies=tuple(_body(robot.model, drive.joint) for drive in robot.nominal_plant.drives),
        units=tuple(drive.unit for drive in plant.drives),
        major=rows,
        size=robot.size,
        noise=robot.noise,
        encoder_noise=robot.encoder_noise,
        travel=limits,
        task=ControlTask(
            nominal=track.nominal,
            J=track.system.kinematics().J,
            major=rows,
            goal=robot.goal,
            drives=DirectDrive(),
            limits=limits,
            reference_limit=np.full(len(rows), robot.size),
        ),
        warnings=warnings_of(robot),
        payload_body=located(robot.model, "payload", robot.scene.frame).body,
        control=track,
        machine=RobotMachine(robot),
        coordinates=Pose.displacement,
        part=robot.scene.part,
        file=file,
        soft_locks=frozenset(robot.nominal_plant.soft_locks),
    )


def _tracking(
    robot: Robot, plant: Plant, limits: tuple[Array, Array] | None, file: Path
) -> Tracking:
    options = robot.options
    try:
        return tracking(
            robot.mechanism,
            robot.linear,
            options.major,
            noise=robot.deviations,
            period_s=robot.period_s,
            step_s=float(robot.model.opt.timestep),
            goal=robot.goal,
            crossover_hz=options.crossover,
            sense=options.sense,
            limits=limits,
            implicit_damping=plant.implicit_damping,
            springs=robot.springs_count,
            unused=robot.unused,
            feedforward=options.feedforward != "off",
            names=[name for name, *_ in names_of(plant.drives)],
        )
    except TaskLost as error:
        advice = "; try other rows (major) or another start (keyframe)" * error.needs_other_task
        raise WrongInput(f"{file}: {error}{advice}") from None


def _body(model: mujoco.MjModel, joint: int | None) -> str | None:
    return None if joint is None else body_name(model, int(model.jnt_bodyid[joint]))
