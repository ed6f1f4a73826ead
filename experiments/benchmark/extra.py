"""The packages that only this study needs: the extra `bench`."""

from importlib.metadata import version
from importlib.util import find_spec

PACKAGES = ("mink", "placo", "daqp", "qpsolvers", "threadpoolctl")
"""The peers, the interface between mink and daqp, and what keeps all of them to one thread."""


def missing() -> list[str]:
    """Those that are not installed."""
    return [name for name in PACKAGES if find_spec(name) is None]


def versions() -> dict[str, str]:
    """Of all of them."""
    return {name: version(name) for name in PACKAGES}
