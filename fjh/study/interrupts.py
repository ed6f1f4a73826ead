"""Handling of Ctrl-C, SIGTERM and SIGHUP by one sentence and an exit code.

It imports little, so that the handlers exist before slow imports.
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
"""Time [s] in which a second signal is ignored, because terminals and `timeout` send two."""

_received: list[tuple[int, float]] = []
"""Signal that ends this process, with its time [s]; empty before a signal."""


def interrupted() -> int:
    """Return the exit code of the received signal, 130 for Ctrl-C; 0 if there is none."""
    return 128 + _received[0][0] if _received else 0


def printable(text: str) -> str:
    """Return untrusted text on one line, with control characters escaped."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def notice(sentence: str) -> None:
    """Print a sentence, which may quote untrusted text, on one line of standard error."""
    short = sentence if len(sentence) <= _LONGEST else f"{sentence[: _LONGEST - 3]}..."
    with suppress(OSError):  # the terminal may be closed
        print(f"fjh: {printable(short)}", file=sys.stderr, flush=True)


def exit_on_interrupt() -> None:
    """Make signals end the process with one sentence; call this before imports.

    Imported packages could catch or convert a KeyboardInterrupt. Signals that this process ignores,
    as under `nohup` and in workers, remain ignored.
    """
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _exit)


def raise_on_interrupt() -> None:
    """Make signals raise KeyboardInterrupt, so that workers end and temporary files are removed."""
    for number in SIGNALS:
        if signal.getsignal(number) is _exit:
            signal.signal(number, _raise)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Block signals until the end of the block, also in processes that are started in it."""
    former = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)


def _exit(number: int, _frame: FrameType | None) -> None:
    notice(INTERRUPTION)
    os._exit(interrupted() or 128 + number)


def _raise(number: int, frame: FrameType | None) -> None:
    if not _received:
        _received.append((number, time.monotonic()))
        raise KeyboardInterrupt
    if time.monotonic() > _received[0][1] + _TWICE_S:
        _exit(number, frame)
