"""Errors of the simulation: unusable models and diverged runs."""

import numpy as np
from numpy.typing import NDArray


class ModelError(ValueError):
    """An MJCF file or model that cannot be used; the message names the thing."""


class SimulationDiverged(RuntimeError):
    """The simulation produced non-finite numbers.

    Attributes:
        time_s: Simulation time at which it was noticed.
        state: MuJoCo's integration state (mjSTATE_INTEGRATION; its first number is the time) one
            control period before, the last that was finite: to go on from there and look.
    """

    def __init__(self, time_s: float, state: NDArray[np.float64]) -> None:
        # Both in `args`, so that the exception survives the way out of a worker process.
        super().__init__(time_s, state)
        self.time_s = time_s
        self.state = state

    def __str__(self) -> str:
        return f"the simulation became non-finite at t = {self.time_s:.4f} s"
