"""Every failure condition of the hexapod, and whether it can still point."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from experiments.hexapod.failure_atlas import Verdict, verdicts
from experiments.output.palette import BLACK, BLUE
from experiments.output.plotting import PAGE_IN, new_figure
from prioritized import FailureAtlas


def figure_atlas(atlas: FailureAtlas) -> Figure:
    """Map of all 3^6 conditions, and the share of each verdict over the number of failures."""
    figure = new_figure(PAGE_IN, 4.9)
    found = [verdict for verdict in verdicts(atlas) if verdict.holds.any()]
    count = {verdict.name: verdict.holds.sum() for verdict in verdicts(atlas)}
    figure.suptitle(
        f"Pointing in the {len(atlas.codes)} failure conditions: still exact in {count['rigid']} "
        f"without springs, in {count['rigid'] + count['springs']} with them"
    )
    left, right = figure.subplots(1, 2, width_ratios=[1.4, 1])
    _map(left, found)
    _by_failures(right, atlas, found)
    legend = [
        Patch(fc=verdict.color, ec=BLACK, lw=0.4, label=f"{verdict.holds.sum()} {verdict.label}")
        for verdict in found
    ]
    figure.legend(handles=legend, loc="outside lower center", ncols=2)
    return figure


def _map(axes: Axes, found: list[Verdict]) -> None:
    """Struts 1 to 3 down the rows, 4 to 6 along the columns: the order of the atlas itself."""
    number = np.argmax([verdict.holds for verdict in found], axis=0)
    axes.pcolormesh(
        number.reshape(27, 27),
        cmap=ListedColormap([verdict.color for verdict in found]),
        vmin=-0.5,
        vmax=len(found) - 0.5,
        edgecolors="white",
        linewidth=0.4,
    )
    axes.set(aspect="equal", xlim=(-3.2, 27), ylim=(27, -3.2))
    axes.set_title("S sound, L locked, F free")
    axes.axis("off")
    for place in (9, 18):
        axes.plot([place, place], [-3.2, 27], color=BLACK, lw=1)
        axes.plot([-3.2, 27], [place, place], color=BLACK, lw=1)
    for level in range(3):
        span, out = 3 ** (2 - level), -3 + level
        for k in range(3 ** (level + 1)):
            middle, letter = (k + 0.5) * span, "SLF"[k % 3]
            axes.text(middle, out + 0.5, letter, ha="center", va="center")
            axes.text(out + 0.5, middle, letter, ha="center", va="center")
        axes.text(27.3, out + 0.5, f"strut {4 + level}", va="center")
        axes.text(out + 0.5, 27.3, f"strut {1 + level}", va="top", ha="center", rotation=90)


def _by_failures(axes: Axes, atlas: FailureAtlas, found: list[Verdict]) -> None:
    """How many failures until the task is lost."""
    failures = (atlas.codes != 0).sum(axis=1)
    struts = atlas.codes.shape[1]
    conditions = np.bincount(failures, minlength=struts + 1)
    left = np.zeros(struts + 1)
    for verdict in found:
        ink = "white" if verdict.color in (BLACK, BLUE) else BLACK
        count = np.bincount(failures[verdict.holds], minlength=struts + 1)
        share = 100 * count / conditions
        axes.barh(range(struts + 1), share, left=left, color=verdict.color, ec="white", lw=0.4)
        for k in np.flatnonzero(share > 4).tolist():
            middle = float(left[k] + share[k] / 2)
            axes.text(middle, k, str(count[k]), ha="center", va="center", color=ink)
        left += share
    axes.set(
        ylim=(struts + 0.6, -0.6),
        xlim=(0, 100),
        xlabel="of the conditions with so many failures, %",
        ylabel="struts failed, locked or free",
    )
    axes.grid(False)
