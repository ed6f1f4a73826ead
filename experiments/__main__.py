"""`python -m experiments` is `fjh`."""

from experiments.study.interrupts import exit_on_interrupt, ignore_interrupts, interrupted, notice

exit_on_interrupt()  # before all others: the imports take a second

import os  # noqa: E402
import sys  # noqa: E402
from importlib.util import find_spec  # noqa: E402

PACKAGES = (
    *("distributed", "jinja2", "matplotlib", "mujoco", "psutil", "pyarrow", "rerun"),
    *("rerun_loader_mjcf", "rich", "threadpoolctl", "typer"),
)
"""What the extra `testbed` installs, as it is imported."""

# MuJoCo otherwise imports a window library, which starts a process to find it: one that prints a
# traceback if Ctrl-C ends this command, or one of its workers, at that moment.
os.environ.setdefault("MUJOCO_GL", "disabled")
os.environ.setdefault("RUST_LOG", "off")  # Rerun's reader: what it cannot read we say ourselves


def run() -> None:
    """Entry point of the command; a package that is not installed is one sentence, exit code 2."""
    if absent := [name for name in PACKAGES if find_spec(name) is None]:
        notice(
            f"fjh needs packages that are not installed, {', '.join(absent)}: "
            'pip install "fault-tolerant-hexapod[testbed]"'
        )
        sys.exit(2)
    from experiments.app.cli import main

    code = main()
    ignore_interrupts()
    if interrupted():  # Python may have noted the exception, and would end by Ctrl-C's signal
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    run()
