"""The code of a page, and what the page says that it prints."""

import contextlib
import io
import re

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")


def assert_prints(printed: str, page: str) -> None:
    """Words and whole numbers as on the page; other numbers to within one of its last digit.

    A number may lie where it rounds up on one processor and down on another, and a zero may have a
    sign. Blanks count as one: numpy pads columns.
    """
    found, expected = (_NUMBER.findall(text) for text in (printed, page))
    words = [" ".join(_NUMBER.sub(" # ", text).split()) for text in (printed, page)]
    assert words[0] == words[1]
    for number, wanted in zip(found, expected, strict=True):
        mantissa, _, exponent = wanted.partition("e")
        _, _, digits = mantissa.partition(".")
        last = 10.0 ** (int(exponent or 0) - len(digits)) if digits else 0.0
        assert abs(float(number) - float(wanted)) <= 1.001 * last, f"{number}, not {wanted}"


def blocks(text: str) -> list[tuple[str, str]]:
    """Language and contents of each fenced block."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def run(text: str) -> dict:
    """Execute the Python of a page in order; what a block prints must stand in the text after it.

    Returns:
        The names that it leaves.
    """
    names: dict = {}
    printed = ""
    for language, content in blocks(text):
        if language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(content, names)
            printed = output.getvalue()
        elif language == "text":
            assert_prints(printed, content)
    return names
