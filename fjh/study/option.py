"""Description of a study's parameters for the command line, without slow imports."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, get_args, get_origin

OnProgress = Callable[[int, int], None]
"""Callback for progress, called with the finished and the total number of steps."""
NOT_OPTIONS = ("folder", "on_progress")
"""Parameters of studies that are not options of the command."""

Study = Callable[..., Any]
"""Type of a study: a function that returns a :class:`fjh.study.result.Result`. Its name is that of
the command, its docstring the help text: purpose in one line; details, duration; files; example.

Parameters are keyword options, `on_progress`, and `folder` if rows are saved there. An
:class:`Option` in the annotation describes each option. A tuple is given as comma-separated text; a
dataclass parameter stands for options of its fields.
"""


@dataclass(frozen=True)
class Option:
    """Description of a parameter, as in `Annotated[float, Option("Duration in seconds.", "S")]`.

    Attributes:
        help: Sentence in the help text.
        metavar: Placeholder of the value in the help text; None: the name of its type.
        positional: Whether it is an argument without a name on the command line.
        bounds: Least and largest value of a number.
        listed: Whether the help text lists the option, or the fields of a dataclass.
    """

    help: str
    metavar: str | None = None
    positional: bool = False
    bounds: tuple[int, int] | None = None
    listed: bool = True


def seed_of(what: str) -> Option:
    """Return the description of a study's option for the seed of `what`."""
    return Option(f"Seed of {what}.", "N", bounds=(0, 2**32 - 1))


def described(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    """Return a keyword-only parameter annotated `Annotated[kind, Option]`.

    If `annotation` has no Option, the description is empty.

    Raises:
        TypeError: The annotation is `Annotated` with another object.
    """
    if get_origin(annotation) is not Annotated:
        annotation = Annotated[annotation, Option("")]
    if not isinstance(option := get_args(annotation)[1], Option):
        raise TypeError(f"{name} must be described by an Option, got {option!r:.80}")
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def options_of(study: Study) -> list[inspect.Parameter]:
    """Return the options of a study, including those of dataclass fields; see :func:`described`."""
    options = []
    for argument in inspect.signature(study).parameters.values():
        if argument.name in NOT_OPTIONS:
            continue
        parameter = described(argument.name, argument.annotation, argument.default)
        kind, option = get_args(parameter.annotation)
        if is_dataclass(kind):
            members = [described(one.name, one.type, one.default) for one in fields(kind)]
            options += members if option.listed else map(_unlisted, members)
        else:
            options.append(parameter)
    return options


def _unlisted(parameter: inspect.Parameter) -> inspect.Parameter:
    kind, option = get_args(parameter.annotation)
    return parameter.replace(annotation=Annotated[kind, replace(option, listed=False)])


def command_arguments(study: Study, values: Mapping[str, Any]) -> list[str]:
    """Return the command-line arguments for values of options that differ from their defaults.

    Args:
        study: Function of the study.
        values: Values by name; other names than those of options are ignored.
    """
    positional, flags = list[str](), list[str]()
    for option in options_of(study):
        value = values.get(option.name, option.default)
        if value == option.default:
            continue
        flag = f"--{option.name.replace('_', '-')}"
        if value is True:
            flags.append(flag)
        elif isinstance(value, list):
            flags += [text for entry in value for text in (flag, str(entry))]
        elif get_args(option.annotation)[1].positional:
            positional.append(str(value))
        else:
            flags += [flag, ",".join(map(str, value)) if isinstance(value, tuple) else str(value)]
    return [*positional, *flags]
