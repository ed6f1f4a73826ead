"""A study as data: what the command line offers of it, and the two functions that make it."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any

from experiments.output.results import Results

OnProgress = Callable[[int, int], None]
"""To be called with the finished and total steps of some work."""

Progress = Callable[[str], AbstractContextManager[OnProgress]]
"""Shows the progress of the named work while its context lasts."""


@dataclass(frozen=True)
class Option:
    """One more option of a study's command, passed on to its runs by name.

    Attributes:
        name: As a Python name; `--its-name` on the command line.
        kind: Type of its value; a `Literal` is a choice.
        default: Where it is not given.
        help: For the help text.
        metavar: What stands for the value in the help text; None: its type.
    """

    name: str
    kind: Any
    default: Any
    help: str
    metavar: str | None = None


@dataclass(frozen=True)
class Study:
    """One experiment.

    `runs` and `results` are entry points, "package.module:function", resolved when the study is
    run: the help text does not wait for the import of MuJoCo.

    Attributes:
        name: Of its command, its folder and its JSON file.
        help: For the help text: one line, what it does and how long it takes, what it writes, an
            example; a paragraph each.
        runs: `runs(seed=, quick=, on_progress=, **options)` simulates, and returns frozen data.
        results: `results(outcome)` makes :class:`Results` of them.
        quick: What --quick leaves out.
        seed: What the seed is of.
        options: Further ones.
        streams: Whether the runs write into the folder while they run. They take it as `folder`,
            and return a context manager of the data, which is left when all files are published.
    """

    name: str
    help: str
    runs: str
    results: str
    quick: str
    seed: str = "the detector noise"
    options: tuple[Option, ...] = ()
    streams: bool = False

    @contextmanager
    def perform(self, *, on_progress: OnProgress, **options: Any) -> Iterator[Results]:
        """The results of the study, to be published within the context.

        No file is made, unless the study streams: then the context holds its unfinished files.
        """
        outcome = resolve_name(self.runs)(on_progress=on_progress, **options)
        with outcome if self.streams else nullcontext(outcome) as data:
            yield resolve_name(self.results)(data)


class WrongInput(Exception):
    """The command cannot do what it is asked to; the message says why."""


class Interrupted(Exception):
    """Ctrl-C, by a command that has more to say of it than all others."""


class Unsound(Exception):
    """The run ended, but its numbers cannot be trusted."""
