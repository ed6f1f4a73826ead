"""Rows of a twist, their units and those of actuators, in published numbers and in sentences."""

from collections.abc import Iterable, Sequence
from math import hypot
from typing import Any

ROWS = ("turn x", "turn y", "turn z", "x", "y", "z")
"""Names of the rows of a twist."""
ROW_NAMES = ("rx", "ry", "rz", "x", "y", "z")
"""The same as they are typed."""
_PREFIXES = {1.0: "", 1e3: "m", 1e6: "µ", 1e9: "n"}


def by_unit(name: str, value: Any, units: Sequence[str]) -> dict[str, Any]:
    """The entries `name_rad` and `name_m`, of those units that there are.

    A list has one value for each of the units, and each entry has those in its unit, in their
    order. One number, or None, is in every unit that there is.
    """
    entries = {}
    for unit in dict.fromkeys(units):
        own = value
        if isinstance(value, list):
            own = [each for each, its in zip(value, units, strict=True) if its == unit]
        entries[f"{name}_{unit}"] = own
    return entries


def norms_said(values: Iterable[float], units: Sequence[str]) -> str:
    """The norm of the values of each unit together: "3.2 µrad and 1.5 mm"."""
    entries = by_unit("", list(values), units)
    return " and ".join(said(hypot(*own), unit[1:]) for unit, own in entries.items())


def said(value: float, unit: str) -> str:
    """A number of three digits in a unit with a prefix: "131 mm", "2.27 µrad"."""
    factor, prefix = (1.0, "") if unit == "%" else prefixed(abs(float(f"{value:.3g}")))
    return f"{float(f'{factor * value:.3g}'):g} {prefix}{unit}"


def prefixed(size: float) -> tuple[float, str]:
    """A factor and its prefix, such that numbers of this size are from 1 to 1000."""
    large = (each for each in _PREFIXES.items() if size * each[0] >= 1.0 or not size > 0.0)
    return next(large, list(_PREFIXES.items())[-1])
