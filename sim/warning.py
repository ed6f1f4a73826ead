"""MuJoCo's own warnings: to the log, not into a file of the current folder."""

import logging

import mujoco

_log = logging.getLogger(__name__)
_log.addHandler(logging.NullHandler())


def log_warnings() -> None:
    """Send MuJoCo's warnings to the logger `sim.warning`, unless the program has its own handler.

    Without a handler MuJoCo writes them into MUJOCO_LOG.TXT in the current folder. The logger is
    silent until a program configures logging: what a warning means for a run, a `ModelError` or
    `SimulationDiverged` says.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.warning)
