"""Numbers of a command within bounds, so that none drowns in round-off or overflows.

Nothing is imported that takes time: wrong ones are refused at once.
"""

from numbers import Real
from typing import Any

from experiments.study.study import WrongInput

BOUNDS = {
    "size": (1e-12, 1e3),
    "noise": (1e-15, 1e3),
    "crossover": (1e-6, 1e6),
    "period": (1e-7, 1.0),
    "servo": (1e-3, 1e6),
    "turn": (1e-3, 1e6),
    "duration": (1e-6, 1e4),
}
"""Least and most of each number, in its unit: atoms and kilometres, hours and the shortest step."""

LARGEST_WEIGHT = 1e12


def check_number(name: str, value: Any) -> None:
    """Refuse a number of the command that no robot, and no computer, has any use for.

    Raises:
        WrongInput: It is not within :data:`BOUNDS`.
    """
    low, high = BOUNDS[name]
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not low <= value <= high:  # pyright: ignore[reportOperatorIssue]
        raise WrongInput(f"--{name} must be from {low:g} to {high:g}, got {value!r:.80}")


def weights_of(option: str, text: str) -> tuple[float, ...]:
    """Numbers with commas between.

    Raises:
        WrongInput: They are none, negative, or larger than :data:`LARGEST_WEIGHT`.
    """
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise WrongInput(f"{option} must be numbers with commas between, got {text:.80}") from None
    if not all(0 <= value <= LARGEST_WEIGHT for value in values):
        raise WrongInput(f"{option} must be from 0 to {LARGEST_WEIGHT:g}, got {text:.80}")
    return values
