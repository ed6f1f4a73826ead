"""Names of a twist's rows, and units of rows and actuators in data and in text."""

from collections.abc import Iterable, Sequence
from math import hypot
from typing import Any

ROWS = ("turn x", "turn y", "turn z", "x", "y", "z")
"""Names of the rows of a twist."""
ROW_NAMES = ("rx", "ry", "rz", "x", "y", "z")
"""Short names of the rows of a twist, as typed on the command line."""
_PREFIXES = {1.0: "", 1e3: "m", 1e6: "µ", 1e9: "n"}


def by_unit(name: str, value: Any, units: Sequence[str]) -> dict[str, Any]:
    """Return entries `name_rad` and `name_m`, one for each unit that occurs.

    A list `value` has one number for each of the units; each entry gets those in its unit, in
    order. A single number, or None, is repeated in each entry.
    """
    entries = {}
    for unit in dict.fromkeys(units):
        selected = value
        if isinstance(value, list):
            selected = [v for v, u in zip(value, units, strict=True) if u == unit]
        entries[f"{name}_{unit}"] = selected
    return entries


def norms_text(values: Iterable[float], units: Sequence[str]) -> str:
    """Return the norm of all values with the same unit, as text: "3.2 µrad and 1.5 mm"."""
    entries = by_unit("", list(values), units)
    return " and ".join(quantity_text(hypot(*v), unit[1:]) for unit, v in entries.items())


def quantity_text(value: float, unit: str) -> str:
    """Return a quantity as text of three digits with a prefixed unit: "131 mm", "2.27 µrad"."""
    factor, prefix = (1.0, "") if unit == "%" else prefixed(abs(float(f"{value:.3g}")))
    return f"{float(f'{factor * value:.3g}'):g} {prefix}{unit}"


def prefixed(size: float) -> tuple[float, str]:
    """Return the factor and prefix that scale numbers of this size to 1..1000."""
    entries = (entry for entry in _PREFIXES.items() if size * entry[0] >= 1.0 or not size > 0.0)
    return next(entries, list(_PREFIXES.items())[-1])
