"""The page on the diagnosis has each constant with the value that the code has."""

import re
from importlib import import_module
from pathlib import Path

import ftc.fdi

FOLDER = Path(ftc.fdi.__file__).parent
PAGE = (FOLDER.parents[1] / "docs" / "diagnosis.md").read_text()
ROWS = re.findall(r"^\| `(\w+)\.([\w.]+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)
ROUND_OFF = {"_LEAST_OFFSET", "_MOST_SAMPLES", "_ALIKE"}
"""They keep round-off and memory within bounds, and decide nothing."""


def test_each_constant_of_the_page_is_that_of_the_code():
    for file, name, written, *_ in ROWS:
        inside = (FOLDER / f"{file}.py").exists()
        value = import_module(f"ftc.fdi.{file}" if inside else f"ftc.{file}")
        for part in name.split("."):
            value = getattr(value, part)
        numbers = value if isinstance(value, tuple) else (value,)
        assert [float(each) for each in written.split(",")] == [*numbers], name


def test_each_constant_of_the_rules_is_on_the_page():
    for file in ("observer", "monitor", "decision"):
        code = (FOLDER / f"{file}.py").read_text()
        lines = re.findall(r"^((?:_?[A-Z]\w+, )*_?[A-Z]{2}\w+) = [-\d(]", code, re.MULTILINE)
        found = {name for line in lines for name in line.split(", ")}
        assert found - {name for of, name, *_ in ROWS if of == file} <= ROUND_OFF, file
