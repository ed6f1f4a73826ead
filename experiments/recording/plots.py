"""Plots of a run of the hexapod that several figures share."""

import numpy as np
from matplotlib.axes import Axes

from experiments.rig.run import Run
from experiments.study.plotting import DESIRED, MEASURED, START


def spiral(axes: Axes, run: Run, title: str, *, legend: bool = True) -> None:
    """Detector reading over desired pointing, beta against alpha."""
    desired, measured = 1e6 * run.desired, 1e6 * run.measured
    room = 1.2 if legend else 1.05
    limit_urad = 5 * np.ceil(room / 5 * abs(np.stack([desired, measured])).max())
    axes.plot(*measured.T, color=MEASURED, lw=0.6, label="detector")
    axes.plot(*desired.T, color=DESIRED, lw=0.6, ls="--", label="desired")
    axes.plot(*desired[0], "o", color=START, ms=4, label="start")
    axes.set(
        title=title,
        xlabel="$\\alpha$, µrad",
        ylabel="$\\beta$, µrad",
        xlim=(-limit_urad, limit_urad),
        ylim=(-limit_urad, limit_urad),
        aspect="equal",
    )
    if legend:
        axes.legend(loc="upper center", ncols=3, handlelength=1.2, columnspacing=0.8)
