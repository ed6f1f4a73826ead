"""Numbers within limits; only the standard library, as long as they are."""

from numbers import Integral, Real
from typing import Any


def check_within(name: str, value: Any, low: float, high: float) -> None:
    """Whether a value is a number in these limits; a whole one, if they are.

    Raises:
        ValueError: It is not.
    """
    whole = isinstance(low, int)
    kind: type = Integral if whole else Real
    # To Python a truth value is a whole number. Of NaN neither comparison holds.
    if not isinstance(value, kind) or isinstance(value, bool) or not low <= value <= high:
        from argument_checks import short_repr  # late: the help text does not wait for NumPy

        said = "a whole number" if whole else "a number"
        raise ValueError(f"{name} must be {said} from {low:g} to {high:g}, got {short_repr(value)}")
