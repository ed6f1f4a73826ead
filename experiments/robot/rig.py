"""What a robot with its loops consists of, for those who fly it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import chain
from typing import Any

import mujoco

from experiments.output.study import WrongInput
from ftc.compensator import Channel, Margins
from ftc.control_task import ControlTask
from ftc.controller import PrioritizedController
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel
from ftc.goal import Goal
from ftc.mapping import PrioritizedMapping
from ftc.supervisor import Supervisor
from prioritized import Manipulability
from sim import Array, Bench, Failure


@dataclass(frozen=True)
class Rig:
    """A robot with its loops.

    Attributes:
        title: For people.
        model: As its controller has it.
        actuators: Their names: of the joints or tendons that they drive.
        aliases: Of each, the names of the actuators in the model.
        bodies: The body that each moves, for the eye; None of what is no joint.
        major: Rows of the twist.
        goal: While all actuators work.
        nominal: Linear model from displacements to the major rows.
        watched: The same to what the diagnosis looks at.
        loops: One compensator for each of them.
        margins: Of each loop.
        limits: Lower and upper displacements (n,); None is none.
        feedforward: Whether the reference is demanded as it is.
        size: Of the path, [rad] or [m].
        noise: Of the sensors of the major rows, [rad] or [m].
        encoder_noise: Of the sensors of the actuators, [rad] or [m].
        mapping: For a goal.
        controller: For a goal.
        supervisor: A new one, with a dither or without.
        bench: The simulated machine for times (N,), failures and a seed.
        classified: What is left with these faults.
        told: The goal with one more failure, its actuator locked at a displacement.
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
    watched: NominalModel
    loops: Sequence[Channel]
    margins: Sequence[Margins]
    limits: tuple[Array, Array] | None
    feedforward: bool
    size: float
    noise: float
    encoder_noise: float
    mapping: Callable[[Goal], PrioritizedMapping[Any]]
    controller: Callable[[Goal], PrioritizedController[Any]]
    supervisor: Callable[[Dither | None], Supervisor]
    bench: Callable[[Array, Sequence[Failure], int], Bench]
    classified: Callable[[Sequence[Fault]], Manipulability]
    told: Callable[[Goal, Fault, float], Goal]
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
