"""Robot of an MJCF file at its start: model, sensors, goal, control period."""

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
"""Radius of the default path, in [rad] or extents of the model; the linear model holds there."""
_SPRING_SHARE = 0.5
"""Fraction of an actuator's stiffness above which its own spring holds it without force."""
_NOISE = 1e-2
"""Default sensor noise as a fraction of the signal's amplitude on the default path: the path's size
for a row, the largest displacement of any actuator for encoders."""


@dataclass(frozen=True)
class Robot:
    """Robot at its start: scene, options, control period, goal and size of its path."""

    scene: Scene
    options: RobotOptions
    period_s: float
    goal: Goal
    size: float

    @property
    def noise(self) -> float:
        """Standard deviation of one sample of each major row, [rad] or [m]."""
        if self.options.noise is not None:
            return self.options.noise
        return _NOISE * _usual_size(self.model, self.options.major)

    @cached_property
    def encoder_noise(self) -> float:
        """Standard deviation of one sample of each actuator's sensor, [rad] or [m]."""
        if self.options.noise is not None:
            return self.options.noise
        gain = mapping_for(self.mechanism, self.goal, self.options.major).major_gain()
        return self.noise * float(np.abs(gain).max())

    @property
    def deviations(self) -> Array:
        """Standard deviations of the measurements for the diagnosis: major rows, then actuators."""
        of_task = [self.noise] * len(self.options.major) * (self.options.sense != "joints")
        actuators = len(self.mechanism.nominal.displacements)
        of_encoders = [self.encoder_noise] * actuators * (self.options.sense != "task")
        return np.array(of_task + of_encoders)

    @property
    def model(self) -> mujoco.MjModel:
        """Model of the complete file."""
        return self.scene.model

    def plant(self, model: mujoco.MjModel) -> Plant:
        """Return the plant for a model of the complete file."""
        scene, axes = self.scene, self.options.axes
        return Plant(model, base=axes, payload=scene.frame, start=scene.start, part=scene.part)

    @cached_property
    def nominal_plant(self) -> Plant:
        """Nominal plant of the complete file at the start; used for gains, never stepped."""
        return self.plant(self.model)

    @cached_property
    def task_plant(self) -> Plant:
        """Nominal plant of the task's part of the model at the start; never stepped."""
        scene, axes = self.scene, self.options.axes
        if scene.part is None:
            return self.nominal_plant
        return Plant(scene.task_model, base=axes, payload=scene.frame, start=scene.task_start)

    @cached_property
    def linear(self) -> LinearPlant:
        """Linear model of the task's part about the start."""
        return self.task_plant.linear()

    @cached_property
    def mechanism(self) -> Mechanism:
        """Controller's own model of the task's part, shared because it has no state."""
        return self._mechanism(springs=True) if self.springs_determine else self.rigid

    @cached_property
    def unused(self) -> Unused:
        """Behavior of unused actuators: "locked" if all springs hold them, else "free"."""
        return "locked" if (self.task_plant.spring_share > _SPRING_SHARE).all() else "free"

    @property
    def springs_count(self) -> bool:
        """True if classifications are those of the elastic mechanism."""
        # Without springs, a free strut or a finger on one cable would count as lost.
        return self.unused == "locked" or self.springs_determine

    @cached_property
    def springs_determine(self) -> bool:
        """True if springs, rather than actuators and loops, determine the major rows."""
        jac, major = self.rigid.nominal, list(self.options.major)
        rigid = ConstrainedSystem.of(jac).kinematics().manipulability(major)
        if not rigid.unstable_major or jac.stiffness is None:
            return False
        return is_possible(ConstrainedSystem.of(jac, True).kinematics().manipulability(major))

    @cached_property
    def rigid(self) -> Mechanism:
        """Controller's own model without springs."""
        return self._mechanism(springs=False)

    def _mechanism(self, *, springs: bool) -> Mechanism:
        scene, axes = self.scene, self.options.axes
        return Mechanism(scene.task_model, scene.task_start, scene.frame, axes, springs=springs)


def robot_of(
    file: Path, options: RobotOptions, at: Array | None = None, *, settle: bool = True
) -> Robot:
    """Return the robot of a file at joint positions `at` (nq,), or at its keyframe if None.

    `settle` is the argument of :func:`sim.scene.robot_scene`.

    Raises:
        WrongInput: The robot lacks the keyframe, or has another number of weights.
        sim.ModelError: The file cannot be read, or its model is unsuitable.
    """
    start = partial(_start, keyframe=options.keyframe, at=at)
    names = [(name, name.removesuffix(":point")) for name in options.pinned or ()]
    pins, servo_hz = [Pin(frame, weld=name == frame) for name, frame in names], options.servo
    try:
        scene = robot_scene(file, options.site, options.axes, start, pins, servo_hz, settle)
    except ClosureError as error:
        raise ModelError(f"{file}: {error}") from None
    model = scene.model
    steps = max(1, math.ceil(options.period / model.opt.timestep - 1e-9))
    size = _usual_size(model, options.major) if options.size is None else options.size
    goal = _goal(len(drives(scene.task_model)), options)
    return Robot(scene, options, steps * model.opt.timestep, goal, size)


def _usual_size(model: mujoco.MjModel, rows: Sequence[int]) -> float:
    return _SIZE if all(row < 3 for row in rows) else _SIZE * float(model.stat.extent)


def warnings_of(robot: Robot) -> tuple[str, ...]:
    """Return sentences on what the linear model and the mapping leave out."""
    scene, free = robot.scene, robot.linear.unobservable_joints
    return (
        *left_out_of(robot),
        *([f"neither forces nor the task determine {listed(free)}"] if free else ()),
        *scene.start_warnings,
        *robot.mechanism.nominal.warnings,
        *beyond_linear(scene.task_model, scene.task_start),
        *robot.nominal_plant.soft_locks.values(),
    )


def left_out_of(robot: Robot) -> tuple[str, ...]:
    """Return a sentence that names the joints or bodies outside the task, if there are any."""
    part = robot.scene.part
    if part is None or not part.left_out:
        return ()
    return (f"not part of the task, and not controlled: {listed(part.left_out)}",)


def _start(model: mujoco.MjModel, *, keyframe: str | None, at: Array | None) -> mujoco.MjData:
    """Return the state at positions (nq,), at a keyframe by name or number, or at the default."""
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
    joint, others = options.joint_weight, options.secondary_weight
    if joint is None and others is None:
        joint = (1.0,)
    secondary = 6 - len(options.major)
    return Goal(
        joint_weight=_weights("joint_weight", joint, actuators),
        secondary_weight=_weights("secondary_weight", others, secondary),
    )


def _weights(name: str, values: tuple[float, ...] | None, count: int) -> tuple[float, ...] | None:
    if values is None or len(values) == count:
        return values
    if len(values) != 1:
        raise WrongInput(f"{name} must be one number or {count}, got {len(values)}")
    return values * count
