"""Ctrl-C before there is anything to end: while packages are still being imported."""

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130
SENTENCE = "interrupted: no file was left half-written"


def leave_at_once() -> None:
    """From now on Ctrl-C ends the process with one sentence; importing packages knows no better.

    An exception in the middle of an import comes out as whatever the package makes of it. Workers,
    which are deaf to Ctrl-C, stay so.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def raise_from_now_on() -> None:
    """From now on Ctrl-C is a KeyboardInterrupt: there are workers to end and files to remove.

    So is being told to end, or to hang up.
    """
    if signal.getsignal(signal.SIGINT) is _leave:
        for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(each, signal.default_int_handler)


def _leave(_signal: int, _frame: FrameType | None) -> None:
    sys.stderr.write(f"fjh: {SENTENCE}\n")
    sys.stderr.flush()
    os._exit(INTERRUPTED)
