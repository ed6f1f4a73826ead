"""The command `fjh compare`: two results of one study, what changed by more than noise."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.studies import STUDIES
from experiments.study.foreign import read_json
from experiments.study.interrupts import printable
from experiments.study.results import Check
from experiments.study.study import Study, Unsound, WrongInput

if TYPE_CHECKING:  # the help text does not wait for these imports
    from experiments.study.noise import Difference

PRINTED = 15

_FIRST = typer.Argument(metavar="A", help="The former result: its folder or its JSON file.")
_SECOND = typer.Argument(metavar="B", help="The result that is compared with it, likewise.")


def compare(first: Annotated[Path, _FIRST], second: Annotated[Path, _SECOND]) -> None:
    """Say what changed by more than noise between two results of one study.

    They may be of two versions, or of other settings, which are said first. Entries are compared by
    their names, whatever their order. What noise is depends on what differs: docs/find.md has the
    rule. The checks of both are made anew from the JSON; if one that passed fails now, the exit
    code is 1. The output is Markdown.

    Example: fjh compare docs/data/table1.json results/table1
    """
    files = result_of(first), result_of(second)
    contents = [read_json(file) for file in files]
    study = _study(contents, files)
    from experiments.study.noise import difference  # late: help and refusals do not wait for it

    a, b = contents
    try:
        found = difference(a, b, times=study.times)
    except RecursionError:
        raise WrongInput(f"{first} or {second} is nested too deeply") from None
    checked, failing = compared_checks(*_checks(study, contents, files))
    parts = [*_settings(found), *_numbers(found, study.times), *_rows(found, contents, files)]
    print("\n\n".join([f"**{study.name}**: {first} -> {second}", *parts, checked]))
    if failing:
        many = "a check that passed fails" if len(failing) == 1 else f"{len(failing)} checks fail"
        raise Unsound(f"{many} now: {failing[0]}")


def result_of(place: Path) -> Path:
    """The JSON file of a result, which may be named by its folder."""
    if not place.is_dir():
        return place
    named = [place / f"{study.name}.json" for study in STUDIES]
    if found := [file for file in named if file.exists()]:
        return found[0]
    raise WrongInput(f"{place} has no result of a study, such as {named[0].name}")


def _study(contents: Sequence[Any], files: Sequence[Path]) -> Study:
    known, names = {study.name: study for study in STUDIES}, list[str]()
    for content, file in zip(contents, files, strict=True):
        name = content.get("experiment") if isinstance(content, dict) else None
        if not isinstance(name, str) or name not in known:
            raise WrongInput(f"{file} is no result of a study")
        names.append(name)
    if names[0] != names[1]:
        raise WrongInput(f"{files[0]} is of fjh {names[0]}, {files[1]} of fjh {names[1]}")
    return known[names[0]]


def _settings(found: "Difference") -> Iterator[str]:
    if found.settings:
        said = (f"{each.full_name}: {_said(each.a)} -> {_said(each.b)}" for each in found.settings)
        yield "They differ in:"
        yield _listed(list(said))


def _numbers(found: "Difference", times: bool) -> Iterator[str]:
    from experiments.study.differences import unambiguous
    from experiments.study.noise import ANOTHER_DRAW, REPEATED, grouped

    bound = f"{100 * ANOTHER_DRAW:g} %, or the bounds that they state"
    if not found.drawn:
        bound = "the bounds that they state" if times else f"{REPEATED:g} of their size"
    many = len(found.changed)
    end = ":" if many else "."
    yield f"{many} of {found.compared} values changed by more than noise ({bound}){end}"
    if groups := grouped(found.changed):
        changed, more = zip(*groups, strict=True)
        said = _changes(unambiguous(changed), [(pair.a, pair.b) for pair in changed])
        others = (f", and {count} more of the same name" if count else "" for count in more)
        yield _listed([line + other for line, other in zip(said, others, strict=True)])
    if found.absent:
        yield "In one of them alone:"
        many = Counter(f"{pair.place[0]}, in the {pair.only}" for pair in found.absent)
        yield _listed([f"{count} of {where}" for where, count in many.items()])


def _rows(found: "Difference", contents: Sequence[Any], files: Sequence[Path]) -> Iterator[str]:
    """Rows of two datasets as two samples, where they were drawn otherwise."""
    if not (found.drawn and "dataset" in contents[0]):
        return
    from experiments.study import parquet
    from experiments.study.noise import LEVEL, shifts

    pairs = zip(contents, files, strict=True)
    beside = [file.parent / Path(str(content.get("dataset"))).name for content, file in pairs]
    if missing := [path for path in beside if not path.is_file()]:
        yield f"The rows are not compared: {missing[0]} is missing."
        return
    changed, tested = shifts(*(parquet.read(path) for path in beside))
    yield (
        f"{len(changed)} of {tested} columns of the rows differ by more than two samples do "
        f"(Mann-Whitney, p < {LEVEL:g} for all together){':' if changed else '.'}"
    )
    if changed:
        said = _changes([f"median {each.name}" for each in changed], [e.medians for e in changed])
        why = (f"{e.counts[0]} and {e.counts[1]} rows, p = {e.p:.1g}" for e in changed)
        yield _listed([f"{line}; {reason}" for line, reason in zip(said, why, strict=True)])


def _checks(
    study: Study, contents: Sequence[Any], files: Sequence[Path]
) -> tuple[Sequence[Check] | None, Sequence[Check]]:
    """Those of both; None where an earlier version has other numbers than are checked."""
    try:
        before = study.checks(contents[0])
    except WrongInput:
        before = None
    try:
        return before, study.checks(contents[1])
    except WrongInput as error:
        raise WrongInput(f"{files[1]}: {error}") from None


def compared_checks(before: Sequence[Check] | None, now: Sequence[Check]) -> tuple[str, list[str]]:
    """Lines on the checks, and those that fail now and did not before."""
    known = before or ()
    failed = {_key(check) for check in known if not check.passed}
    failing = {_key(check): str(check) for check in now if not check.passed}
    new = [said for key, said in failing.items() if key not in failed]
    lines = [
        *(f"passed and fails now: {said}" for said in new),
        *(f"failed and fails still: {said}" for key, said in failing.items() if key in failed),
        *(f"failed and passes now: {key[1]}: {key[0]}" for key in sorted(failed - failing.keys())),
    ]
    past = "not known of this version" if before is None else f"{_passed(known)} before"
    said = f"Checks: {_passed(now)} pass, {past}."
    return "\n\n".join([said, *([_listed(lines)] if lines else [])]), new


def _passed(checks: Sequence[Check]) -> str:
    return f"{sum(check.passed for check in checks)} of {len(checks)}"


def _key(check: Check) -> tuple[str, str]:
    """A check without the numbers in its words."""
    return re.sub(r"[\d.]+(e[+-]?\d+)?", "", check.what), check.where


def _listed(lines: Sequence[str]) -> str:
    more = len(lines) - PRINTED
    ends = [f"- and {more} more"] if more > 0 else []
    return "\n".join([*(f"- {printable(line)}" for line in lines[:PRINTED]), *ends])


def _changes(names: Sequence[str], values: Sequence[tuple[Any, Any]]) -> list[str]:
    both = zip(names, values, strict=True)
    return [f"{name}: {_said(a)} -> {_said(b)}{_percent(a, b)}" for name, (a, b) in both]


def _percent(a: Any, b: Any) -> str:
    from experiments.study.differences import is_number

    return f" ({100 * (b - a) / abs(a):+.2g} %)" if is_number(a) and is_number(b) and a else ""


def _said(value: Any) -> str:
    """A value, shortened."""
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list | dict):
        return f"{len(value)} values"
    return f"{value!s:.24}"
