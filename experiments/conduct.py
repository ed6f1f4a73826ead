"""What every command shares: its options, and what is left when a run cannot be trusted."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from experiments.files import published, write_arrays
from sim import SimulationDiverged

MAX_SEED = 2**32 - 1

Seed = Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the detector noise.")]


class Unsound(Exception):
    """The run ended, but its numbers cannot be trusted."""


@contextmanager
def diverged_into(folder: Path) -> Iterator[None]:
    """Leave the state of a diverging simulation in the folder.

    Raises:
        Unsound: A simulation inside diverged.
    """
    try:
        yield
    except SimulationDiverged as diverged:
        state = {"time_s": np.array(diverged.time_s), "state": diverged.state}
        with published(folder, index="diverged.npz") as staging:
            write_arrays(staging / "diverged.npz", state)
        raise Unsound(f"{diverged}; the state is in {folder / 'diverged.npz'}") from None
