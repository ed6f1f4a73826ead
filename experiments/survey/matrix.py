"""A matrix of effects, and limits of its inputs, from text files of numbers."""

import csv
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.study.interrupts import printable
from experiments.study.spelling import check_file, nearest
from experiments.study.study import WrongInput
from experiments.survey.survey import Limited, Subject
from prioritized import ConstrainedSystem
from sim import Array

_UNSTATED = "none are given, and each input is taken from -1 to 1"

LARGEST = 1e12
"""Of the numbers; larger ones are mistakes, and their squares would overflow."""
MOST = 200
"""Rows or columns."""
MOST_CHARACTERS = 200
"""Of a cell: a name is shown in tables and pictures."""


@dataclass(frozen=True)
class Written:
    """Numbers of a file with the names that stand beside them; no names where there are none."""

    values: Array
    rows: tuple[str, ...]
    columns: tuple[str, ...]


def matrix_subject(
    file: Path, lower: str | None, upper: str | None, major: str | None, hold: str | None
) -> Subject:
    """What a file's matrix B is surveyed as: effects = B inputs.

    Args:
        file: Rows are effects, columns inputs; a first row and a first column may be names.
        lower: Limits of the inputs: a number, or a file with one for each.
        upper: Likewise.
        major: Rows by number or name, with commas; None is all of them.
        hold: Effects at rest, one a major row, with commas; None is none.

    Raises:
        WrongInput: Any of them is none; one sentence says where and why.
    """
    B = read_matrix(file, "--matrix")
    names = B.columns or tuple(f"u{k + 1}" for k in range(B.values.shape[1]))
    rows = B.rows or tuple(f"row {k}" for k in range(len(B.values)))
    chosen = _rows(major, B.rows, len(rows))
    return Subject(
        title=printable(file.stem),
        sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
        actuators=names,
        units=("1",) * len(names),
        rows=rows,
        row_units=("1",) * len(rows),
        major=chosen,
        system=ConstrainedSystem(B.values, None, range(len(names))),
        rates=input_limits(lower, upper, names, _UNSTATED),
        hold=None if hold is None else _numbers("--hold", hold, len(chosen)),
    )


def read_matrix(file: Path, option: str) -> Written:
    """The numbers of a file, separated by commas, semicolons, tabs or blanks; # begins a comment.

    Raises:
        WrongInput: There is no such file, or no such matrix in it.
    """
    try:
        check_file(file)
        text = file.read_text(encoding="utf-8-sig")
    except WrongInput as error:
        raise WrongInput(f"{option}: {error}") from None
    except (OSError, UnicodeDecodeError):
        raise WrongInput(f"{option} {file} is no text file that can be read") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    called = f"{option} {file}"
    return _parsed([_cells(line, f"{called}: row {k}") for k, line in enumerate(lines, 1)], called)


def _cells(line: str, called: str) -> list[str]:
    """The cells of a row, with nothing in them that would command a terminal."""
    mark = next((each for each in ",;\t" if each in line), None)
    try:
        cells = line.split() if mark is None else next(csv.reader([line], delimiter=mark))
    except csv.Error as error:
        raise WrongInput(f"{called} cannot be read: {error}") from None
    if (longest := max(map(len, cells))) > MOST_CHARACTERS:
        raise WrongInput(
            f"{called} has a cell of {longest:,} characters; at most {MOST_CHARACTERS} are taken"
        )
    return [printable(cell.strip()) for cell in cells]


def _parsed(cells: list[list[str]], called: str) -> Written:
    """Names are a first row, or a first column, in which nothing is a number."""
    has_header = bool(cells) and not any(map(_is_number, cells[0][1:] or cells[0]))
    header, body = (cells[0], cells[1:]) if has_header else ([], cells)
    has_names = all(len(line) > 1 and not _is_number(line[0]) for line in body)
    rows = [line[0] for line in body] if has_names else []
    values = _numeric([line[1:] if has_names else line for line in body], called)
    width = values.shape[1]
    if has_header and len(header) not in (width, width + has_names):
        raise WrongInput(f"{called}: the first row has {len(header)} names for {width} columns")
    columns = header[len(header) - width :] if has_header else []
    for what, names in (("rows", rows), ("columns", columns)):
        if len(set(names)) < len(names) or "" in names:
            raise WrongInput(f"{called}: names of {what} must differ and not be empty")
    return Written(values, tuple(rows), tuple(columns))


def _numeric(cells: list[list[str]], called: str) -> Array:
    if not cells or not cells[0]:
        raise WrongInput(f"{called} has no numbers")
    width = len(cells[0])
    if max(len(cells), width) > MOST:
        raise WrongInput(f"{called} has more than {MOST} rows or columns")
    for k, line in enumerate(cells, 1):
        if len(line) != width:
            raise WrongInput(f"{called}: row {k} has {len(line)} numbers, row 1 has {width}")
        for column, cell in enumerate(line, 1):
            if not (_is_number(cell) and abs(float(cell)) < LARGEST):
                where = f"row {k}, column {column}"
                raise WrongInput(
                    f"{called}: {where} must be a number below {LARGEST:g}, got {cell:.40}"
                )
    return np.array(cells, dtype=float)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def input_limits(
    lower: str | None, upper: str | None, names: tuple[str, ...], unstated: str
) -> Limited:
    """Of the inputs, or rates; without any from -1 to 1 each, for the reason that is given.

    Raises:
        WrongInput: Not a number and no file of as many, or a lower one above its upper one.
    """
    n = len(names)
    if lower is None and upper is None:
        return Limited((-np.ones(n), np.ones(n)), unstated, True)
    low = np.full(n, -np.inf) if lower is None else _side("--lower", lower, n)
    high = np.full(n, np.inf) if upper is None else _side("--upper", upper, n)
    for name, least, most in zip(names, low, high, strict=True):
        if least > most:
            raise WrongInput(f"--lower of {name} is above its --upper: {least:g} > {most:g}")
    return Limited((low, high), "as given by --lower and --upper", False)


def _side(option: str, text: str, n: int) -> Array:
    if _is_number(text):
        value = np.array([float(text)])
    else:
        value = read_matrix(Path(text), option).values.ravel()
    if value.size not in (1, n) or not (np.abs(value) < LARGEST).all():
        raise WrongInput(
            f"{option} must be a number below {LARGEST:g} or a file with {n} of them, got "
            f"{text:.80}" + (f" with {value.size}" if value.size not in (1, n) else "")
        )
    return np.broadcast_to(value, n).copy()


def _numbers(option: str, text: str, count: int) -> Array:
    values = text.split(",")
    if len(values) != count or not all(map(_is_number, values)):
        raise WrongInput(f"{option} must be {count} numbers with commas between, got {text:.80}")
    found = np.array([float(value) for value in values])
    if not (np.abs(found) < LARGEST).all():
        raise WrongInput(f"{option} must be numbers below {LARGEST:g}, got {text:.80}")
    return found


def _rows(major: str | None, names: tuple[str, ...], count: int) -> tuple[int, ...]:
    if major is None:
        return tuple(range(count))
    numbers = {str(k): k for k in range(count)} | {name: k for k, name in enumerate(names)}
    found = []
    for text in map(str.strip, major.split(",")):
        row = numbers.get(text)
        if row is None or row in found:
            near = nearest(text, names or numbers, listed=True)
            raise WrongInput(f"--major must be different rows of the matrix, got {text:.80}{near}")
        found.append(row)
    return tuple(found)
