"""Commands in separate processes, which receive signals as in a terminal."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
INTERRUPTED = "fjh: interrupted: no file was left half-written\n"


def _reset_signals() -> None:
    """Reset signals, since a child ignores those that `nohup` or a background shell ignored."""
    for number in CODES:
        signal.signal(number, signal.SIG_DFL)


def start_python(*command: str) -> subprocess.Popen[str]:
    """Start the Python interpreter with these arguments."""
    return subprocess.Popen(
        [sys.executable, *command],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=_reset_signals,
        text=True,
    )


def assert_interrupted(process: subprocess.Popen[str], number: signal.Signals | int) -> None:
    """Check that a signal ends a process with one sentence, and that no process is left."""
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (CODES[signal.Signals(number)], INTERRUPTED)
    with pytest.raises(ProcessLookupError):
        for _ in range(200):  # Python's resource tracker ends a little later
            os.killpg(process.pid, 0)
            time.sleep(0.05)
