"""`python -m experiments` is `fjh`."""

from fjh.study.interrupts import exit_on_interrupt

exit_on_interrupt()  # before all others: the imports take a second

import os  # noqa: E402

from experiments.app.start import run  # noqa: E402

# MuJoCo otherwise imports a window library, which starts a process to find it: one that prints a
# traceback if Ctrl-C ends this command, or one of its workers, at that moment.
os.environ.setdefault("MUJOCO_GL", "disabled")
os.environ.setdefault("RUST_LOG", "off")  # Rerun's reader: what it cannot read we say ourselves

if __name__ == "__main__":
    run()
