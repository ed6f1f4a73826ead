"""Constants on the page of the diagnosis agree with the code."""

import re
from importlib import import_module
from pathlib import Path

import pytest

import ftc.fdi

PAGE = (Path(__file__).parents[2] / "docs" / "diagnosis.md").read_text()
ROWS = re.findall(r"^\| `(\w+)\.([\w.]+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)
RULES = "observer", "monitor", "decision"
"""Files whose constants are all on the page."""


@pytest.mark.parametrize(("file", "name", "value_text", "unit", "reason"), ROWS)
def test_a_constant_of_the_page_is_that_of_the_code(file, name, value_text, unit, reason):
    inside = (Path(ftc.fdi.__file__).parent / f"{file}.py").exists()
    value = import_module(f"ftc.fdi.{file}" if inside else f"ftc.{file}")
    for part in name.split("."):
        value = getattr(value, part)
    numbers = value if isinstance(value, tuple) else (value,)
    assert [float(each) for each in value_text.split(",")] == [*numbers]
    assert unit.strip() and reason.strip()


@pytest.mark.parametrize("file", RULES)
def test_every_constant_of_the_rules_is_on_the_page(file):
    code = (Path(ftc.fdi.__file__).parent / f"{file}.py").read_text()
    lines = re.findall(r"^((?:_?[A-Z]\w+, )*_?[A-Z]{2}\w+) = [-\d(]", code, re.MULTILINE)
    constants = {name for line in lines for name in line.split(", ")}
    assert constants - {name for of, name, *_ in ROWS if of == file} <= ROUND_OFF


ROUND_OFF = {"_LEAST_OFFSET", "_MOST_SAMPLES", "_TIE"}
"""Constants against round-off and memory growth, which are not on the page."""
