"""The rig of any robot from its MJCF file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import argument_checks as check
from experiments.rig.bodies import body_name, model_name
from experiments.rig.dither import dither_of
from experiments.rig.mismatch import EXACT, Known, Mismatch, sizes_of
from experiments.rig.mismatched import ALL
from experiments.rig.options import RobotOptions
from experiments.rig.rig import Rig
from experiments.rig.robot import Robot, robot_of, warnings_of
from experiments.study.study import WrongInput
from ftc.control.mapping import PrioritizedMapping
from ftc.control_task import ControlTask
from ftc.controller import DirectDrive, PrioritizedController
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault
from ftc.goal import Goal
from ftc.supervisor import Supervisor
from ftc.tracking import TaskLost, Tracking, tracking
from prioritized import Manipulability
from sim import (
    Array,
    Bench,
    Failure,
    Plant,
)
from sim.mjcf.drive import names_of
from sim.mjcf.frame import located

OF_THE_HEXAPOD = (
    *("stiffness", "floor_um_per_s", "drift_urad_per_s"),
    *("gain_drift_per_s", "hysteresis", "timestep_s"),
)
"""Sizes of a mismatch that are of the hexapod alone."""


@dataclass(frozen=True, repr=False)
class RobotRig(Rig):
    """A robot of an MJCF file.

    Attributes:
        robot: At its start.
        track: Its loops.
        mismatch: How its plants differ from the model.
        seed: Of what is drawn of them.
    """

    robot: Robot
    track: Tracking
    mismatch: Mismatch
    seed: int

    def drawn(self, mismatch: Known | Mismatch, seed: int) -> "RobotRig":
        """The same with plants that differ so."""
        sizes = sizes_of(mismatch, ALL, OF_THE_HEXAPOD)
        return replace(self, mismatch=sizes, seed=check.index("seed", seed))

    def mapping(self, goal: Goal) -> PrioritizedMapping[Any]:
        """With the Jacobian of the present posture."""
        return self.track.mapping(goal)

    def controller(self, goal: Goal | None = None) -> PrioritizedController[Any]:
        """For a goal; None is that of the rig."""
        return self.track.controller(self._goal(goal))

    def supervisor(
        self, dither: str | Dither | None = "default", goal: Goal | None = None
    ) -> Supervisor:
        """With the dither of the command's default, unless another is asked for."""
        track = self.track if goal is None else replace(self.track, goal=self._goal(goal))
        return track.supervisor(dither=dither_of(self, dither, "default"))

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """A machine with its plant and drift, and noise of this seed."""
        return self.robot.bench(self.mismatch, time_s, failures, (self.seed, seed), events)

    @property
    def payload_body(self) -> int:
        """Of the frame that was asked for."""
        return located(self.model, "payload", self.robot.scene.frame).body

    def classified(self, faults: Sequence[Fault]) -> Manipulability:
        """What the actuators that are left can do."""
        return self.track.classified(faults)


def robot_rig(file: Path, options: RobotOptions, at: Array | None = None) -> RobotRig:
    """Any robot from its MJCF file, on its exact plant; `at` are joint positions (nq,) to start at.

    Raises:
        WrongInput: A weight or keyframe that the robot does not have; or it cannot do the task.
        sim.ModelError: The file, or what it says.
    """
    robot, rows = robot_of(file, options, at), options.rows
    plant = robot.alone
    names, limits = names_of(plant.drives), plant.limits()
    limited = options.limits == "stated" and any(np.isfinite(limit).any() for limit in limits)
    track = _tracking(robot, plant, limits if limited else None, file)
    return RobotRig(
        title=model_name(robot.model, file),
        model=robot.model,
        actuators=tuple(own for own, *_ in names),
        aliases=tuple(tuple(others) for _, *others in names),
        bodies=tuple(_body(robot.model, drive.joint) for drive in robot.known.drives),
        units=tuple(drive.unit for drive in plant.drives),
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
        unused=robot.unused,
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
        part=robot.scene.part,
        file=file,
        soft_locks=frozenset(robot.known.soft_locks),
        robot=robot,
        track=track,
        mismatch=EXACT,
        seed=0,
    )


def _tracking(
    robot: Robot, plant: Plant, limits: tuple[Array, Array] | None, file: Path
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
            springs=robot.springs_count,
            unused=robot.unused,
            feedforward=options.feedforward != "off",
            names=[own for own, *_ in names_of(plant.drives)],
        )
    except TaskLost as error:
        advice = "; try other rows (--major) or another start (--keyframe)" * error.elsewhere
        raise WrongInput(f"{file}: {error}{advice}") from None


def _body(model: mujoco.MjModel, joint: int | None) -> str | None:
    return None if joint is None else body_name(model, int(model.jnt_bodyid[joint]))
