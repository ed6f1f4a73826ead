"""A study as a command: its options are the parameters of its function."""

import inspect
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, get_args, get_origin

import typer

from experiments.app.terminal import print_ending, print_notes, print_table, progress
from experiments.studies import command_of
from fjh.study.errors import Interrupted, Unsound
from fjh.study.files import (
    UNFINISHED,
    alone_in,
    published,
    usable_folder,
    write_arrays,
)
from fjh.study.option import Option, Study, described, options_of

Out = Annotated[Path, Option("Folder for results.", "FOLDER")]
Quiet = Annotated[bool, Option("Only write the files.")]


def command(study: Study) -> Callable[..., None]:
    """The study as a command for Typer, which raises `Unsound` where a check failed."""
    name = study.__name__

    def run(*, out: Path, quiet: bool, **given: Any) -> None:
        result, summary = conduct(study, out, shown=not quiet, **given)
        if not quiet:
            for table in result.views:
                print_table(table)
            print_notes(result.notes)
            print_ending(result.checked, *_looked_at(name, result, summary, out, given))
        if failed := result.failed:
            raise Unsound(f"a check failed: {failed[0]}")

    return _with_signature(run, study, _of_all(study))


def conduct(
    study: Study, folder: Path, *, shown: bool, name: str = "", **given: Any
) -> tuple[Any, dict[str, Any]]:
    """Run a study and publish its result in the folder.

    Args:
        study: Its function.
        folder: Of the results.
        shown: Whether a bar shows the progress.
        name: What stands before it; by default that of the study.
        given: Values of its options, by name.

    Returns:
        The result, and the contents of its JSON file.

    Raises:
        OutputError: The disk or the folder refuses.
        WrongInput: An option; or another study is at work in the folder.
        Unsound: A simulation diverged; its state is in the folder.
    """
    usable_folder(folder)
    parameters, its_name = inspect.signature(study).parameters, name or study.__name__
    arguments = _arguments(parameters, given)
    if "folder" in parameters:
        arguments["folder"] = folder
    with alone_in(folder), ExitStack() as running:
        arguments["on_progress"] = running.enter_context(progress(its_name, shown=shown))
        try:
            with diverged_into(folder):
                result = study(**arguments)
        except KeyboardInterrupt:
            if not (folder / UNFINISHED).exists():
                raise
            said = "interrupted: finished runs are kept, and --resume continues"
            raise Interrupted(said) from None
        running.close()  # there is one bar at a time
        with progress(f"{its_name}: files", shown=shown) as on_progress:
            summary = result.publish(study.__name__, folder, on_progress)
        (folder / UNFINISHED).unlink(missing_ok=True)
        return result, summary


def _option(parameter: inspect.Parameter, *, hidden: bool = False) -> inspect.Parameter:
    """The parameter as Typer takes it."""
    kind, option = get_args(parameter.annotation)
    given: dict[str, Any] = {"help": option.help or None, "metavar": option.metavar}
    given["hidden"] = hidden or not option.listed
    if option.bounds is not None:
        given["min"], given["max"] = option.bounds
    # A flag, and no second one, --no-...
    flags = [f"--{parameter.name.replace('_', '-')}"] if kind is bool else []
    info = typer.Argument(**given) if option.positional else typer.Option(*flags, **given)
    value = parameter.default
    return parameter.replace(
        default=",".join(map(str, value)) if isinstance(value, tuple) else value,
        annotation=Annotated[_typed(kind), info],
    )


def _typed(kind: Any) -> Any:
    """How a value is typed: tuples as text, lists as one value after another."""
    if get_origin(kind) in (UnionType,) and NoneType in get_args(kind):
        [one] = [_typed(each) for each in get_args(kind) if each is not NoneType]
        return one | None
    if get_origin(kind) is list and get_args(kind) != (Path,):
        return list[str]
    return str if get_origin(kind) is tuple else kind


def _arguments(
    parameters: Mapping[str, inspect.Parameter], given: Mapping[str, Any]
) -> dict[str, Any]:
    """The arguments of a study from the values of options; scripts give seed and quick to all."""
    rest, arguments = dict(given), {}
    for name, parameter in parameters.items():
        kind: Any = (get_args(parameter.annotation) or (parameter.annotation,))[0]
        if isinstance(kind, type) and is_dataclass(kind):
            own = [each.name for each in fields(kind) if each.name in rest]
            arguments[name] = kind(**{each: rest.pop(each) for each in own})
        elif name in rest:
            arguments[name] = rest.pop(name)
    return arguments


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """A function as Typer takes it: fields of dataclasses among its parameters are options, too."""

    def run(**given: Any) -> None:
        function(**_arguments(inspect.signature(function).parameters, given))

    return _with_signature(run, function, [_option(each) for each in options_of(function)])


def _of_all(study: Study) -> list[inspect.Parameter]:
    """The options of a study and those that all have.

    Where it has no `seed` or `quick` they are taken all the same, and hidden: scripts give them.
    """
    found = {
        "out": _option(described("out", Out, Path("results", study.__name__))),
        "seed": _option(described("seed", int, 0), hidden=True),
        "quick": _option(described("quick", bool, False), hidden=True),
        **{each.name: _option(each) for each in options_of(study)},
        "quiet": _option(described("quiet", Quiet, False)),
    }
    return list(found.values())


def _with_signature(
    run: Callable[..., None], function: Study, options: list[inspect.Parameter]
) -> Callable[..., None]:
    run.__name__, run.__doc__ = function.__name__, function.__doc__
    run.__dict__["__signature__"] = inspect.Signature(options)
    run.__annotations__ = {each.name: each.annotation for each in options}
    return run


def _looked_at(
    name: str, result: Any, summary: Mapping[str, Any], folder: Path, given: Mapping[str, Any]
) -> tuple[Path, str]:
    """The file to open first, and what a user would type next.

    That is what shows a recording; else the whole of a short run, or a short one of all studies.
    """
    first = result.pictures[0].file if result.pictures else f"{name}.md"
    recordings = [file for file in summary["files"] if file.endswith(".rrd")]
    words = command_of(name) if given["quick"] else ["fjh", "paper", "report", "--quick"]
    if recordings:
        words = ["rerun", str(folder / recordings[0])]
    return folder / first, shlex.join(words)


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
