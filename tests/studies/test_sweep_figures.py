"""The figures of sweep and atlas: words for columns, points off the line, nothing hidden."""

from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.study.dataset import Columns
from experiments.sweep.figure import NEAR, atlas_picture, sweep_picture
from experiments.sweep.row import ANGLES
from experiments.sweep.sweep_run import KINDS
from experiments.sweep.words import WORDS
from tests.figure_checks import faults

UNITS = {"_s": ", s", "_hz": ", Hz", "_m": ", m", "_urad": ", µrad", "_bits": ", bits", "_a": "A"}


@pytest.mark.parametrize("name", [name for name in KINDS if KINDS[name] in ("real", "integer")])
def test_what_a_range_can_vary_is_in_words_with_its_unit(name):
    words = WORDS[name]
    assert "_" not in words.replace("$t_", "")
    ending = max((end for end in UNITS if name.endswith(end)), key=len, default="")
    assert words.endswith(UNITS.get(ending, "")), words


def drawn(off: float) -> Figure:
    """Three runs; the second has an alpha that is off its prediction by this part of it."""
    predicted = np.array([0.5, 1.0, 2.0])
    errors = {f"{of}{angle}_rms_urad": predicted for of in ("predicted_", "") for angle in ANGLES}
    errors["alpha_rms_urad"] = predicted * [1.0, 1.0 + off, 1.0]
    influence = {"dac_bits": {"alpha": -0.5, "beta": -0.1}}
    off_by = 100 * abs(off)
    agreed = {"compared": 3, "off": int(off_by > 1), "median_percent": 0.0}
    summary = {"influence": influence, "prediction": agreed}
    return sweep_picture(Columns([], errors), np.full(3, True), summary).draw()


def hollow(figure: Figure) -> Iterator[float]:
    """Predictions of the hollow points of alpha."""
    for line in figure.axes[0].lines:
        if line.get_markerfacecolor() == "none" and "alpha" in str(line.get_label()):
            yield from np.asarray(line.get_xdata())


def test_points_off_the_line_are_hollow_and_the_legend_says_why():
    assert list(hollow(drawn(0.5 * NEAR))) == []
    for off in (2 * NEAR, -2 * NEAR):
        assert list(hollow(drawn(off))) == [1.0]
    figure = drawn(2 * NEAR)
    assert faults(figure) == []
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "$\\alpha$, off by more than 1 %: coarse converters" in said
    assert [tick.get_text() for tick in figure.axes[1].get_yticklabels()] == [WORDS["dac_bits"]]


def test_the_title_says_how_many_runs_agree_and_what_matters_most():
    left, right = drawn(2 * NEAR).axes
    assert left.get_title().startswith("The error is as predicted in 2 of 3 runs")
    strongest = next(patch.get_width() for patch in right.patches if isinstance(patch, Rectangle))
    said = f"resolution of the converters, {abs(strongest):.2f}"
    assert right.get_title(loc="right").endswith(said)


def test_the_atlas_claims_only_as_many_failures_as_every_condition_survives():
    """Both conditions of two failures lose a direction: any one is claimed, by its worst run."""
    errors = np.array([0.4, 0.5, 0.6, 0.4, 3.0, 90.0])
    columns = {f"{of}{angle}_rms_urad": errors for of in ("predicted_", "") for angle in ANGLES}
    columns |= {
        "case": np.arange(6),
        "struts": np.array(["SS", "LS", "LS", "SL", "LL", "FF"]),
        "failures": np.array([0, 1, 1, 1, 2, 2]),
        "elastic_possible": np.array([True, True, True, True, False, False]),
        "verdict": np.array(["rigid"] * 4 + ["one_direction"] * 2),
    }
    (axes,) = atlas_picture(Columns([], columns), {"explained": [{"case": 5}]}).draw().axes
    assert axes.get_title().startswith("With any 1 struts failed")
    assert axes.get_title().endswith("at most 0.60 µrad, 0.40 with none failed")
    shown = {str(line.get_label()): np.asarray(line.get_ydata()).tolist() for line in axes.lines}
    assert sorted(shown["both pointing directions left"]) == [0.4, 0.4, 0.6]
    assert (shown["one left"], shown["one left, singular pose"]) == ([3.0], [90.0])
