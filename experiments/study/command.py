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
from typer.models import ArgumentInfo

from experiments.study.errors import Interrupted, Unsound
from experiments.study.files import (
    UNFINISHED,
    alone_in,
    json_text,
    published,
    usable_folder,
    write_arrays,
)
from experiments.study.option import Option, Study
from experiments.study.terminal import print_ending, print_notes, print_table, progress

Out = Annotated[Path, Option("Folder for results; created if missing.", "FOLDER")]
Quiet = Annotated[bool, Option("Print no tables and no progress; only write the files.")]
Json = Annotated[
    bool,
    Option("Print the contents of the JSON file instead of tables; with --quiet, no progress."),
]

GIVEN = ("folder", "on_progress")
"""Parameters of studies that are no options."""


def command(study: Study) -> Callable[..., None]:
    """The study as a command for Typer, which raises `Unsound` where a check failed."""
    name = study.__name__

    def run(*, out: Path, quiet: bool, json: bool, **given: Any) -> None:
        result, summary = conduct(study, out, shown=not quiet, **given)
        if json:
            print(json_text(summary), end="")
        elif not quiet:
            for table in result.shown:
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


def options_of(study: Study) -> list[inspect.Parameter]:
    """The options of a study's command, those of dataclasses among them."""
    found = []
    for each in inspect.signature(study).parameters.values():
        if is_dataclass(each.annotation):
            found += [_option(one.name, one.type, one.default) for one in fields(each.annotation)]
        elif each.name not in GIVEN:
            found.append(_option(each.name, each.annotation, each.default))
    return found


def words_of(study: Study, given: Mapping[str, Any]) -> list[str]:
    """The command of these options, without its folder; those that are as by default are left out.

    Args:
        study: Its function.
        given: Values of options by name; others are ignored.
    """
    words, flags = ["fjh", study.__name__], list[str]()
    for option in options_of(study):
        value = given.get(option.name, option.default)
        if value == option.default:
            continue
        flag = f"--{option.name.replace('_', '-')}"
        if value is True:
            flags.append(flag)
        elif isinstance(value, list):
            flags += [word for each in value for word in (flag, str(each))]
        elif isinstance(get_args(option.annotation)[1], ArgumentInfo):
            words.append(str(value))
        else:
            flags += [flag, ",".join(map(str, value)) if isinstance(value, tuple) else str(value)]
    return [*words, *flags]


def _option(name: str, annotation: Any, default: Any, *, hidden: bool = False) -> inspect.Parameter:
    kind, described = annotation, Option("")
    if get_origin(annotation) is Annotated:
        kind, described = get_args(annotation)
        if not isinstance(described, Option):
            raise TypeError(f"{name} must be described by an Option, got {described!r:.80}")
    given: dict[str, Any] = {"help": described.help or None, "metavar": described.metavar}
    given["hidden"] = hidden
    if described.bounds is not None:
        given["min"], given["max"] = described.bounds
    flags = [f"--{name.replace('_', '-')}"] if kind is bool else []  # and no second one, --no-...
    info = typer.Argument(**given) if described.positional else typer.Option(*flags, **given)
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=",".join(map(str, default)) if isinstance(default, tuple) else default,
        annotation=Annotated[_typed(kind), info],
    )


def _typed(kind: Any) -> Any:
    """How a value is typed: tuples as text, lists as one text after another."""
    if get_origin(kind) in (UnionType,) and NoneType in get_args(kind):
        [one] = [_typed(each) for each in get_args(kind) if each is not NoneType]
        return one | None
    return {tuple: str, list: list[str]}.get(get_origin(kind), kind)


def _arguments(
    parameters: Mapping[str, inspect.Parameter], given: Mapping[str, Any]
) -> dict[str, Any]:
    """The arguments of a study from the values of options; scripts give seed and quick to all."""
    rest, arguments = dict(given), {}
    for name, parameter in parameters.items():
        if is_dataclass(parameter.annotation):
            kind: Any = parameter.annotation
            own = [each.name for each in fields(kind) if each.name in rest]
            arguments[name] = kind(**{each: rest.pop(each) for each in own})
        elif name in rest:
            arguments[name] = rest.pop(name)
    return arguments


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """A function as Typer takes it: fields of dataclasses among its parameters are options, too."""

    def run(**given: Any) -> None:
        function(**_arguments(inspect.signature(function).parameters, given))

    return _with_signature(run, function, options_of(function))


def _of_all(study: Study) -> list[inspect.Parameter]:
    """The options of a study and those that all have.

    Where it has no `seed` or `quick` they are taken all the same, and hidden: scripts give them.
    """
    found = {
        "out": _option("out", Out, Path("results", study.__name__)),
        "seed": _option("seed", int, 0, hidden=True),
        "quick": _option("quick", bool, False, hidden=True),
        **{each.name: each for each in options_of(study)},
        "quiet": _option("quiet", Quiet, False),
        "json": _option("json", Json, False),
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
    words = ["fjh", name] if given["quick"] else ["fjh", "report", "--quick"]
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
