"""Units at the ends of names, and numbers by the name of another unit of the same quantity."""

from collections.abc import Iterable
from math import pi

_QUANTITIES: tuple[dict[str, float], ...] = (
    {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0},
    {"m": 1e9, "mm": 1e6, "um": 1e3, "nm": 1.0},
    {"rad": 1e6, "mrad": 1e3, "urad": 1.0, "deg": 1e6 * pi / 180},
    {"": 100.0, "percent": 1.0},
)
"""Sizes of the units of time, length, angle and share, each in the least of them; a share has none.

Whole numbers and their reciprocals, so that 70 ms are exactly 0.07 s."""

_UNITS = {unit for sizes in _QUANTITIES for unit in sizes if unit}


def split(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit; empty where it has none, or a rate such as m_per_s."""
    stem, _, unit = name.rpartition("_")
    if unit in _UNITS and stem and not stem.endswith("_per"):
        return stem, unit
    return name, ""


def named_otherwise(name: str, known: Iterable[str]) -> tuple[str, float] | None:
    """The first known name that differs by the unit alone, and the size of its unit in the other's.

    `named_ms` and 1e-3 for `named_s`; None where there is none.
    """
    stem, wanted = split(name)
    for each in known:
        its_stem, unit = split(each)
        for sizes in _QUANTITIES:
            if its_stem == stem and unit != wanted and {unit, wanted} <= sizes.keys():
                return each, sizes[unit] / sizes[wanted]
    return None
