"""The linear plant with faulty actuators, derived from the fault-free one that is known."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import control
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array

FaultKind = Literal["locked", "free", "weak"]
"""Stuck where it is; without force; with a part of its force."""

KINDS: tuple[FaultKind, ...] = get_args(FaultKind)


@dataclass(frozen=True)
class Fault:
    """Fault of one actuator.

    Attributes:
        actuator: 0..n-1.
        kind: See :data:`FaultKind`.
        effectiveness: Part of its force that a weak actuator has left, in 0..1.

    Raises:
        ValueError: No such kind, a negative actuator, or no such part.
    """

    actuator: int
    kind: FaultKind
    effectiveness: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            known = ", ".join(KINDS)
            raise ValueError(f"kind must be one of {known}, got {check.shown(self.kind)}")
        check.index("actuator", self.actuator)
        check.at_most_one("effectiveness", self.effectiveness)


@dataclass(frozen=True)
class NominalModel:
    """Model of the plant without faults.

    Attributes:
        plant: Continuous, from the n commanded displacements to the p measured outputs, without
            feedthrough; states [q; q_dot], the positions q relative to the equilibrium.
        displacement: Of each actuator, per state, shape (n, s).
        noise: Standard deviation of each output's white noise, shape (p,).
        period_s: Between control ticks.
        step_s: Of the semi-implicit Euler integration, velocities before positions. The positions
            of a simulated plant run half a step ahead of the exact motion, which may be several
            times a sensor's noise when an actuator jumps: the model is stepped in the same way.

    Raises:
        ValueError, TypeError: Of another shape or kind than that.
    """

    plant: control.StateSpace
    displacement: Array
    noise: Array
    period_s: float
    step_s: float

    def __post_init__(self) -> None:
        plant = check.instance("plant", self.plant, control.StateSpace)
        k = plant.nstates // 2
        mechanical = np.array_equal(plant.A[:k], np.eye(k, 2 * k, k)) and not plant.B[:k].any()
        if not mechanical or plant.D.any() or not plant.isctime():
            raise ValueError(
                "plant must be continuous with states [q; q_dot] and no feedthrough, got "
                f"{check.shown(plant)}"
            )
        check.exactly("displacement", self.displacement, plant.ninputs, plant.nstates)
        for sigma in check.exactly("noise", self.noise, plant.noutputs):
            check.positive("noise", sigma)
        check.positive("step_s", self.step_s)
        if not self.step_s <= check.positive("period_s", self.period_s):
            raise ValueError(f"step_s must not exceed period_s, got {self.step_s}, {self.period_s}")

    @property
    def actuators(self) -> int:
        """Number of them, n."""
        return self.plant.ninputs

    def with_gains(self, gains: ArrayLike) -> "NominalModel":
        """The model with the gain of each actuator multiplied, `gains` of shape (n,)."""
        plant = self.plant
        B = plant.B * np.asarray(gains)
        return replace(self, plant=control.ss(plant.A, B, plant.C, plant.D))


@dataclass(frozen=True)
class FaultModel:
    """x' = A x + B u from tick to tick, u the commanded displacements; outputs y = C x.

    Attributes:
        A: Shape (s, s).
        B: Shape (s, n).
        C: Outputs in units of their noise ("whitened"), shape (p, s).
        onset: The state just after the onset of the faults, per state just before, shape (s, s):
            an actuator that locks stops, and the impact goes through the whole mechanism.
    """

    A: Array
    B: Array
    C: Array
    onset: Array

    def step(self, x: Array, commanded: Array) -> Array:
        """The state one tick later, with displacements (n,) commanded meanwhile."""
        return self.A @ x + self.B @ commanded

    def states(self, commanded: Array, start: Array | None = None) -> Array:
        """The states before, between and after N commands, shape (N + 1, s).

        Args:
            commanded: Displacements held for a tick each, shape (N, n); or (N, n, c) for c
                sequences of commands at once, and the states are (N + 1, s, c).
            start: The first state; None is rest.
        """
        x = np.zeros((len(self.A), *commanded.shape[2:])) if start is None else start
        states = [x]
        for u in commanded:
            x = self.step(x, u)
            states.append(x)
        return np.array(states)

    def outputs(self, commanded: Array) -> Array:
        """Whitened outputs (N, p) at the ticks from which on commands (N, n) hold, from rest.

        Several sequences at once as in :meth:`states`: (N, p, c).
        """
        return np.array([self.C @ x for x in self.states(commanded)[:-1]])


def fault_model(nominal: NominalModel, faults: Sequence[Fault] = ()) -> FaultModel:
    """The plant with these faults from tick to tick, in the coordinates of the fault-free one.

    An actuator without force drives nothing. A locked one is a constraint c q_dot = 0, c its row
    of `displacement`: the constraint force acts along M^-1 c^T, as the actuator's own does, so the
    accelerations are projected by P = I - b (c b)^-1 c. The frozen displacement stays in the state.
    """
    plant = nominal.plant
    k = plant.nstates // 2
    drive = plant.B[k:].copy()
    locked = [fault.actuator for fault in faults if fault.kind == "locked"]
    b, c = plant.B[k:, locked], nominal.displacement[locked, :k]
    P = np.eye(k) - b @ np.linalg.solve(c @ b, c)
    for fault in faults:
        if fault.kind != "locked":
            drive[:, fault.actuator] *= fault.effectiveness if fault.kind == "weak" else 0.0
    # One step of the integration: velocities first, then positions with the new ones.
    h, eye = nominal.step_s, np.eye(k)
    stiffness, damping, drive = (h * P @ part for part in (plant.A[k:, :k], plant.A[k:, k:], drive))
    A = np.block([[eye + h * stiffness, h * (eye + damping)], [stiffness, eye + damping]])
    B = np.vstack([h * drive, drive])
    steps = round(nominal.period_s / h)
    held = sum(np.linalg.matrix_power(A, step) for step in range(steps)) @ B
    return FaultModel(
        A=np.linalg.matrix_power(A, steps),
        B=held,
        C=plant.C / nominal.noise[:, None],
        onset=scipy.linalg.block_diag(eye, P),
    )
