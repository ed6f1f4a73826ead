"""What a worker is asked to do: one case, for a sweep of the same code."""

import platform

from experiments.sweep.case import Case
from experiments.sweep.identity import digest
from experiments.sweep.run import Row, run_case


class ForeignWorker(RuntimeError):
    """A worker that would run other code."""


def fly(case: Case, of: str) -> Row:
    """The row of a case, for a sweep of the code with this digest.

    Raises:
        ForeignWorker: This process has other code; it joined the sweep later.
    """
    if of != digest():
        host = platform.node()
        raise ForeignWorker(f"{host} has another version of this package, or of what it needs")
    return run_case(case)
