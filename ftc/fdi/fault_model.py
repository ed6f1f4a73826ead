"""The linear machine with failed struts, derived from the sound one that the controller knows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
import scipy.linalg

from experiments.hexapod.testbed import Bench
from sim import Array, Failure, LinearPlant, Plant, linearize

Kind = Literal["locked", "free", "weak"]
"""Stuck where it is; without coil; with a part of its coil's force."""

KINDS: tuple[Kind, ...] = ("locked", "free", "weak")


@dataclass(frozen=True)
class Fault:
    """What is wrong with one strut.

    Attributes:
        strut: 0..5.
        kind: See :data:`Kind`.
        strength: Part of the coil's force that a weak one has left.
    """

    strut: int
    kind: Kind
    strength: float = 0.0

    def __str__(self) -> str:
        left = f" to {100 * self.strength:.0f} %" if self.kind == "weak" else ""
        return f"strut {self.strut + 1} {self.kind}{left}"


def fault_of(failure: Failure) -> Fault:
    """What there is to find when this happens.

    Raises:
        ValueError: A strut that breaks loose is not among the kinds that are looked for.
    """
    if failure.kind == "loose":
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {failure.kind}")
    return Fault(failure.strut, failure.kind, failure.strength if failure.kind == "weak" else 0.0)


@dataclass(frozen=True)
class SoundMachine:
    """What the diagnosis knows of the machine.

    Attributes:
        linear: About its rest, nothing failed.
        period_s: Between control ticks.
        step_s: Of the physics. Its positions run half a step ahead of the exact motion, which is
            five times a gauge's noise when a strut jumps: the diagnosis steps alike.
    """

    linear: LinearPlant
    period_s: float
    step_s: float

    @property
    def struts(self) -> int:
        """Number of them."""
        return len(self.linear.C_active)


def sound_machine(model: mujoco.MjModel, bench: Bench) -> SoundMachine:
    """From the model of a machine without failures."""
    plant = Plant(model)
    linear = linearize(plant.model, plant.data)
    return SoundMachine(linear, bench.control_period_s, float(model.opt.timestep))


@dataclass(frozen=True)
class Machine:
    """x' = A x + B u from tick to tick, with u the commanded strut displacements.

    Attributes:
        A: Shape (s, s).
        B: Shape (s, 6).
        onset: The state just after the faults have struck, per state just before, shape (s, s):
            a strut that locks stops, and the impact goes through the whole machine.
    """

    A: Array
    B: Array
    onset: Array

    def step(self, x: Array, sent_m: Array) -> Array:
        """The state one tick later, with displacements (6,) commanded meanwhile."""
        return self.A @ x + self.B @ sent_m


def failed_machine(sound: SoundMachine, faults: Sequence[Fault]) -> Machine:
    """The machine from tick to tick, in the coordinates of the sound one.

    A coil without force drives nothing. A locked strut is a constraint c y_dot = 0 on the
    coordinates y, c its row of C_active: its force acts along M^-1 c^T, which is where its coil
    pushes, so the accelerations are projected by P = I - b (c b)^-1 c. The frozen displacement
    stays in the state.
    """
    linear = sound.linear
    k = len(linear.A) // 2
    drive = linear.B[k:].copy()
    locked = [fault.strut for fault in faults if fault.kind == "locked"]
    b, c = linear.B[k:, locked], linear.C_active[locked, :k]
    P = np.eye(k) - b @ np.linalg.solve(c @ b, c)
    for fault in faults:
        if fault.kind != "locked":
            drive[:, fault.strut] *= fault.strength if fault.kind == "weak" else 0.0
    # One step of the physics: velocities first, then positions with the new ones.
    h, eye = sound.step_s, np.eye(k)
    stiffness, damping, drive = (
        h * P @ part for part in (linear.A[k:, :k], linear.A[k:, k:], drive)
    )
    A = np.block([[eye + h * stiffness, h * (eye + damping)], [stiffness, eye + damping]])
    B = np.vstack([h * drive, drive])
    steps = round(sound.period_s / h)
    held = sum(np.linalg.matrix_power(A, step) for step in range(steps)) @ B
    return Machine(np.linalg.matrix_power(A, steps), held, scipy.linalg.block_diag(eye, P))
