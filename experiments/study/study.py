"""A study as data: what the command line offers of it, and the two functions that make it."""

import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from numbers import Real
from pkgutil import resolve_name
from typing import Any

from experiments.study.results import Results

# What a warning of MuJoCo's means for a run, a sentence of the command's own says.
logging.getLogger(f"{__name__.removesuffix('experiments.study.study')}sim").addHandler(
    logging.NullHandler()
)

OnProgress = Callable[[int, int], None]
"""To be called with the finished and total steps of some work."""

Progress = Callable[[str], AbstractContextManager[OnProgress]]
"""Shows the progress of the named work while its context lasts."""


@dataclass(frozen=True)
class Option:
    """One more option of a study's command, passed on to its runs by name."""

    name: str  # as a Python name; `--its-name` on the command line
    kind: Any  # type of its value; a `Literal` is a choice
    default: Any
    help: str | None  # None: it is not in the help text
    metavar: str | None = None  # stands for the value in the help text; None: its type
    positional: bool = False  # an argument without a name
    bounds: tuple[float, float] | None = None  # least and largest value of a number
    parse: Callable[[Any], Any] | None = None  # makes what the runs take of it, or of one in a list

    @property
    def flag(self) -> str:
        """What stands before its value on the command line."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def usual(self) -> Any:
        """What the runs take by default; of an option that may be repeated there is none."""
        if isinstance(self.default, tuple):
            return self.default
        return self.checked(self.default, self.flag)

    def checked(self, value: Any, name: str) -> Any:
        """The value as the runs take it: within its bounds, and parsed; None as it is by default.

        Args:
            value: As it is given.
            name: How who gives it calls the option, for the message.

        Raises:
            WrongInput: It is out of bounds, or the parser refuses it, whose `ValueError` says what
                `text` must be.
        """
        if value is None and self.default is None:
            return None
        if self.bounds is not None:
            (least, most), is_number = self.bounds, isinstance(value, Real)
            if isinstance(value, bool) or not is_number or not least <= value <= most:  # type: ignore[operator]
                raise WrongInput(
                    f"{name} must be from {least:.10g} to {most:.10g}, got {value!r:.80}"
                )
        if self.parse is None:
            return value
        try:
            return self.parse(value)
        except ValueError as error:
            what = "" if str(error).startswith("text ") else f" {value!s:.80}: "
            raise WrongInput(f"{name}{what}{str(error).removeprefix('text')}") from None


@dataclass(frozen=True)
class Study:
    """One experiment.

    Where `runs` gives a :class:`experiments.study.result.Result`, there are no `results`.

    `runs` and `results` are entry points, "package.module:function", resolved when the study is
    run: the help text does not wait for the import of MuJoCo. `runs(seed=, quick=, on_progress=,
    **options)` simulates and returns frozen data, of which `results(outcome)` makes
    :class:`Results`. Where a study `streams`, the runs write into the folder while they run: they
    take it as `folder`, and return a context manager of the data, which is left when all files are
    published. It has an option `resume`: True continues what an interrupted run left there, False
    refuses it, and None continues it if it is of the same runs, and begins anew if not.

    `in_report` has the switches that are on where the study is a chapter of `fjh report`; None
    leaves it out.
    """

    name: str  # of its command, its folder and its JSON file
    help: str  # a paragraph each: one line, what it does and how long it takes, files, an example
    runs: str
    results: str | None
    quick: str | None  # what --quick leaves out; None: there is no shorter run
    seed: str | None = "the detector noise"  # what the seed is of; None: nothing is random
    options: tuple[Option, ...] = ()
    streams: bool = False
    in_report: dict[str, bool] | None = field(default_factory=dict)
    again: str | None = None  # entry point: again(summary) is how a dataset's runs fly again

    def words(self, *, seed: int, quick: bool, **given: Any) -> list[str]:
        """The command that gives the same numbers, without its folder; defaults are left out."""
        found, options = ["fjh", self.name], ["--quick"] * (quick and self.quick is not None)
        for option in self.options:
            if (value := given.get(option.name, option.usual)) == option.usual:
                continue
            if option.positional:
                found.append(str(value))
                continue
            options.append(option.flag)
            written = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
            options += [] if option.kind is bool else [written]
        return [*found, *options, *([] if self.seed is None else ["--seed", str(seed)])]

    @contextmanager
    def perform(self, *, on_progress: OnProgress, **options: Any) -> Iterator[Results]:
        """The results of the study, to be published within the context.

        No file is made, unless the study streams: then the context holds its unfinished files.
        """
        outcome = resolve_name(self.runs)(on_progress=on_progress, **options)
        with outcome if self.streams else nullcontext(outcome) as data:
            make = resolve_name(self.results) if self.results else lambda it: it.results(self.name)
            yield make(data)


class WrongInput(Exception):
    """The command cannot do what it is asked to; the message says why."""


class NotInstalled(WrongInput):
    """A package that the study needs is not installed; the message says how to install it."""


class Interrupted(Exception):
    """Ctrl-C, by a command that has more to say of it than all others."""


class Unsound(Exception):
    """The run ended, but its numbers cannot be trusted."""
