"""A limit on the time that somebody else's code may take."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import argument_checks as check

LEAST_S = 1e-3
"""Less would come before the last one is dealt with."""


class TimeExceeded(BaseException):
    """The code took too long; not an `Exception`, so that the code's own handlers let it pass."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `TimeExceeded` in what runs in this context once so much time has passed.

    It is raised as soon as Python runs again: compiled code that does not return is not stopped.

    Raises:
        ValueError: Less than a millisecond, or more than a day. Or not in the main thread, the only
            one in which Python handles signals.
    """
    check.duration("seconds", seconds, least=LEAST_S)

    def stop(number: int, frame: FrameType | None) -> None:
        raise TimeExceeded

    former = signal.signal(signal.SIGALRM, stop)
    # Again and again: code that catches everything may have caught the first.
    signal.setitimer(signal.ITIMER_REAL, seconds, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former)
