"""Functions that are compiled when their module is first imported, and then read from the cache.

Compiling them all takes 90 to 135 s of one core. It happens once for each version and processor,
and is announced by one log record a process; where all that it needs are in the cache there is
none. A cache that cannot be read or written is another record, and costs this time at every start.
"""

import logging
from collections.abc import Callable, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any

from numba import njit
from numba.core import event
from numba.core.caching import FunctionCache

NOTICE = (
    "fjh: compiling numeric functions (mappings, limits, control, diagnosis) for this computer, "
    "once: up to two minutes"
)

_complaints: list[str] = []
"""That the cache cannot be used; a process says so once."""


def kernel(
    signature: Any, *, calls: Sequence[ModuleType] = (), **options: Any
) -> Callable[[Callable[..., Any]], Any]:
    """A decorator: `numba.njit` for one signature, with numpy's rules for division, cached.

    Args:
        signature: Types of the arguments and of what is returned.
        calls: Modules whose kernels it calls: what is cached holds them, too, and its name has
            their text in it, since the compiler looks at the function's own file alone.
        options: Others of `numba.njit`.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        if calls:
            text = b"".join(Path(str(module.__file__)).read_bytes() for module in calls)
            function.__qualname__ += f"_{sha256(text).hexdigest()[:12]}"
        # numba looks into its cache first, and starts this event only if that has nothing.
        with event.install_listener("numba:compile", _Announcement()):
            try:
                return njit(signature, cache=True, error_model="numpy", **options)(function)
            except Exception as error:  # a damaged file raises a dozen kinds
                without = njit(signature, error_model="numpy", **options)(function)
                if not _complaints:
                    _complaints.append(_complaint(function, error))
                    logging.getLogger(__name__).warning(_complaints[0])
                return without

    return compiled


def _complaint(function: Callable[..., Any], error: Exception) -> str:
    """What is wrong with the cache, and where it is."""
    try:
        place = f"in {FunctionCache(function).cache_path}"
    except RuntimeError:  # nor may the user's own folder be written to
        place = "of numba"
    why = " ".join(f"{type(error).__name__}: {error}".split())
    return (
        f"fjh: the compiler's cache {place} cannot be used ({why}): until it is removed or can be "
        "written to, every start takes up to two minutes longer"
    )


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
