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


def readme_cells(label: str) -> list[str]:
    """Cells of the row of the README's result table that starts with a label."""
    row = re.search(rf"^\| {re.escape(label)} \|(.*)\|$", README, re.MULTILINE)
    assert row, label
    return [cell.strip() for cell in row.group(1).split("|")]


def test_the_readmes_peaks_residuals_and_ratios_are_those_that_come_out(table1):
    columns = table1["columns"]
    peaks = [
        [column["secondary_peak"][axis] for axis in ("t_x_um", "t_y_um")] for column in columns
    ]
    printed = [cell.split(", ") for cell in readme_cells("peak t_x, t_y [µm]")]
    np.testing.assert_allclose(np.array(printed, dtype=float), peaks, rtol=0.02, atol=0.006)
    residuals_nm = [1e9 * column["closure_residual_max_m"] for column in columns]
    printed = [float(cell) for cell in readme_cells("largest closure residual [nm]")]
    np.testing.assert_allclose(printed, residuals_nm, atol=0.05)

    falls = np.divide(peaks[3], peaks[4])
    assert f"fall {falls[0]:.0f} and {falls[1]:.0f} times" in README
    cost = [columns[5][f"{a}_rms_urad"] / columns[0][f"{a}_rms_urad"] for a in ("alpha", "beta")]
    assert f"{cost[0]:.2f} and {cost[1]:.2f} here" in README.replace("\n", " ").replace("  ", " ")
    spared = 1 - np.divide(*(columns[k]["strut_input_rms_percent"] for k in (1, 0)))[[0, 2, 4]]
    assert spared == pytest.approx(0.60, abs=0.01)
    assert table1["jacobian_comparison"]["largest_rms_difference_urad"] < 5e-5


TOLD = {
    "stiffness": "tiffness|N m/rad",
    "damping": "[Dd]amp",
    "mass": "mass|drawn only|draw ",
    "range": "[Ss]troke",
    "springref": "springref",
    "gainprm": "gainprm",
    "forcerange": "80 N",
    "solref": "time constant",
    "solreflimit": "stops",
    "timestep": "ms",
    "gravity": "Gravity",
    "diaginertia": r"kg m\^2",
}
"""What the comment above must speak of when a physical attribute is set."""


def unmarked(mjcf: str) -> list[str]:
    """Elements with a number whose nearest comment above names no origin, or not this number."""
    origin = re.compile(r"\[(paper|geometry|chosen|derived)\b")
    comment, found = "", []
    for token in re.findall(r"<!--.*?-->|<[^!?/][^>]*>", mjcf, re.DOTALL):
        if token.startswith("<!--"):
            comment = token
            continue
        numbers = re.findall(r'(\w+)="[-+.\d][^"]*"', token)
        told = all(re.search(TOLD.get(name, ""), comment) for name in numbers)
        if numbers and not (origin.search(comment) and told):
            found.append(token)
    return found


def test_every_number_of_the_machine_file_says_where_it_comes_from():
    text = (ROOT / "models" / "fjh.xml").read_text()
    assert unmarked(text) == []
    assert unmarked(text.replace("[chosen", "[guessed")) != []
    assert unmarked(text.replace("springref is", "it is")) != []
