"""`python -m experiments` is `fjh`."""

import os
import sys
from importlib.util import find_spec

from experiments.study.terminal import exit_on_interrupt, notice

PACKAGES = (
    *("distributed", "jinja2", "matplotlib", "mujoco", "psutil", "pyarrow", "rerun"),
    *("rerun_loader_mjcf", "rich", "typer"),
)
"""What the extra `testbed` installs, as it is imported."""

# MuJoCo otherwise imports a window library, which starts a process to find it: one that prints a
# traceback if Ctrl-C ends this command, or one of its workers, at that moment.
os.environ.setdefault("MUJOCO_GL", "disabled")
exit_on_interrupt()  # the imports take a second: Ctrl-C must be ready before


def run() -> None:
    """Entry point of the command; a package that is not installed is one sentence, exit code 2."""
    if absent := [name for name in PACKAGES if find_spec(name) is None]:
        notice(
            f"fjh needs packages that are not installed, {', '.join(absent)}: "
            'pip install "fault-tolerant-hexapod[testbed]"'
        )
        sys.exit(2)
    from experiments.app.cli import main

    sys.exit(main())


if __name__ == "__main__":
    run()
