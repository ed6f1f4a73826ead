"""Sentences on the amplification of errors by a mapping or a closure, if it is large."""

from argument_checks import Array
from argument_checks.ties import exceeds

LARGE_AMPLIFICATION = 100.0
"""Amplification above which it is reported: 1 % of error becomes as large as the quantity."""

UNCERTAIN = 0.05
"""Relative error of a gain above which it is reported."""


def gain_sentences(largest: float, worst: float) -> list[str]:
    """Describe the ratio of the largest to the smallest gain of the major task, if it is large."""
    if not (worst > 0.0 and exceeds(largest, LARGE_AMPLIFICATION * worst)):
        return []
    return [
        "For the same norm of the active rates, the major task moves up to "
        f"{largest / worst:.3g} times as fast in one direction as in another."
    ]


def length_sentences(length: float | None) -> list[str]:
    """Describe the length that relates angles and lengths in one norm."""
    if length is None:
        return []
    return [
        f"In norms, 1 rad counts as much as a length of {length:.3g}, unless a metric or weight is "
        "given."
    ]


def uncertainty_sentences(gain: float, uncertainty: float) -> list[str]:
    """Describe a gain whose relative error due to the geometry is large."""
    if not exceeds(uncertainty, UNCERTAIN):
        return []
    return [
        f"In some major direction the gain (rates per major velocity) is {gain:.3g} +- "
        f"{100.0 * uncertainty:.2g} %, due to the accuracy of the geometry."
    ]


def servo_sentences(amplification: Array) -> list[str]:
    """Describe the factor from servo errors to errors of the major task, if it is large."""
    if not exceeds(most := amplification.max(initial=0.0), LARGE_AMPLIFICATION):
        return []
    return [
        "A relative error of the active rates may become a relative error of the major task "
        f"{most:.3g} times as large."
    ]


def closure_sentences(condition: float) -> list[str]:
    """Describe the condition number of the closure, if it is large."""
    if not exceeds(condition, LARGE_AMPLIFICATION):
        return []
    return [
        "A relative error of the loops' geometry may become a relative error of the passive rates "
        f"{condition:.3g} times as large."
    ]


def as_sentence(clause: str) -> str:
    """Capitalize a clause and add a full stop."""
    return f"{clause[0].upper()}{clause[1:]}."
