"""Entry point of `fjh`, which checks that packages are installed before it imports them."""

import os
import signal
import sys
from importlib.util import find_spec

from fjh.study.interrupts import SIGNALS, interrupted, notice

PACKAGES = (
    *("distributed", "filelock", "jinja2", "markdown_it", "matplotlib", "mujoco", "pandas"),
    *("typer", "viser"),
    *("mjviser", "psutil", "pyarrow", "rerun", "rerun_loader_mjcf", "rich", "threadpoolctl"),
)
"""Import names of the packages of the extra `all`."""


def run() -> None:
    """Run the command and exit; if a package is missing, print a message and exit with code 2."""
    if missing := [name for name in PACKAGES if find_spec(name) is None]:
        notice(
            f"fjh needs packages that are not installed, {', '.join(missing)}: "
            'in a checkout, pip install ".[all]"'
        )
        sys.exit(2)
    from experiments.app.cli import main

    code = main()
    for signal_number in SIGNALS:
        signal.signal(signal_number, signal.SIG_IGN)  # all output is written
    if interrupted():  # else Python may end with the signal of Ctrl-C instead of this code
        os._exit(code)
    sys.exit(code)
