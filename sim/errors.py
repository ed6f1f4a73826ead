"""Errors of the simulation, MuJoCo's warnings, and the warnings that mean divergence."""

import logging
from math import isfinite
from typing import Any

import mujoco
from scipy.linalg.blas import dnrm2

from sim.array import Array

_KIND = mujoco.mjtWarning
BAD_CONTROL = int(_KIND.mjWARN_BADCTRL)
_NOT_FINITE = slice(int(_KIND.mjWARN_BADQPOS), BAD_CONTROL + 1)
"""Counters of MuJoCo's warnings of non-finite numbers; after BADCTRL it clears the controls,
after the others it resets the state, time included."""

_log = logging.getLogger("sim")


class ModelError(ValueError):
    """Error for an MJCF file or model that cannot be used; the message names the element."""


class ClosureError(ModelError):
    """Error for a closure, or a held or pinned element, whose gap does not close."""

    def __init__(self, equality: str, gap: float, unit: str, advice: str) -> None:
        """Take the name of the open element, its gap in "m" or "rad", and advice."""
        super().__init__(equality, gap, unit, advice)  # so that it survives pickling
        self.equality, self.gap, self.unit, self.advice = equality, gap, unit, advice

    def __str__(self) -> str:
        return f"{self.equality} is open by {self.gap:.3g} {self.unit}: {self.advice}"


class SimulationDiverged(RuntimeError):
    """Error for a simulation that produced, or was given, numbers that MuJoCo does not accept.

    Attributes:
        time_s: Simulated time of its detection [s].
        state: Last finite state at a control period (mjSTATE_INTEGRATION), for a restart.
        what: What happened, as the rest of a sentence on the simulation.
    """

    def __init__(self, time_s: float, state: Array, what: str = "became non-finite") -> None:
        # All in `args`, so that the exception can be pickled in a worker process.
        super().__init__(time_s, state, what)
        self.time_s, self.state, self.what = time_s, state, what

    def __str__(self) -> str:
        return f"the simulation {self.what} at t = {self.time_s:.4f} s"


def has_diverged(data: mujoco.MjData) -> bool:
    """Return whether the state has become non-finite since it was created or reset."""
    counts: Any = data.warning  # MuJoCo's stubs do not have the vector of all
    counted = any(counts.number.tolist()[_NOT_FINITE])
    return counted or not isfinite(dnrm2(data.qpos) + dnrm2(data.qvel))


def log_warnings() -> None:
    """Send MuJoCo's warnings to the logger `sim`, unless the program has its own handler.

    Without a handler MuJoCo writes them into MUJOCO_LOG.TXT in the current folder.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.warning)
