"""The rig of any robot from its MJCF file."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import argument_checks as check
from experiments.rig.bodies import body_name
from experiments.rig.dither import dither_of
from experiments.rig.mismatch import EXACT, Known, Mismatch, sizes_of
from experiments.rig.mismatched import ALL, DriftingSensors, displaced, mismatched_model
from experiments.rig.options import RobotOptions
from experiments.rig.rig import Rig
from experiments.study.draw import Draw
from experiments.study.study import WrongInput
from ftc.control.mapping import PrioritizedMapping
from ftc.control_task import ControlTask
from ftc.controller import DirectDrive, PrioritizedController
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault
from ftc.goal import Goal
from ftc.supervisor import Supervisor, Unused
from ftc.tracking import TaskLost, Tracking, mapping_for, tracking
from prioritized import Manipulability
from sim import (
    Array,
    Bench,
    ClosureError,
    Failure,
    JointSensors,
    LinearPlant,
    Mechanism,
    ModelError,
    Pin,
    Plant,
    Sensors,
    TaskSensor,
)
from sim.mjcf.drive import names_of
from sim.mjcf.model import listed
from sim.mjcf.transmission import drives
from sim.plant.beyond_linear import beyond_linear
from sim.scene.scene import Scene, robot_scene

OF_THE_HEXAPOD = (
    *("stiffness", "floor_um_per_s", "drift_urad_per_s"),
    *("gain_drift_per_s", "hysteresis", "timestep_s"),
)
"""Sizes of a mismatch that are of the hexapod alone."""

_SIZE = 1e-3
"""Of a path, in radians or extents of the model: so small that the linear model holds."""
_HELD = 0.5
"""Part of the stiffness with which an actuator is held that its own spring must give: it then
stands nearly still without force."""
_NOISE = 1e-2
"""Of a sensor, in what the path moves it: a row by its size, an actuator as far as it moves any."""


@dataclass(frozen=True)
class RobotRig(Rig):
    """A robot of an MJCF file.

    Attributes:
        robot: At its start.
        track: Its loops.
        mismatch: How its plants differ from the model.
        seed: Of what is drawn of them.
    """

    robot: "_Robot"
    track: Tracking
    mismatch: Mismatch
    seed: int

    def drawn(self, mismatch: Known | Mismatch, seed: int) -> "RobotRig":
        """The same with plants that differ so."""
        return replace(self, mismatch=sizes_of(mismatch, ALL, OF_THE_HEXAPOD), seed=seed)

    def mapping(self, goal: Goal) -> PrioritizedMapping[Any]:
        """With the Jacobian of the present posture."""
        return self.track.mapping(goal)

    def controller(self, goal: Goal | None = None) -> PrioritizedController[Any]:
        """For a goal; None is that of the rig."""
        return self.track.controller(goal or self.goal)

    def supervisor(
        self, dither: str | Dither | None = "default", goal: Goal | None = None
    ) -> Supervisor:
        """With the dither of the command's default, unless another is asked for."""
        track = self.track if goal is None else replace(self.track, goal=goal)
        return track.supervisor(dither=dither_of(self, dither, "default"))

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """A machine with its plant and drift, and noise of this seed."""
        return self.robot.bench(self.mismatch, time_s, failures, (self.seed, seed), events)

    def classified(self, faults: Sequence[Fault]) -> Manipulability:
        """What the actuators that are left can do."""
        return self.track.classified(faults)


def robot_rig(file: Path, options: RobotOptions, at: Array | None = None) -> RobotRig:
    """Any robot from its MJCF file, on its exact plant; `at` are joint positions (nq,) to start at.

    Raises:
        WrongInput: A weight or keyframe that the robot does not have; or it cannot do the task.
        sim.ModelError: The file, or what it says.
    """
    robot, rows = _robot(file, options, at), options.rows
    plant = robot.alone
    names, limits = names_of(plant.drives), plant.limits()
    limited = options.limits == "stated" and any(np.isfinite(limit).any() for limit in limits)
    unused: Unused = "locked" if (plant.spring_share > _HELD).all() else "free"
    track = _tracking(robot, plant, limits if limited else None, file, unused)
    return RobotRig(
        title=file.stem,
        model=robot.model,
        actuators=tuple(own for own, *_ in names),
        aliases=tuple(tuple(others) for _, *others in names),
        bodies=tuple(_body(robot.model, drive.joint) for drive in robot.known.drives),
        major=rows,
        goal=robot.goal,
        nominal=track.nominal,
        watched=track.watched,
        loops=track.loops,
        margins=track.margins,
        limits=track.limits,
        feedforward=track.feedforward,
        size=robot.size,
        noise=robot.noise,
        encoder_noise=robot.encoder_noise,
        travel=limits,
        unused=unused,
        task=ControlTask(
            nominal=track.nominal,
            J=track.system.kinematics().J,
            major=rows,
            goal=robot.goal,
            drives=DirectDrive(),
            limits=limits,
            reference_limit=np.full(len(rows), robot.size),
        ),
        warnings=_warnings(robot),
        left_out=robot.scene.part.left_out,
        robot=robot,
        track=track,
        mismatch=EXACT,
        seed=0,
    )


