"""What the command line says of a study's parameters; nothing but the standard library."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Study = Callable[..., Any]
"""A function that returns a :class:`experiments.study.result.Result`; its name is the command's,
its docstring the help text: a line on what it does; what and how long; which files; an example.

It takes its options by keyword, `on_progress`, and `folder` if it keeps rows there. A parameter is
described by an :class:`Option` as its annotation; a tuple is given as text with commas between, and
a parameter that is a dataclass by its fields.
"""


@dataclass(frozen=True)
class Option:
    """Description of a parameter: `Annotated[float, Option("Of the run, in seconds.", "S")]`.

    Attributes:
        help: Its line in the help text.
        metavar: Stands for the value there; None: its type.
        positional: Whether it has no name on the command line.
        bounds: Least and largest value of a number.
    """

    help: str
    metavar: str | None = None
    positional: bool = False
    bounds: tuple[int, int] | None = None


def seed_of(what: str) -> Option:
    """The option of a study's seed."""
    return Option(f"Seed of {what}.", "N", bounds=(0, 2**32 - 1))
