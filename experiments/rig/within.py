"""Numbers within limits."""

from typing import Any

import numpy as np

from argument_checks.shown import shown


def check_within(name: str, value: Any, low: float, high: float) -> None:
    """Whether a value is a number in these limits; a whole one, if they are.

    Raises:
        ValueError: It is not.
    """
    whole = isinstance(low, int)
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    # To Python a truth value is a whole number. Of NaN neither comparison holds.
    if not isinstance(value, kinds) or isinstance(value, bool) or not low <= value <= high:
        said = "a whole number" if whole else "a number"
        raise ValueError(f"{name} must be {said} from {low:g} to {high:g}, got {shown(value)}")
