"""What Ctrl-C and the signals to end and to hang up do, at any moment: one sentence and its code.

Nothing but the standard library, and little of it: this is ready before any package is imported.
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPTION = "interrupted: no file was left half-written"

_PATIENCE_S = 10.0
"""How long files and workers may take to be cleared away, before the process ends without."""
_SOON_S = 0.01

_LONGEST = 2000

_came: list[int] = []
"""The signal that ends this process, once it has come."""
_held: list[bool] = []
"""Blocks that none may interrupt, and the signals that have come within."""
_waiting: list[int] = []
_lost: list[bool] = []
"""Whether Python had to drop its exception."""


def interrupted() -> int:
    """The exit code of the signal that has come, 130 of Ctrl-C; 0 if none has."""
    return 128 + _came[0] if _came else 0


def printable(text: str) -> str:
    """The text without what would command a terminal, on one line: it may be anybody's."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def notice(sentence: str) -> None:
    """A sentence on standard error, whatever is left out or shown beside it: one line.

    What it quotes may be anybody's, and would fill the terminal.
    """
    short = sentence if len(sentence) <= _LONGEST else f"{sentence[: _LONGEST - 3]}..."
    with suppress(OSError):  # the terminal may have gone
        print(f"fjh: {printable(short)}", file=sys.stderr, flush=True)


def exit_on_interrupt() -> None:
    """From now on a signal ends the process with one sentence: for the time of the imports.

    An exception in the middle of an import comes out as whatever the package makes of it. A signal
    that this process ignores, as workers and `nohup` do, it goes on ignoring.
    """
    for each in SIGNALS:
        if signal.getsignal(each) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(each, _exit)


def raise_on_interrupt() -> None:
    """From now on it is a KeyboardInterrupt: there are workers to end and files to remove."""
    for each in SIGNALS:
        if signal.getsignal(each) is _exit:
            signal.signal(each, _raise)
            sys.unraisablehook = _unraisable


def ignore_interrupts() -> None:
    """From now on there is nothing to interrupt: all is written, and said."""
    for each in (*SIGNALS, signal.SIGALRM):
        signal.signal(each, signal.SIG_IGN)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """A signal that comes within the block is raised at its end: it is short, and makes a thing."""
    _held.append(True)
    try:
        yield
    finally:
        _held.pop()
        if _waiting and not _held:
            _raise(_waiting[0], None)


def _exit(number: int, _frame: FrameType | None) -> None:
    code = interrupted() or 128 + number
    notice(INTERRUPTION)
    os._exit(code)


def _raise(number: int, _frame: FrameType | None) -> None:
    """Raise, once: `timeout` and terminals send a signal twice, and clearing away takes a while."""
    if _held:
        _waiting.append(number)
        return
    _came.append(number)
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, _late)
    signal.setitimer(signal.ITIMER_REAL, _PATIENCE_S)
    raise KeyboardInterrupt


def _late(number: int, frame: FrameType | None) -> None:
    """Raise again what Python dropped; or end without clearing away."""
    if not _lost:
        _exit(number, frame)
    _lost.clear()
    signal.setitimer(signal.ITIMER_REAL, _PATIENCE_S)
    raise KeyboardInterrupt


def _unraisable(dropped: Any) -> None:
    """A KeyboardInterrupt that came in a finalizer, from where none can be raised, comes again."""
    if dropped.exc_type is KeyboardInterrupt and _came:
        _lost.append(True)
        signal.setitimer(signal.ITIMER_REAL, _SOON_S)
    elif not _came:  # what is dropped while all is cleared away is of no interest
        sys.__unraisablehook__(dropped)
