"""A robot of an MJCF file at its start: model, sensors, goal, machine."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import mujoco
import numpy as np

import argument_checks as check
from fjh.rig.options import RobotOptions
from fjh.study.errors import WrongInput
from fjh.study.input_checks import nearest
from ftc import Goal, Unused, is_possible, mapping_for
from prioritized import ConstrainedSystem
from sim import Array, ClosureError, LinearPlant, Mechanism, ModelError, Pin, Plant
from sim.mjcf import drives, listed, start_of
from sim.plant import beyond_linear
from sim.scene import Scene, robot_scene

_SIZE = 1e-3
"""Of a path, in radians or extents of the model: so small that the linear model holds."""
_HELD = 0.5
"""Part of the stiffness with which an actuator is held that its own spring must give: it then
stands nearly still without force."""
_NOISE = 1e-2
"""Of a sensor, in what a path of the default size moves it: a row by that size, an actuator as far
as it moves any. A longer path has no worse sensors."""


@dataclass(frozen=True)
class Robot:
    """A robot at its start; the frame of its task, its control period, goal, path and sensors."""

    scene: Scene
    options: RobotOptions
    period_s: float
    goal: Goal
    size: float

    @property
    def noise(self) -> float:
        """Of a sample of each major row."""
        if self.options.noise is not None:
            return self.options.noise
        return _NOISE * _usual_size(self.model, self.options.major)

    @cached_property
    def encoder_noise(self) -> float:
        """Of a sample of each actuator."""
        if self.options.noise is not None:
            return self.options.noise
        gain = mapping_for(self.mechanism, self.goal, self.options.major).major_gain()
        return self.noise * float(np.abs(gain).max())

    @property
    def deviations(self) -> Array:
        """Of what the diagnosis looks at: major rows, then actuators."""
        of_task = [self.noise] * len(self.options.major) * (self.options.sense != "joints")
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
        if scene.part is None:
            return self.known
        return Plant(scene.own, base=axes, payload=scene.frame, start=scene.own_start)

    @cached_property
    def linear(self) -> LinearPlant:
        """About the start."""
        return self.alone.linear()

    @cached_property
    def mechanism(self) -> Mechanism:
        """The controller's own model, which knows no state: all readers share it."""
        return self._mechanism(springs=True) if self.springs_hold else self.rigid

    @cached_property
    def unused(self) -> Unused:
        """What happens to actuators that are out of use: their springs hold them, or nothing."""
        return "locked" if (self.alone.spring_share > _HELD).all() else "free"

    @property
    def springs_count(self) -> bool:
        """Whether the classification is that of the elastic mechanism."""
        # Without them a strut that is let go would be lost, or a finger on one cable.
        return self.unused == "locked" or self.springs_hold

    @cached_property
    def springs_hold(self) -> bool:
        """Whether springs, and neither actuators nor loops, decide how the major rows move."""
        jac, major = self.rigid.nominal, list(self.options.major)
        rigid = ConstrainedSystem.of(jac).kinematics().manipulability(major)
        if not rigid.unstable_major or jac.stiffness is None:
            return False
        return is_possible(ConstrainedSystem.of(jac, True).kinematics().manipulability(major))

    @cached_property
    def rigid(self) -> Mechanism:
        """The same without springs."""
        return self._mechanism(springs=False)

    def _mechanism(self, *, springs: bool) -> Mechanism:
        scene, axes = self.scene, self.options.axes
        return Mechanism(scene.own, scene.own_start, scene.frame, axes, springs=springs)


def robot_of(
    file: Path, options: RobotOptions, at: Array | None = None, *, settle: bool = True
) -> Robot:
    """The robot of a file; `at` are joint positions (nq,) to start at, None is the keyframe.

    `settle` as of :func:`sim.scene.robot_scene`.

    Raises:
        WrongInput: A weight or keyframe that the robot does not have.
        sim.ModelError: The file, or what it says.
    """
    begin = partial(_start, keyframe=options.keyframe, at=at)
    names = [(name, name.removesuffix(":point")) for name in options.pinned or ()]
    pins, servo_hz = [Pin(frame, weld=name == frame) for name, frame in names], options.servo
    try:
        scene = robot_scene(file, options.site, options.axes, begin, pins, servo_hz, settle)
    except ClosureError as error:
        raise ModelError(f"{file}: {error}") from None
    model = scene.whole
    steps = max(1, math.ceil(options.period / model.opt.timestep - 1e-9))
    size = _usual_size(model, options.major) if options.size is None else options.size
    goal = _goal(len(drives(scene.own)), options)
    return Robot(scene, options, steps * model.opt.timestep, goal, size)


def _usual_size(model: mujoco.MjModel, rows: Sequence[int]) -> float:
    """Of a path in these rows, [rad] if all of them turn, else [m]."""
    return _SIZE if all(row < 3 for row in rows) else _SIZE * float(model.stat.extent)


def warnings_of(robot: Robot) -> tuple[str, ...]:
    """What the linear model and the mapping leave out."""
    scene, idle = robot.scene, robot.linear.idle
    return (
        *left_out_of(robot),
        *([f"nothing holds, and no task feels, a motion of {listed(idle)}"] if idle else ()),
        *scene.moved,
        *robot.mechanism.nominal.warnings,
        *beyond_linear(scene.own, scene.own_start),
        *robot.known.soft_locks.values(),
    )


def left_out_of(robot: Robot) -> tuple[str, ...]:
    """What of the file the task does not involve, in words; none where it involves all."""
    part = robot.scene.part
    if part is None or not part.left_out:
        return ()
    return (f"no part of the task, and left to itself: {listed(part.left_out)}",)


def _start(model: mujoco.MjModel, *, keyframe: str | None, at: Array | None) -> mujoco.MjData:
    """Joint positions (nq,), or a keyframe by name or number; neither is the first, or qpos0."""
    data = start_of(model) if at is None else mujoco.MjData(model)
    if at is not None:
        data.qpos[:] = check.array("start", at, model.nq)
    if at is not None or keyframe is None:
        return data
    numbers = {str(k): k for k in range(model.nkey)}
    numbers |= {model.key(k).name: k for k in range(model.nkey)}
    if (number := numbers.get(keyframe)) is None:
        near = nearest(keyframe, numbers, listed=True)
        raise WrongInput(f'the model has no keyframe "{keyframe:.80}"{near}')
    mujoco.mj_resetDataKeyframe(model, data, number)
    return data


def _goal(actuators: int, options: RobotOptions) -> Goal:
    """W1 and W2; with neither of them all joints weigh alike."""
    joint, others = options.joint_weight, options.secondary_weight
    if joint is None and others is None:
        joint = (1.0,)
    secondary = 6 - len(options.major)
    return Goal(
        joint_weight=_weights("joint_weight", joint, actuators),
        secondary_weight=_weights("secondary_weight", others, secondary),
    )


def _weights(name: str, values: tuple[float, ...] | None, count: int) -> tuple[float, ...] | None:
    """One weight each, as many as are wanted; one alone is that of all."""
    if values is None or len(values) == count:
        return values
    if len(values) != 1:
        raise WrongInput(f"{name} must be one number or {count}, got {len(values)}")
    return values * count
