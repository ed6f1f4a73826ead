"""What every command shares: its options, and what is left when a run cannot be trusted."""

from pathlib import Path
from typing import Annotated, Any

import typer

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