@dataclass(frozen=True)
class _Robot:
    """A robot at its start; the frame of its task, its control period, goal, path and sensors."""

    scene: Scene
    options: RobotOptions
    period_s: float
    goal: Goal
    size: float

    @property
    def noise(self) -> float:
        """Of a sample of each major row."""
        return _NOISE * self.size if self.options.noise is None else self.options.noise

    @cached_property
    def encoder_noise(self) -> float:
        """Of a sample of each actuator."""
        if self.options.noise is not None:
            return self.options.noise
        gain = mapping_for(self.mechanism, self.goal, self.options.rows).major_gain()
        return self.noise * float(np.abs(gain).max())

    @property
    def deviations(self) -> Array:
        """Of what the diagnosis looks at: major rows, then actuators."""
        of_task = [self.noise] * len(self.options.rows) * (self.options.sense != "joints")
        actuators = len(self.mechanism.nominal.displacements)
        of_encoders = [self.encoder_noise] * actuators * (self.options.sense != "task")
        return np.array(of_task + of_encoders)

    @property
    def model(self) -> mujoco.MjModel:
        """Of all that the file holds."""
        return self.scene.whole

    def plant(self, model: mujoco.MjModel) -> Plant:
        """With this model of all that the file holds."""
        scene, axes = self.scene, self.options.axes
        return Plant(model, base=axes, payload=scene.frame, start=scene.start, part=scene.part)

    @cached_property
    def known(self) -> Plant:
        """Of all, as the file has it, at the start: never flown."""
        return self.plant(self.model)

    @cached_property
    def alone(self) -> Plant:
        """Of what the task involves, as its controller has it, at the start: never flown."""
        scene, axes = self.scene, self.options.axes
        if not scene.part.rest:
            return self.known
        return Plant(scene.own, base=axes, payload=scene.frame, start=scene.own_start)

    @cached_property
    def linear(self) -> LinearPlant:
        """About the start."""
        return self.alone.linear()

    @cached_property
    def mechanism(self) -> Mechanism:
        """The controller's own model, which knows no state: all readers share it."""
        scene = self.scene
        return Mechanism(scene.own, scene.own_start, scene.frame, self.options.axes)

    def bench(
        self,
        mismatch: Mismatch,
        time_s: Array,
        failures: Sequence[Failure],
        seeds: tuple[int, int],
        events: object,
    ) -> Bench:
        """A machine with plant and drift of the first seed, noise of the other."""
        model, gains = mismatched_model(self.model, self.known, mismatch, seeds[0])
        plant = self.plant(model)
        per_command = displaced(self.known, plant, gains)
        return Bench(
            plant,
            self._sensors(mismatch.drift_per_s * self.period_s, len(gains), *seeds),
            time_s=time_s,
            period_s=self.period_s,
            failures=failures,
            drives=lambda command: per_command * command,
            delay_ticks=mismatch.delay_ticks,
            keep_qpos=True,
            events=events,
        )

    def _sensors(self, drift_per_tick: float, actuators: int, drawn: int, seed: int) -> Sensors:
        """Of the task, or encoders alone; zeros drift up to so many standard deviations."""
        rows, draw = self.options.rows, Draw(drawn)
        noise, encoder_noise = self.noise, self.encoder_noise
        of_task = drift_per_tick * noise * draw.uniform("task drift", len(rows))
        of_encoders = drift_per_tick * encoder_noise * draw.uniform("drift", actuators)
        sensors: Sensors = TaskSensor(rows, noise, encoder_noise, seed)
        if self.options.sense == "joints":
            # The task is computed from the encoders, and drifts with them.
            sensors, of_task = JointSensors(self.mechanism, rows, encoder_noise, seed), 0 * of_task
        return DriftingSensors(sensors, of_task, of_encoders)


