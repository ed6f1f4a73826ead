"""A robot with its loops, ready to run: the hexapod of the testbed, or any MJCF file."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import chain
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from experiments.hexapod.columns import COLUMNS, MAJOR
from experiments.hexapod.controller import StrutMapping, nominal_loops
from experiments.hexapod.fault_tolerance import elastic_system, nominal_model, supervisor
from experiments.hexapod.other_controller import control_task
from experiments.hexapod.simulation import simulated
from experiments.hexapod.testbed import Testbed, TestbedConfig
from experiments.output.recording.mechanism import body_name
from experiments.output.study import WrongInput
from ftc.compensator import Channel, Margins
from ftc.control_task import ControlTask
from ftc.controller import DirectDrive
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault, NominalModel, by_kind
from ftc.goal import Goal
from ftc.mapping import PrioritizedMapping
from ftc.supervisor import Supervisor, reconfigured_goal
from ftc.tracking import TaskLost, goal_told, tracking
from prioritized import Manipulability
from sim import (
    Array,
    Bench,
    Body,
    ClosureError,
    Failure,
    JointSensors,
    Mechanism,
    ModelError,
    Plant,
    TaskSensor,
    assemble,
    hexapod,
    load_model,
    servoed,
)

_SIZE = 1e-3
"""Of a path, in radians or extents of the model: so small that the linear model holds."""
_NOISE = 1e-2
"""Of a sensor, in sizes of the path."""


@dataclass(frozen=True)
class Rig:
    """A robot with its loops.

    Attributes:
        title: For people.
        model: As its plant and its controller have it.
        actuators: Their names: of the joints or tendons that they drive.
        aliases: Of each, the names of the actuators in the model.
        bodies: The body that each moves, for the eye; None of what is no joint.
        major: Rows of the twist.
        goal: While all actuators work.
        nominal: Linear model from displacements to the major rows.
        loops: One compensator for each of them.
        margins: Of each loop.
        limits: Lower and upper displacements (n,); None is none.
        feedforward: Whether the reference is demanded as it is.
        size: Of the path, [rad] or [m].
        noise: Of the sensors, [rad] or [m].
        mapping: For a goal.
        supervisor: A new one.
        bench: The simulated machine for times (N,), failures and a seed.
        classified: What is left with these faults.
        told: The goal with one more failure.
        task: What somebody else's controller is told.
    """

    title: str
    model: mujoco.MjModel
    actuators: tuple[str, ...]
    aliases: tuple[tuple[str, ...], ...]
    bodies: tuple[str | None, ...]
    major: tuple[int, ...]
    goal: Goal
    nominal: NominalModel
    loops: Sequence[Channel]
    margins: Sequence[Margins]
    limits: tuple[Array, Array] | None
    feedforward: bool
    size: float
    noise: float
    mapping: Callable[[Goal], PrioritizedMapping[Any]]
    supervisor: Callable[[], Supervisor]
    bench: Callable[[Array, Sequence[Failure], int], Bench]
    classified: Callable[[Sequence[Fault]], Manipulability]
    told: Callable[[Goal, Fault], Goal]
    task: ControlTask

    @property
    def period_s(self) -> float:
        """Of control."""
        return self.nominal.period_s

    def actuator(self, name: str) -> int:
        """The number of an actuator by its own name, or by that of its joint.

        Raises:
            WrongInput: There is none; the nearest is named.
        """
        if name in self.actuators:
            return self.actuators.index(name)
        for number, own in enumerate(self.aliases):
            if name in own:
                return number
        near = get_close_matches(name, [*self.actuators, *chain(*self.aliases)], 1)
        hint = f'did you mean "{near[0]}"?' if near else f"it has {', '.join(self.actuators)}"
        raise WrongInput(f'--fail {name}: the robot has no actuator or joint "{name}"; {hint}')


def hexapod_rig(size: float | None) -> Rig:
    """The testbed's own machine: detector, amplifiers, closed-form kinematics, goal W_a.

    `size` is the radius of its path, [rad]; None is that of the testbed's spiral.
    """
    model, bench = load_model(), TestbedConfig()
    loops = nominal_loops(model, bench)
    testbed, goal = Testbed(model, bench, loops), COLUMNS[0].goal
    geometry, elastic = hexapod(model), elastic_system(model)

    def classified(faults: Sequence[Fault]) -> Manipulability:
        return elastic.with_failures(**by_kind(faults)).kinematics().manipulability(MAJOR)

    return Rig(
        title="University of Wyoming hexapod",
        model=model,
        actuators=tuple(f"strut{k}" for k in range(1, 7)),
        aliases=tuple((f"coil{k}",) for k in range(1, 7)),
        bodies=tuple(f"stem{k}" for k in range(1, 7)),
        major=tuple(MAJOR),
        goal=goal,
        nominal=nominal_model(model, bench),
        loops=loops,
        margins=loops,
        limits=None,
        feedforward=False,
        size=bench.spiral_radius_urad * 1e-6 if size is None else size,
        noise=bench.detector_noise_m / bench.focal_length_m,
        mapping=lambda known: StrutMapping(geometry, known, "constant"),
        supervisor=lambda: supervisor(testbed, goal),
        bench=lambda time_s, failures, seed: simulated(
            testbed, time_s, failures, seed, keep_qpos=True
        ),
        classified=classified,
        told=_told_hexapod,
        task=control_task(testbed, goal),
    )


def _told_hexapod(goal: Goal, fault: Fault) -> Goal:
    return reconfigured_goal(goal, [Diagnosis.told(fault)])


def robot_rig(
    file: Path,
    *,
    site: str,
    axes: str | None,
    major: tuple[int, ...],
    size: float | None,
    sense: str,
    noise: float | None,
    crossover_hz: float | None,
    period_s: float,
    joint_weight: str | None,
    secondary_weight: str | None,
    limited: bool,
    keyframe: str | None,
    servo_hz: float | None,
) -> Rig:
    """Any robot from its MJCF file; the arguments are those of the command.

    Raises:
        WrongInput: A weight or keyframe that the robot does not have; or it cannot do the task.
        sim.ModelError: The file, or what it says.
    """
    model = load_model(file, add_locks=True)
    start = _start(model, keyframe)
    if servo_hz is not None:
        model = servoed(model, natural_frequency_hz=servo_hz, data=start)
        start = _start(model, keyframe)
    try:
        start = assemble(model, start)
    except ClosureError as error:
        raise ModelError(f"{file}: {error}") from None
    frame: str | Body = site
    if all(model.site(k).name != site for k in range(model.nsite)):
        frame = Body(site)
    plant = Plant(model, base=axes, payload=frame, start=start)
    steps = max(1, math.ceil(period_s / model.opt.timestep - 1e-9))
    period_s = steps * model.opt.timestep
    mechanism = Mechanism(model, start, frame, axes)
    goal = _goal(len(plant.drives), 6 - len(major), joint_weight, secondary_weight)
    turns = all(row < 3 for row in major)
    size = (_SIZE if turns else _SIZE * float(model.stat.extent)) if size is None else size
    noise = _NOISE * size if noise is None else noise
    limits = plant.limits() if limited else None
    if limits is not None and not np.isfinite(limits).any():
        limits = None
    try:
        track = tracking(
            mechanism,
            plant.linear(),
            major,
            noise=noise,
            period_s=period_s,
            step_s=float(model.opt.timestep),
            goal=goal,
            crossover_hz=crossover_hz,
            sense="joints" if sense == "joints" else "task",
            limits=limits,
            implicit_damping=plant.implicit_damping,
        )
    except TaskLost as error:
        raise WrongInput(f"{file}: {error}") from None

    def bench(time_s: Array, failures: Sequence[Failure], seed: int) -> Bench:
        sensors = (
            JointSensors(mechanism, major, noise, seed)
            if sense == "joints"
            else TaskSensor(major, noise, noise, seed)
        )
        machine = Plant(model, base=axes, payload=frame, start=start)
        options = {"time_s": time_s, "period_s": period_s, "failures": failures}
        return Bench(machine, sensors, **options, keep_qpos=True)

    return Rig(
        title=file.stem,
        model=model,
        actuators=tuple(drive.name for drive in plant.drives),
        aliases=tuple(drive.actuators for drive in plant.drives),
        bodies=tuple(
            None if drive.joint is None else body_name(model, int(model.jnt_bodyid[drive.joint]))
            for drive in plant.drives
        ),
        major=major,
        goal=goal,
        nominal=track.nominal,
        told=goal_told,
        loops=track.loops,
        margins=track.margins,
        limits=limits,
        feedforward=True,
        size=size,
        noise=noise,
        mapping=track.mapping,
        supervisor=track.supervisor,
        bench=bench,
        classified=track.classified,
        task=ControlTask(
            nominal=track.nominal,
            J=track.system.kinematics().J,
            major=major,
            goal=goal,
            drives=DirectDrive(),
            limits_m=plant.limits(),
            reference_limit=np.full(len(major), size),
        ),
    )


def _start(model: mujoco.MjModel, keyframe: str | None) -> mujoco.MjData:
    """The state of a keyframe by name or number; None is the first, or qpos0."""
    data = mujoco.MjData(model)
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


def _goal(n: int, secondary: int, joint: str | None, others: str | None) -> Goal:
    """W1 and W2; with neither of them all joints weigh alike."""
    if joint is None and others is None:
        joint = "1"
    return Goal(
        joint_weight=None if joint is None else _weights("--joint-weight", joint, n),
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
