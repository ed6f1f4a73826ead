"""What a wrong diagnosis can do: every failure against every belief, in the linear model."""

from collections.abc import Sequence
from dataclasses import dataclass

import control
import mujoco
import numpy as np
import scipy.linalg

from experiments.hexapod.compensator import Loop
from experiments.hexapod.goal import MAJOR, Goal
from experiments.hexapod.mapping import StrutMapping
from experiments.hexapod.prediction import peak_of_sensitivity
from experiments.hexapod.supervisor import WEAKEST
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import GOAL
from ftc.fdi.fault_model import KINDS, Fault, SoundMachine, failed_machine, sound_machine
from sim import Array, hexapod

HALF = 0.5
"""Of the force that a weak coil has left."""


@dataclass(frozen=True)
class Belief:
    """The loop when this is so and that is believed; None is a sound machine.

    Attributes:
        truth: What has failed.
        believed: What the mapping was told.
        largest_pole: Largest size of a closed-loop pole; below 1 is stable.
        sensitivity_peak: Of the largest singular value of the sensitivity.
    """

    truth: Fault | None
    believed: Fault | None
    largest_pole: float
    sensitivity_peak: float


def beliefs(
    model: mujoco.MjModel, bench: Bench, loops: tuple[Loop, Loop], struts: Sequence[int]
) -> list[Belief]:
    """All failures of one of these struts or none, under all beliefs about one strut or none."""
    sound = sound_machine(model, bench)
    compensators = control.append(*(loop.discrete for loop in loops))
    truths = [None, *(Fault(k, kind, HALF) for kind in KINDS for k in struts)]
    told = [None, *(Fault(k, kind, WEAKEST) for kind in ("locked", "weak") for k in range(6))]
    gains = [_gain(model, believed) for believed in told]
    found = []
    for truth in truths:
        P = _machine(sound, truth)
        for believed, gain in zip(told, gains, strict=True):
            L = control.ss(P.A, P.B @ gain, P.C, 0, P.dt) * compensators
            found.append(Belief(truth, believed, _largest_pole(L), peak_of_sensitivity(L)))
    return found


def _gain(model: mujoco.MjModel, believed: Fault | None) -> Array:
    """Commanded strut displacements per (alpha, beta), shape (6, 2)."""
    goal: Goal = GOAL
    strength = np.ones(6)
    if believed is not None and believed.kind == "weak":
        strength[believed.strut] = believed.strength
    elif believed is not None:
        goal = Goal(GOAL.joint_weight, locked_m={believed.strut: 0.0})
    return StrutMapping(hexapod(model), goal, "constant").pointing_gain() / strength[:, None]


def _machine(sound: SoundMachine, truth: Fault | None) -> control.StateSpace:
    """From commands to pointing, on the coordinates that a lock leaves."""
    faults = [] if truth is None else [truth]
    machine = failed_machine(sound, faults)
    stuck = [fault.strut for fault in faults if fault.kind == "locked"]
    linear, k = sound.linear, len(sound.linear.A) // 2
    left = scipy.linalg.null_space(linear.C_active[stuck, :k]) if stuck else np.eye(k)
    Q = scipy.linalg.block_diag(left, left)
    C = linear.C_twist[MAJOR] @ Q
    return control.ss(Q.T @ machine.A @ Q, Q.T @ machine.B, C, 0, sound.period_s)


def _largest_pole(L: control.StateSpace) -> float:
    return float(np.abs(control.feedback(L, np.eye(2)).poles()).max())
