"""What every command shares: its options, and what is left when a run cannot be trusted."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from experiments.output.files import published, write_arrays

OnProgress = Callable[[int, int], None]
"""To be called with the finished and total steps of some work."""

Progress = Callable[[str], AbstractContextManager[OnProgress]]
"""Shows how far the work of a name is, while its context lasts."""

Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for results, made if need be.")]


MachineFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Another machine file, MJCF.  [default: the hexapod, fjh.xml]"
    ),
]


def seed_option(of_what: str) -> Any:
    """The option `--seed`; the same seed gives the same numbers to the bit."""
    return typer.Option(min=0, max=2**32 - 1, metavar="N", help=f"Seed of {of_what}.")


Seed = Annotated[int, seed_option("the detector noise")]


class WrongInput(Exception):
    """The command cannot do what it is asked to; the message says why."""


class Interrupted(Exception):
    """Ctrl-C, by a command that has more to say of it than all others."""


class Unsound(Exception):
    """The run ended, but its numbers cannot be trusted."""


@contextmanager
def machine_refused() -> Iterator[None]:
    """Turn the refusal of a machine file into that of the command line.

    Raises:
        WrongInput: A machine file will not do.
    """
    from sim import ModelError  # late: the help text need not wait for MuJoCo's import

    try:
        yield
    except ModelError as error:
        raise WrongInput(str(error)) from error


@contextmanager
def diverged_into(folder: Path) -> Iterator[None]:
    """Leave the state of a diverging simulation in the folder.

    Raises:
        Unsound: A simulation inside diverged.
    """
    # Late: the help text need not wait for MuJoCo's import.
    import numpy as np

    from sim import SimulationDiverged

    try:
        yield
    except SimulationDiverged as diverged:
        state = {"time_s": np.array(diverged.time_s), "state": diverged.state}
        with published(folder, index="diverged.npz") as staging:
            write_arrays(staging / "diverged.npz", state)
        raise Unsound(f"{diverged}; the state is in {folder / 'diverged.npz'}") from None
