"""Functions that are compiled when their module is first imported, and then read from the cache.

Compiling them all takes half a minute. It happens once for each version and processor, and is
announced by one log record a process; where all are in the cache there is none.
"""

import logging
from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit
from numba.core import event

NOTICE = "fjh: compiling numeric functions for this computer, once: about half a minute"


def kernel(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """A decorator: `numba.njit` for one signature, with numpy's rules for division, cached.

    Args:
        signature: Types of the arguments and of what is returned.
        options: Others of `numba.njit`.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        # numba looks into its cache first, and starts this event only if that has nothing.
        with event.install_listener("numba:compile", _Announcement()):
            return njit(signature, cache=True, error_model="numpy", **options)(function)

    return compiled


class _Announcement(event.Listener):
    """Says that something is being compiled."""

    def on_start(self, event: Any) -> None:
        announce()

    def on_end(self, event: Any) -> None:
        pass


@cache
def announce() -> None:
    """Log the notice; a process does so once."""
    logging.getLogger(__name__).warning(NOTICE)
