"""Check of numbers against limits, with the standard library alone."""

from numbers import Integral, Real
from typing import Any


def check_within(name: str, value: Any, low: float, high: float) -> None:
    """Check that a value is a number within limits, a whole number if both limits are integers.

    Raises:
        ValueError: The value is no number, or outside the limits.
    """
    is_integer = isinstance(low, int)
    kind: type = Integral if is_integer else Real
    # In Python a bool is an Integral. For NaN both comparisons are false.
    if not isinstance(value, kind) or isinstance(value, bool) or not low <= value <= high:
        from argument_checks import short_repr  # late: the help text does not wait for NumPy

        expected = "a whole number" if is_integer else "a number"
        raise ValueError(
            f"{name} must be {expected} from {low:g} to {high:g}, got {short_repr(value)}"
        )
