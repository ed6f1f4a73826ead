"""MuJoCo's own warnings: to the log, not into a file of the current folder."""

import logging

import mujoco

_log = logging.getLogger(__name__)


def log_warnings() -> None:
    """Send MuJoCo's warnings to the logger `sim.warning`, unless the program has its own handler.

    Without a handler MuJoCo writes them into MUJOCO_LOG.TXT in the current folder. A program that
    does not configure logging sees them on standard error.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.warning)
