"""The checks of figures see what they are for."""

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fjh.study.palette import BLACK, BLUE, GREEN, VERMILION
from fjh.study.plotting import new_figure
from tests.figure_checks import faults


def good() -> tuple[Figure, Axes]:
    """Two curves, one with a legend entry and one with a label of its colour; bars; an area."""
    figure = new_figure(3.5, 3)
    axes, bars = figure.subplots(2, 1)
    axes.set(title="curves", xlabel="time, s", ylim=(0, 4))
    axes.plot([0, 1], [1, 1], color=BLUE, label="flat")
    axes.plot([0, 1], [0, 1], color=GREEN)
    axes.text(0.0, 0.4, "rising", color=GREEN)
    axes.legend(loc="upper left")
    bars.bar([0, 1], [1, 2], color=BLUE)
    return figure, axes


def test_a_good_figure_has_no_faults():
    figure, _ = good()
    assert faults(figure) == []


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda axes: axes.axhline(0.2, color=BLACK, ls=":"), "nothing explains"),
        (lambda axes: axes.axvspan(0.8, 0.9, color=VERMILION), "nothing explains"),
        (lambda axes: axes.scatter([0.5], [1.5], color=VERMILION), "nothing explains"),
        (lambda axes: axes.texts[0].set_position((0.7, 3)), "nothing explains"),
        (lambda axes: axes.plot([0.0, 0.5], [3.6, 3.6], color=BLUE), "a legend hides"),
        (lambda axes: axes.plot([0.1], [3.6], "o", color=BLUE, label="here"), "a legend hides"),
        (lambda axes: axes.scatter([0.1], [3.6], color=BLUE, label="one"), "a legend hides"),
        (lambda axes: axes.step([0, 0.1], [0, 3.6], color=BLUE), "a legend hides"),
        (lambda axes: axes.axhspan(3, 4, color=BLUE, label="span"), "a legend hides"),
        (lambda axes: axes.text(0.5, 1, "flat", va="center"), "goes through 'flat'"),
        (lambda axes: axes.text(1, 2, "tiny", fontsize=6, ha="right"), "'tiny' has 6 pt"),
        (lambda axes: axes.text(1, 2, "x", family="DejaVu Serif", ha="right"), "several fonts"),
        (lambda axes: axes.text(1, 2, "beyond the edge", in_layout=False), "is cut off"),
        (lambda axes: axes.text(0.02, 0.42, "again"), "'rising' and 'again' overlap"),
    ],
)
def test_each_fault_is_seen(spoil, words):
    figure, axes = good()
    spoil(axes)
    assert words in "; ".join(faults(figure))


def test_tick_labels_that_are_not_printed_overlap_nothing():
    figure, axes = good()
    axes.set_xticks([-0.1, 0, 1], ["far beyond the end", "0", "1"])
    axes.set_xlim(0, 1)
    figure.axes[1].set_axis_off()
    figure.axes[1].text(0, 0, "0 and no axis", transform=figure.axes[1].transAxes, va="top")
    assert faults(figure) == []
