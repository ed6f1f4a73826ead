"""What came, in the sentence that refuses it."""

from typing import Any

_LONGEST = 80


def shown(value: Any) -> str:
    """The value on one short line."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # Python does not write out integers of thousands of digits
        text = f"a huge {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
