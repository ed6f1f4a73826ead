"""MuJoCo's own warnings: to the log, not into a file; and which of them mean divergence."""

import logging

import mujoco

NOT_FINITE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
    mujoco.mjtWarning.mjWARN_BADCTRL,
)
"""After one of these MuJoCo starts a state again at qpos0 and at time zero."""

_log = logging.getLogger(__name__)


def has_diverged(data: mujoco.MjData) -> bool:
    """Whether a state left the finite numbers since it was made or reset."""
    return any(data.warning[kind].number for kind in NOT_FINITE)


def log_warnings() -> None:
    """Send MuJoCo's warnings to the logger `sim.warning`, unless the program has its own handler.

    Without a handler MuJoCo writes them into MUJOCO_LOG.TXT in the current folder. A program that
    does not configure logging sees them on standard error.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.warning)
