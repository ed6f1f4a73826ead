"""What Ctrl-C and the signals to end and to hang up do: one sentence and an exit code.

Nothing but the standard library, and little of it: this is ready before any package is imported.
"""

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPTION = "interrupted: no file was left half-written"

_LONGEST = 2000

_TWICE_S = 2.0
"""Terminals and `timeout` send a signal twice; a person who sends another later means it."""

_came: list[tuple[int, float]] = []
"""The signal that ends this process, and when it came."""


def interrupted() -> int:
    """The exit code of the signal that has come, 130 of Ctrl-C; 0 if none has."""
    return 128 + _came[0][0] if _came else 0


def printable(text: str) -> str:
    """The text without what would command a terminal, on one line: it may be anybody's."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def notice(sentence: str) -> None:
    """Print a sentence on standard error, on one line; what it quotes may be anybody's."""
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
    """From now on a signal is a KeyboardInterrupt: there are workers to end and files to remove."""
    for each in SIGNALS:
        if signal.getsignal(each) is _exit:
            signal.signal(each, _raise)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold signals back until the end of the block, and from processes that are started in it."""
    former = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


def _exit(number: int, _frame: FrameType | None) -> None:
    notice(INTERRUPTION)
    os._exit(interrupted() or 128 + number)


def _raise(number: int, frame: FrameType | None) -> None:
    if not _came:
        _came.append((number, time.monotonic()))
        raise KeyboardInterrupt
    if time.monotonic() > _came[0][1] + _TWICE_S:
        _exit(number, frame)
