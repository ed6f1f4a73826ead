"""The documentation runs, and says the numbers that come out."""

import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_the_readmes_snippet_runs_and_freezes_the_failed_strut():
    snippet = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    assert snippet
    names: dict = {}
    exec(snippet.group(1), names)
    assert names["rates"][0] == 0.0
    nominal = names["system"].kinematics()
    np.testing.assert_allclose(nominal.J[:2] @ names["rates"], [1e-4, 0.0], atol=1e-15)


@pytest.mark.parametrize("angle", ["alpha", "beta"])
def test_the_readmes_table_is_the_one_that_comes_out(table1, angle):
    for label, key in (
        ("here", f"{angle}_rms_urad"),
        ("linear model of this bench", f"predicted_{angle}_rms_urad"),
        ("paper", f"paper_{angle}_rms_urad"),
    ):
        row = re.search(rf"^\| {angle}, {label} \|(.*)\|$", README, re.MULTILINE)
        assert row
        printed = [float(cell.strip(" *")) for cell in row.group(1).split("|")]
        computed = [column[key] for column in table1["columns"]]
        np.testing.assert_allclose(printed, computed, atol=6e-4)


def unmarked(mjcf: str) -> list[str]:
    """Elements with a number whose nearest comment above names no origin."""
    origin = re.compile(r"\[(paper|geometry|chosen|derived)\b")
    comment, found = "", []
    for token in re.findall(r"<!--.*?-->|<[^!?/][^>]*>", mjcf, re.DOTALL):
        if token.startswith("<!--"):
            comment = token
        elif re.search(r'="[-+.\d][^"]*"', token) and not origin.search(comment):
            found.append(token)
    return found


def test_every_number_of_the_machine_file_says_where_it_comes_from():
    text = (ROOT / "models" / "fjh.xml").read_text()
    assert unmarked(text) == []
    assert unmarked(text.replace("[chosen", "[guessed")) != []
