"""A study as a command: its options, its progress, its files, its exit code."""

import inspect
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from experiments.study.files import json_text, published, usable_folder, write_arrays
from experiments.study.results import Results, publish
from experiments.study.study import Option, Progress, Study, Unsound
from experiments.study.terminal import (
    Ending,
    print_ending,
    print_notes,
    print_table,
    progress,
)

_OUT = "Folder for results; created if missing."
_QUIET = "Print no tables and no progress; only write the files."
_JSON = "Print the contents of the JSON file instead of tables; with --quiet, print no progress."


def command(study: Study) -> Callable[..., None]:
    """The study as a command for Typer, which raises `Unsound` where a check failed."""

    def run(*, out: Path, quiet: bool, json: bool, **options: Any) -> None:
        results = conduct(study, out, partial(progress, shown=not quiet), **options)
        show(results, quiet=quiet, json=json)
        if not (quiet or json):
            print_ending(ending(study.name, results, out, quick=options["quick"]))
        if failed := results.failed_check:
            raise Unsound(f"a check failed: {failed}")

    shared = {"seed": study.seed, "quick": study.quick}
    return with_options(run, study.name, study.help, **shared, further=study.options)


def conduct(study: Study, folder: Path, progress: Progress, **options: Any) -> Results:
    """Results of a study, which are published in the folder.

    Raises:
        OutputError: The disk or the folder refuses.
        Unsound: A simulation diverged; its state is in the folder.
    """
    usable_folder(folder)
    if study.streams:
        options["folder"] = folder
    with ExitStack() as running:
        options["on_progress"] = running.enter_context(progress(study.name))
        with diverged_into(folder), study.perform(**options) as results:
            running.close()  # there is one bar at a time
            with progress(f"{study.name}: files") as on_progress:
                return publish(folder, study.name, results, on_progress)


def ending(name: str, results: Results, folder: Path, *, quick: bool) -> Ending:
    """What the command of a study says last.

    A recording is what a user looks at next; without one, a short run is followed by the whole,
    and that by a short one of all studies.
    """
    first = results.pictures[0].file if results.pictures else f"{name}.md"
    recordings = [each for each in results.summary.get("files", ()) if each.endswith(".rrd")]
    words = ["fjh", name] if quick else ["fjh", "report", "--quick"]
    if recordings:
        words = ["rerun", str(folder / recordings[0])]
    return Ending(results.checked, folder / first, shlex.join(words))


def show(results: Results, *, quiet: bool, json: bool) -> None:
    """Print tables and notes for a person, or JSON for a script, or nothing."""
    if json:
        print(json_text(results.summary), end="")
    elif not quiet:
        for table in results.tables:
            print_table(table)
        print_notes(results.notes)


def with_options(
    run: Callable[..., None],
    name: str,
    help: str,
    *,
    seed: str | None,
    quick: str | None,
    further: tuple[Option, ...] = (),
) -> Callable[..., None]:
    """The function as Typer takes it, with the options that all studies have, and further ones.

    It takes all of them by keyword. The name is that of the command and of its folder; `seed` says
    what the seed is of, `quick` what --quick leaves out; without one the option, which scripts give
    to every study, is not in the help text.
    """
    options = (
        Option("out", Path, Path("results", name), _OUT, "FOLDER"),
        Option("seed", int, 0, seed and f"Seed of {seed}.", "N", bounds=(0, 2**32 - 1)),
        Option("quick", bool, False, quick),
        *further,
        Option("quiet", bool, False, _QUIET),
        Option("json", bool, False, _JSON),
    )
    return as_command(run, name, help, options)


def as_command(
    run: Callable[..., None], name: str, help: str, options: Sequence[Option]
) -> Callable[..., None]:
    """The function as Typer takes it, which takes these options by keyword."""
    parameters = [_parameter(option) for option in options]
    run.__name__, run.__doc__ = name, help
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


def _parameter(option: Option) -> inspect.Parameter:
    name = option.metavar or option.name.upper() if option.positional else option.flag

    def checked(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [option.checked(each, name) for each in value]
        return option.checked(value, name)

    given: dict[str, Any] = {"help": option.help, "hidden": option.help is None}
    given |= {"metavar": option.metavar, "callback": checked}
    info: Any = typer.Argument(**given)
    if not option.positional:
        info = typer.Option(*([option.flag] if option.kind is bool else []), **given)
    return inspect.Parameter(
        option.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=option.default,
        annotation=Annotated[option.kind, info],
    )


@contextmanager
def diverged_into(folder: Path) -> Iterator[None]:
    """Leave the state of a diverging simulation in the folder, and raise `Unsound`."""
    import numpy as np  # late: the help text does not wait for MuJoCo's import

    from sim import SimulationDiverged

    try:
        yield
    except SimulationDiverged as diverged:
        state = {"time_s": np.array(diverged.time_s), "state": diverged.state}
        with published(folder, index="diverged.npz") as staging:
            write_arrays(staging / "diverged.npz", state)
        raise Unsound(f"{diverged}; the state is in {folder / 'diverged.npz'}") from None
