"""Commands in processes of their own, which signals reach as at a terminal."""

import os
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _heard() -> None:
    """What `nohup` and a shell in the background have ignored, a child would ignore as well."""
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, signal.SIG_DFL)


def started(*command: str) -> subprocess.Popen[str]:
    """An interpreter of Python with these words."""
    return subprocess.Popen(
        [sys.executable, *command],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=_heard,
        text=True,
    )
