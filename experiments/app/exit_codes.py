"""Messages and exit codes of commands that end by an error."""

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
"""Environment variable; if it is set, an unexpected error prints its traceback."""

_SIBLINGS = ("argument_checks", "experiments", "ftc", "prioritized", "sim")
_FOLDERS = [
    Path(inspect.getfile(WrongInput)).parents[1],
    *(Path(__file__).parents[2] / folder for folder in _SIBLINGS),
]
_FRAME = re.compile(r'File "(.+)", line (\d+), in .+\n +(\S.*)')
"""Pattern of a frame in the text of a traceback."""


def exit_message(error: Exception) -> tuple[str, int]:
    """Return the message and the exit code for an error; an earlier interruption has precedence.

    Raises:
        Exception: The error itself, if it is unexpected and :data:`TRACEBACK` is set.
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
    text, (file, line, code) = " ".join(str(error).split()), _origin(error)
    is_library = any(folder in file.parents for folder in _FOLDERS)
    if isinstance(error, ValueError | TypeError) and code.startswith("raise") and is_library:
        return text, WRONG_INPUT  # an argument check of the library, whose message names it
    if os.environ.get(TRACEBACK):
        raise error
    return (
        f"this is a bug of the program, please report it: {type(error).__name__} in "
        f"{file.name}, line {line}: {text}; {TRACEBACK}=1 shows the traceback"
    ), UNSOUND


def _origin(error: Exception) -> tuple[Path, str, str]:
    """Return the file, line and statement that raised an error, in this process or a worker."""
    # The traceback of a worker is the text of the error's cause.
    worker = str(error.__cause__ or "")
    text = worker + "".join(traceback.format_tb(error.__traceback__)) * ("Traceback" not in worker)
    frames = _FRAME.findall(text) or [("nowhere", "0", "")]
    file, line, code = frames[-1]
    return Path(file), line, code
