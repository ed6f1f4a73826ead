"""MuJoCo's own warnings: to the log, not into a file; and which of them mean divergence."""

import logging
from typing import Any

import mujoco
import numpy as np

_NOT_FINITE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
    mujoco.mjtWarning.mjWARN_BADCTRL,
)
"""MuJoCo clears the controls after the last, and resets the state, its time too, after others."""

_log = logging.getLogger(__name__)


def divergences(data: mujoco.MjData) -> list[Any]:
    """Counters of a state that say that it left the finite numbers; the last is of its controls."""
    return [data.warning[kind] for kind in _NOT_FINITE]


def has_diverged(data: mujoco.MjData) -> bool:
    """Whether a state left the finite numbers since it was made or reset."""
    counted = any(counter.number for counter in divergences(data))
    return counted or not bool(np.isfinite(data.qvel).all())


def log_warnings() -> None:
    """Send MuJoCo's warnings to the logger `sim.warning`, unless the program has its own handler.

    Without a handler MuJoCo writes them into MUJOCO_LOG.TXT in the current folder. A program that
    does not configure logging sees them on standard error.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.warning)
