"""The figure of `fjh systems`: each mechanism's major task in every condition."""

from functools import partial
from itertools import cycle

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.output.plotting import BLACK, LINES, PAGE_IN, new_figure
from experiments.output.results import Picture
from experiments.systems.runs import Examination, Mechanism, Systems, in_words


def pictures(systems: Systems) -> list[Picture]:
    """The study's figure and its caption."""
    caption = "Each mechanism's major task around an octagon, sound and failed, in simulation."
    alt = (
        "A panel for each mechanism: its paths pass through all corners, but for the dashed ones, "
        "whose task is lost as classified."
    )
    return [Picture("systems", caption, alt, partial(figure_systems, systems))]


def figure_systems(systems: Systems) -> Figure:
    """Each mechanism's major task around a polygon, in every condition."""
    examined = systems.examinations
    rows = -(-len(examined) // 2)
    figure = new_figure(PAGE_IN, 2.6 * rows)
    figure.suptitle("Major task around an octagon, sound and failed, simulated")
    panels = list(figure.subplots(rows, 2, squeeze=False).flat)
    for axes, (mechanism, ours) in zip(panels, examined.items(), strict=False):
        _polygons(axes, mechanism, ours)
    for axes in panels[len(examined) :]:
        axes.remove()
    return figure


def _polygons(axes: Axes, mechanism: Mechanism, ours: list[Examination]) -> None:
    for one, color in zip(ours, cycle(LINES), strict=False):
        style = "--" if one.report.unstable_major or one.report.unmanipulable else "-"
        reached, label = 1e6 * one.polygon.reached[:, :2].T, in_words(one.condition)
        axes.plot(*reached, style, color=color, lw=0.8, label=label)
    axes.plot(*1e6 * ours[0].polygon.desired[:, :2].T, "o", color=BLACK, ms=3, label="commanded")
    first, second = (f"{name}, µ{mechanism.major_unit}" for name in mechanism.major_names[:2])
    axes.set(title=mechanism.title, xlabel=first, ylabel=second)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(title="failed; dashed:\ntask lost", loc="upper left", bbox_to_anchor=(1.0, 1.0))
