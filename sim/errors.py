"""Errors of the simulation, MuJoCo's own warnings, and which of these mean divergence."""

import logging
from math import isfinite
from typing import Any

import mujoco
from scipy.linalg.blas import dnrm2

from sim.array import Array

_KIND = mujoco.mjtWarning
BAD_CONTROL = int(_KIND.mjWARN_BADCTRL)
_NOT_FINITE = slice(int(_KIND.mjWARN_BADQPOS), BAD_CONTROL + 1)
"""MuJoCo clears the controls after the last, and resets the state, its time too, after others."""

_log = logging.getLogger("sim")


class ModelError(ValueError):
    """An MJCF file or model that cannot be used; the message names the thing."""


class ClosureError(ModelError):
    """An equality, or what is held or pinned, is open by a gap [m] or [rad], and stays so."""

    def __init__(self, equality: str, gap: float, advice: str) -> None:
        """Say what is open, by how much, and what to try."""
        super().__init__(equality, gap, advice)  # so that it survives pickling
        self.equality, self.gap, self.advice = equality, gap, advice

    def __str__(self) -> str:
        return f"{self.equality} is open by {self.gap:.3g} (m or rad): {self.advice}"


class SimulationDiverged(RuntimeError):
    """The simulation produced non-finite numbers, or was given some that MuJoCo does not take.

    Attributes:
        time_s: When it was noticed.
        state: The last finite state at a control period (mjSTATE_INTEGRATION), to go on from.
        what: What happened, in words.
    """

    def __init__(self, time_s: float, state: Array, what: str = "became non-finite") -> None:
        # All in `args`, so that the exception survives the way out of a worker process.
        super().__init__(time_s, state, what)
        self.time_s, self.state, self.what = time_s, state, what

    def __str__(self) -> str:
        return f"the simulation {self.what} at t = {self.time_s:.4f} s"


def has_diverged(data: mujoco.MjData) -> bool:
    """Whether a state left the finite numbers since it was made or reset."""
    counts: Any = data.warning  # MuJoCo's stubs do not have the vector of all
    counted = any(counts.number.tolist()[_NOT_FINITE])
    return counted or not isfinite(dnrm2(data.qpos) + dnrm2(data.qvel))


def log_warnings() -> None:
    """Send MuJoCo's warnings to the logger `sim`, unless the program has its own handler.

    Without a handler MuJoCo writes them into MUJOCO_LOG.TXT in the current folder.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.warning)
