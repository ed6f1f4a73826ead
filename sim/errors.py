"""Errors of the simulation: unusable models and diverged runs."""

import numpy as np
from numpy.typing import NDArray


class ModelError(ValueError):
    """An MJCF file or model that cannot be used; the message names the thing."""


class ClosureError(ModelError):
    """An equality is open farther than it may be, or no pose nearby closes it.

    Attributes:
        equality: Which one, in words; or what is held or pinned.
        gap: How far it is open, [m] or [rad].
    """

    def __init__(self, equality: str, gap: float, advice: str) -> None:
        """Say what is open, by how much, and what to try."""
        super().__init__(equality, gap, advice)  # so that it survives pickling
        self.equality, self.gap, self.advice = equality, gap, advice

    def __str__(self) -> str:
        return f"{self.equality} is open by {self.gap:.3g} (m or rad): {self.advice}"


class SimulationDiverged(RuntimeError):
    """The simulation produced non-finite numbers, or was given some that MuJoCo does not take.

    Attributes:
        time_s: Simulation time at which it was noticed.
        state: MuJoCo's integration state (mjSTATE_INTEGRATION; its first number is the time) one
            control period before, the last that was finite: to go on from there and look.
        what: That happened, in words.
    """

    def __init__(
        self, time_s: float, state: NDArray[np.float64], what: str = "became non-finite"
    ) -> None:
        # All in `args`, so that the exception survives the way out of a worker process.
        super().__init__(time_s, state, what)
        self.time_s, self.state, self.what = time_s, state, what

    def __str__(self) -> str:
        return f"the simulation {self.what} at t = {self.time_s:.4f} s"
