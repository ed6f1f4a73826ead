"""What stops a command, as one sentence and an exit code: the only place that tells them apart."""

import inspect
import os
import re
import traceback
from pathlib import Path

from typer.exceptions import TyperException

from fjh.study.errors import Interrupted, OutputError, Unsound, WrongInput
from fjh.study.interrupts import INTERRUPTION, interrupted

UNSOUND, WRONG_INPUT, INTERRUPTED = 1, 2, 130
TRACEBACK = "FJH_TRACEBACK"
"""An environment variable: where it is set, a mistake of the program keeps its traceback."""

_BESIDE = ("argument_checks", "experiments", "ftc", "prioritized", "sim")
_OURS = [
    Path(inspect.getfile(WrongInput)).parents[1],
    *(Path(__file__).parents[2] / room for room in _BESIDE),
]
_FRAME = re.compile(r'File "(.+)", line (\d+), in .+\n +(\S.*)')
"""In a traceback, wherever it is from: that of a worker comes as text."""


def ending_of(error: Exception) -> tuple[str, int]:
    """What a command says of an error, and its exit code; an error in cleaning up is no other.

    Raises:
        Exception: A mistake of the program, where :data:`TRACEBACK` is set.
    """
    if isinstance(error, Interrupted):
        return str(error), interrupted() or INTERRUPTED
    if interrupted():
        return INTERRUPTION, interrupted()
    if isinstance(error, TyperException):
        return error.format_message(), WRONG_INPUT
    if isinstance(error, WrongInput | OutputError):
        return str(error), WRONG_INPUT
    if isinstance(error, Unsound):
        return str(error), UNSOUND
    said, (file, line, code) = " ".join(str(error).split()), _origin(error)
    if isinstance(error, ValueError | TypeError) and code.startswith("raise") and _is_ours(file):
        return said, WRONG_INPUT  # a check of the library, which names what it checks
    if os.environ.get(TRACEBACK):
        raise error
    return (
        f"this is a mistake of the program, please report it: {type(error).__name__} in "
        f"{file.name}, line {line}: {said}; {TRACEBACK}=1 shows all of it"
    ), UNSOUND


def _origin(error: Exception) -> tuple[Path, str, str]:
    """File, line and statement that raised an error, here or in a worker."""
    # That of a worker comes as the text of a cause.
    worker = str(error.__cause__ or "")
    text = worker + "".join(traceback.format_tb(error.__traceback__)) * ("Traceback" not in worker)
    frames = _FRAME.findall(text) or [("nowhere", "0", "")]
    file, line, code = frames[-1]
    return Path(file), line, code


def _is_ours(file: Path) -> bool:
    return any(room in file.parents for room in _OURS)
