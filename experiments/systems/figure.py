"""The figure of `fjh systems`: each mechanism's major task in every condition."""

from itertools import cycle

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.output.palette import BLACK, LINES
from experiments.output.plotting import PAGE_IN, new_figure
from experiments.systems.mechanisms import MECHANISMS, Mechanism
from experiments.systems.study import Examination

_COLUMNS = 2
_ROW_IN = 2.6


def figure_systems(examinations: list[Examination]) -> Figure:
    """Each mechanism's major task around a polygon, in every condition."""
    rows = -(-len(MECHANISMS) // _COLUMNS)
    figure = new_figure(PAGE_IN, _ROW_IN * rows)
    figure.suptitle("Major task around an octagon, sound and failed, simulated")
    panels = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    for axes, mechanism in zip(panels, MECHANISMS, strict=False):
        ours = [one for one in examinations if one.mechanism == mechanism]
        _polygons(axes, mechanism, ours)
    for axes in panels[len(MECHANISMS) :]:
        axes.remove()
    return figure


def _polygons(axes: Axes, mechanism: Mechanism, ours: list[Examination]) -> None:
    for one, color in zip(ours, cycle(LINES), strict=False):
        lost = one.report.unstable_major or one.report.unmanipulable
        reached = 1e6 * one.polygon.reached[:, :2].T
        axes.plot(*reached, "--" if lost else "-", color=color, lw=0.8, label=str(one.condition))
    asked_for = 1e6 * ours[0].polygon.desired[:, :2].T
    axes.plot(*asked_for, "o", color=BLACK, ms=3, label="asked for")
    first, second = (f"{name}, µ{mechanism.major_unit}" for name in mechanism.major_names[:2])
    axes.set(
        title=mechanism.title, xlabel=first, ylabel=second, aspect="equal", adjustable="datalim"
    )
    axes.legend(title="broken; dashed:\ntask lost", loc="upper left", bbox_to_anchor=(1.0, 1.0))
