"""Code of a page, and the output stated on the page."""

import contextlib
import io
import re

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")


def assert_prints(printed: str, page: str) -> None:
    """Assert equal text and whole numbers, and other numbers to one unit of the last digit.

    Rounding may differ between processors, and zeros may have a sign. Spaces count as one.
    """
    numbers, expected = (_NUMBER.findall(text) for text in (printed, page))
    texts = [" ".join(_NUMBER.sub(" # ", text).split()) for text in (printed, page)]
    assert texts[0] == texts[1]
    for number, wanted in zip(numbers, expected, strict=True):
        mantissa, _, exponent = wanted.partition("e")
        _, _, digits = mantissa.partition(".")
        last = 10.0 ** (int(exponent or 0) - len(digits)) if digits else 0.0
        assert abs(float(number) - float(wanted)) <= 1.001 * last, f"{number}, not {wanted}"


def blocks(text: str) -> list[tuple[str, str]]:
    """Return language and contents of each fenced block."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def run(text: str) -> dict:
    """Execute the Python blocks of a page, check the stated output, and return the names."""
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
