"""`python -m experiments` is `fjh`."""

import sys

from experiments.output.terminal import exit_on_interrupt

exit_on_interrupt()

from experiments.app.cli import main  # noqa: E402  (the imports take a second: Ctrl-C must be ready)


def run() -> None:
    """Entry point of the console script."""
    sys.exit(main())


if __name__ == "__main__":
    run()