def _robot(file: Path, options: RobotOptions, at: Array | None) -> _Robot:
    begin = partial(_start, keyframe=options.keyframe, at=at)
    pins, servo_hz = [Pin(name, weld) for name, weld in options.pins], options.servo
    try:
        scene = robot_scene(file, options.site, options.axes, begin, pins, servo_hz)
    except ClosureError as error:
        raise ModelError(f"{file}: {error}") from None
    model = scene.whole
    steps = max(1, math.ceil(options.period / model.opt.timestep - 1e-9))
    size = options.size
    if size is None:
        turns = all(row < 3 for row in options.rows)
        size = _SIZE if turns else _SIZE * float(model.stat.extent)
    goal = _goal(len(drives(scene.own)), options)
    return _Robot(scene, options, steps * model.opt.timestep, goal, size)


def _tracking(
    robot: _Robot, plant: Plant, limits: tuple[Array, Array] | None, file: Path, unused: Unused
) -> Tracking:
    """The loops of a plant at its start."""
    options = robot.options
    try:
        return tracking(
            robot.mechanism,
            robot.linear,
            options.rows,
            noise=robot.deviations,
            period_s=robot.period_s,
            step_s=float(robot.model.opt.timestep),
            goal=robot.goal,
            crossover_hz=options.crossover,
            sense=options.sense,
            limits=limits,
            implicit_damping=plant.implicit_damping,
            springs=unused == "locked",  # without them a strut that is let go would be lost
            unused=unused,
            feedforward=options.feedforward != "off",
        )
    except TaskLost as error:
        raise WrongInput(f"{file}: {error}") from None


def _warnings(robot: _Robot) -> tuple[str, ...]:
    """What the linear model and the mapping leave out."""
    scene, beside = robot.scene, ()
    if scene.part.left_out:
        names = listed(scene.part.left_out)
        beside = (f"no part of the task, and left to itself: {names}",)
    if idle := robot.linear.idle:
        beside = (*beside, f"nothing holds, and no task feels, a motion of {listed(idle)}")
    return (
        *(*beside, *scene.moved),
        *robot.mechanism.nominal.jacobians.warnings,
        *beyond_linear(scene.own, scene.own_start),
    )


def _body(model: mujoco.MjModel, joint: int | None) -> str | None:
    return None if joint is None else body_name(model, int(model.jnt_bodyid[joint]))


def _start(model: mujoco.MjModel, *, keyframe: str | None, at: Array | None) -> mujoco.MjData:
    """Joint positions (nq,), or a keyframe by name or number; neither is the first, or qpos0."""
    data = mujoco.MjData(model)
    if at is not None:
        data.qpos[:] = check.exactly("start", at, model.nq)
        return data
    if keyframe is None:
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        return data
    names = [model.key(k).name for k in range(model.nkey)]
    if keyframe in names:
        number = names.index(keyframe)
    elif keyframe.isdecimal() and int(keyframe) < model.nkey:
        number = int(keyframe)
    else:
        known = ", ".join(name or str(k) for k, name in enumerate(names)) or "none"
        raise WrongInput(f"--keyframe {keyframe}: the model has {known}")
    mujoco.mj_resetDataKeyframe(model, data, number)
    return data


def _goal(actuators: int, options: RobotOptions) -> Goal:
    """W1 and W2; with neither of them all joints weigh alike."""
    joint, others = options.joint_weight, options.secondary_weight
    if joint is None and others is None:
        joint = "1"
    secondary = 6 - len(options.rows)
    return Goal(
        joint_weight=None if joint is None else _weights("--joint-weight", joint, actuators),
        secondary_weight=None
        if others is None
        else _weights("--secondary-weight", others, secondary),
    )


def _weights(option: str, text: str, count: int) -> tuple[float, ...]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise WrongInput(f"{option} must be numbers with commas between, got {text}") from None
    if not all(0 <= value < math.inf for value in values):
        raise WrongInput(f"{option} must not be negative or infinite, got {text}")
    if len(values) not in (1, count):
        raise WrongInput(f"{option} must be one number or {count}, got {len(values)}")
    return tuple(values * count if len(values) == 1 else values)
