"""LQG with integral action: the comparison controller of docs/control-without-simulator.md."""

from typing import Any, NamedTuple

import control
import numpy as np


class LQGState(NamedTuple):
    """Inputs to the drives, integral of reference minus output, and estimated plant state."""

    inputs: np.ndarray
    integral: np.ndarray
    plant: np.ndarray


class LQG:
    """MIMO, with the exact linear model of the plant and weights by Bryson's rule."""

    def __init__(self, task: Any):
        plant: Any = control.c2d(task.nominal.plant, task.period_s, "zoh")
        self.A, self.B, self.C, self.drives = plant.A, plant.B.copy(), plant.C, task.drives
        self.B[:, list(task.goal.locked_at)] = 0.0
        (s, n), m = self.B.shape, len(self.C)
        A = np.block([[self.A, np.zeros((s, m))], [-self.C, np.eye(m)]])
        Q = np.diag([0.0] * s + [*(0.1 / task.reference_limit) ** 2])
        R = np.diag(10.0 / task.limits[1] ** 2)
        self.K, _, _ = control.dlqr(A, np.vstack([self.B, np.zeros((m, n))]), Q, R)
        noise = 1e-7**2 * np.eye(n), np.diag(task.nominal.noise**2)  # struts 0.1 um a tick; sensors
        self.L, _, _ = control.dlqe(self.A, self.B, self.C, *noise)

    def start(self) -> LQGState:
        s, n = self.B.shape
        return LQGState(np.zeros(n), np.zeros(len(self.C)), np.zeros(s))

    def step(self, state: LQGState, reference: Any, measurement: Any) -> LQGState:
        u = self.drives.inputs(-self.K @ np.concatenate([state.plant, state.integral]))
        x = self.A @ state.plant + self.B @ self.drives.displacements(u)
        x = x + self.L @ (measurement.output - self.C @ state.plant)
        return LQGState(u, state.integral + reference - measurement.output, x)
