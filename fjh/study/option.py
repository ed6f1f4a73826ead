"""What the command line says of a study's parameters; nothing but the standard library."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, get_args, get_origin

OnProgress = Callable[[int, int], None]
"""To be called with the finished and total steps of some work."""
GIVEN = ("folder", "on_progress")
"""Parameters of studies that are no options."""

Study = Callable[..., Any]
"""A function that returns a :class:`fjh.study.result.Result`; its name is the command's,
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
        listed: Whether the help text has it; of a dataclass, whether it has its fields.
    """

    help: str
    metavar: str | None = None
    positional: bool = False
    bounds: tuple[int, int] | None = None
    listed: bool = True


def seed_of(what: str) -> Option:
    """The option of a study's seed."""
    return Option(f"Seed of {what}.", "N", bounds=(0, 2**32 - 1))


def described(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    """A parameter whose annotation is `Annotated[kind, Option]`; an empty description if it is not.

    Raises:
        TypeError: Another annotation stands there.
    """
    if get_origin(annotation) is not Annotated:
        annotation = Annotated[annotation, Option("")]
    if not isinstance(option := get_args(annotation)[1], Option):
        raise TypeError(f"{name} must be described by an Option, got {option!r:.80}")
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def options_of(study: Study) -> list[inspect.Parameter]:
    """The options of a study, those of dataclasses among them, as :func:`described`."""
    found = []
    for each in inspect.signature(study).parameters.values():
        if each.name in GIVEN:
            continue
        parameter = described(each.name, each.annotation, each.default)
        kind, option = get_args(parameter.annotation)
        if is_dataclass(kind):
            own = [described(one.name, one.type, one.default) for one in fields(kind)]
            found += own if option.listed else map(_unlisted, own)
        else:
            found.append(parameter)
    return found


def _unlisted(parameter: inspect.Parameter) -> inspect.Parameter:
    kind, option = get_args(parameter.annotation)
    return parameter.replace(annotation=Annotated[kind, replace(option, listed=False)])


def words_of(study: Study, given: Mapping[str, Any]) -> list[str]:
    """The words of options on the command line; those that are as by default are left out.

    Args:
        study: Its function.
        given: Values of options by name; others are ignored.
    """
    words, flags = list[str](), list[str]()
    for option in options_of(study):
        value = given.get(option.name, option.default)
        if value == option.default:
            continue
        flag = f"--{option.name.replace('_', '-')}"
        if value is True:
            flags.append(flag)
        elif isinstance(value, list):
            flags += [word for each in value for word in (flag, str(each))]
        elif get_args(option.annotation)[1].positional:
            words.append(str(value))
        else:
            flags += [flag, ",".join(map(str, value)) if isinstance(value, tuple) else str(value)]
    return [*words, *flags]
