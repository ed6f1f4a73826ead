"""Commands made from studies: the options are the parameters of the study's function."""

import inspect
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, get_args, get_origin

import typer

from experiments.app.terminal import print_summary, progress
from experiments.studies import command_of
from fjh.study.errors import Interrupted, Unsound
from fjh.study.files import UNFINISHED, alone_in, published, usable_folder, write_arrays
from fjh.study.option import Option, Study, described, options_of

Out = Annotated[Path, Option("Folder for results.", "FOLDER")]
Quiet = Annotated[bool, Option("Only write the files.")]


def command(study: Study) -> Callable[..., None]:
    """Return the study as a command for Typer, which raises `Unsound` if a check fails."""
    name = study.__name__

    def run(*, out: Path, quiet: bool, **values: Any) -> None:
        result, summary = conduct(study, out, show=not quiet, **values)
        if not quiet:
            steps, more = (
                _next_steps(name, result, summary, out, values),
                f"More in {out / name}.md",
            )
            contents = {"tables": result.views, "notes": result.notes, "more": more}
            print_summary(result.checked, *steps, **contents)
        if failed := result.failed:
            raise Unsound(f"a check failed: {failed[0]}")

    return _with_signature(run, study, _all_options(study))


def conduct(
    study: Study, folder: Path, *, show: bool, name: str = "", **values: Any
) -> tuple[Any, dict[str, Any]]:
    """Run a study with values of its options; return the result, and the contents of its JSON file.

    The result is written to the folder. `name` is the label of the progress bar, if there is one.

    Raises:
        OutputError: The folder cannot be written.
        WrongInput: An option has an invalid value, or another study is running in the folder.
        Unsound: A simulation diverged; its state is in the folder.
    """
    usable_folder(folder)
    parameters, label = inspect.signature(study).parameters, name or study.__name__
    arguments = _arguments(parameters, values)
    if "folder" in parameters:
        arguments["folder"] = folder
    with alone_in(folder), ExitStack() as running:
        arguments["on_progress"] = running.enter_context(progress(label, show=show))
        try:
            with diverged_into(folder):
                result = study(**arguments)
        except KeyboardInterrupt:
            if not (folder / UNFINISHED).exists():
                raise
            text = "interrupted: finished runs are saved, and --resume continues"
            raise Interrupted(text) from None
        running.close()  # only one progress bar at a time
        with progress(f"{label}: files", show=show) as on_progress:
            summary = result.publish(study.__name__, folder, on_progress)
        (folder / UNFINISHED).unlink(missing_ok=True)
        return result, summary


def _option(parameter: inspect.Parameter, *, hidden: bool = False) -> inspect.Parameter:
    """Convert a parameter of a study to one of Typer."""
    kind, option = get_args(parameter.annotation)
    options: dict[str, Any] = {"help": option.help or None, "metavar": option.metavar}
    options["hidden"] = hidden or not option.listed
    if option.bounds is not None:
        options["min"], options["max"] = option.bounds
    # Without a name Typer would add a second flag, --no-...
    flags = [f"--{parameter.name.replace('_', '-')}"] if kind is bool else []
    info = typer.Argument(**options) if option.positional else typer.Option(*flags, **options)
    value = parameter.default
    return parameter.replace(
        default=",".join(map(str, value)) if isinstance(value, tuple) else value,
        annotation=Annotated[_typed(kind), info],
    )


def _typed(kind: Any) -> Any:
    """Return the type of an option on the command line: text for tuples, repeated for lists."""
    if get_origin(kind) in (UnionType,) and NoneType in get_args(kind):
        [one] = [_typed(option) for option in get_args(kind) if option is not NoneType]
        return one | None
    if get_origin(kind) is list and get_args(kind) != (Path,):
        return list[str]
    return str if get_origin(kind) is tuple else kind


def _arguments(
    parameters: Mapping[str, inspect.Parameter], values: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a study from the values of options; ignore the other values."""
    remaining, arguments = dict(values), {}
    for name, parameter in parameters.items():
        kind: Any = (get_args(parameter.annotation) or (parameter.annotation,))[0]
        if isinstance(kind, type) and is_dataclass(kind):
            names = [field.name for field in fields(kind) if field.name in remaining]
            arguments[name] = kind(**{key: remaining.pop(key) for key in names})
        elif name in remaining:
            arguments[name] = remaining.pop(name)
    return arguments


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """Return a function as a command for Typer; fields of dataclass parameters become options."""

    def run(**values: Any) -> None:
        function(**_arguments(inspect.signature(function).parameters, values))

    return _with_signature(run, function, list(map(_option, options_of(function))))


def _all_options(study: Study) -> list[inspect.Parameter]:
    """Return the options of a study and those common to all studies.

    Scripts give `seed` and `quick` to every study: they are hidden options of studies without them.
    """
    parameters = {
        "out": _option(described("out", Out, Path("results", study.__name__))),
        "seed": _option(described("seed", int, 0), hidden=True),
        "quick": _option(described("quick", bool, False), hidden=True),
        **{parameter.name: _option(parameter) for parameter in options_of(study)},
        "quiet": _option(described("quiet", Quiet, False)),
    }
    return list(parameters.values())


def _with_signature(
    run: Callable[..., None], function: Study, options: list[inspect.Parameter]
) -> Callable[..., None]:
    run.__name__, run.__doc__ = function.__name__, function.__doc__
    run.__dict__["__signature__"] = inspect.Signature(options)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in options}
    return run


def _next_steps(
    name: str, result: Any, summary: Mapping[str, Any], folder: Path, values: Mapping[str, Any]
) -> tuple[Path, str]:
    """Return the file to open first, and a command: open a recording, or run the full study."""
    first = result.pictures[0].file if result.pictures else f"{name}.md"
    recordings = [file for file in summary["files"] if file.endswith(".rrd")]
    arguments = command_of(name) if values["quick"] else ["fjh", "paper", "report", "--quick"]
    if recordings:
        arguments = ["rerun", str(folder / recordings[0])]
    return folder / first, shlex.join(arguments)


@contextmanager
def diverged_into(folder: Path) -> Iterator[None]:
    """Write the state of a diverging simulation to the folder, and raise `Unsound`."""
    import numpy as np  # late, as the help text must not wait for MuJoCo's import

    from sim import SimulationDiverged

    try:
        yield
    except SimulationDiverged as diverged:
        state = {"time_s": np.array(diverged.time_s), "state": diverged.state}
        with published(folder, index="diverged.npz") as staging:
            write_arrays(staging / "diverged.npz", state)
        raise Unsound(f"{diverged}; the state is in {folder / 'diverged.npz'}") from None
