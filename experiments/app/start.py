"""The start of `fjh`: what is not installed is said before anything is imported that needs it."""

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
"""What the extra `all` installs, as it is imported."""


def run() -> None:
    """Entry point of the command; a package that is not installed is one sentence, exit code 2."""
    if absent := [name for name in PACKAGES if find_spec(name) is None]:
        notice(
            f"fjh needs packages that are not installed, {', '.join(absent)}: "
            'in a checkout, pip install ".[all]"'
        )
        sys.exit(2)
    from experiments.app.cli import main

    code = main()
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)  # all is written, and said
    if interrupted():  # Python may have noted the exception, and would end by Ctrl-C's signal
        os._exit(code)
    sys.exit(code)
