"""Run the command `fjh` by `python -m experiments`."""

from fjh.study.interrupts import exit_on_interrupt

exit_on_interrupt()  # before all others: the imports take a second

import os  # noqa: E402

from experiments.app.start import run  # noqa: E402

# MuJoCo otherwise imports a window library, which starts a process to find it; if Ctrl-C comes at
# that moment, the process prints a traceback.
os.environ.setdefault("MUJOCO_GL", "disabled")
os.environ.setdefault("RUST_LOG", "off")  # unreadable recordings have messages of our own

if __name__ == "__main__":
    run()
