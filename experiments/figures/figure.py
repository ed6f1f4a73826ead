"""The study's figures; the Bode plot and the map of failure conditions are drawn here."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from experiments.figures.block_diagram import figure_3
from experiments.figures.geometry import figure_2
from experiments.figures.machine import figure_machine
from experiments.figures.runs import OpenLoop, Portrait
from experiments.rig.conditions import LETTERS
from experiments.rig.hexapod.fault_tolerance import pointing_verdicts
from experiments.rig.verdicts import Verdict
from experiments.study.palette import BLACK, BLUE, ORANGE, VERMILION
from experiments.study.plotting import PAGE_IN, new_figure
from experiments.study.results import Picture
from prioritized import FailureAtlas


def pictures(portrait: Portrait) -> list[Picture]:
    """All five figures and their captions."""
    return [
        Picture(
            "machine",
            "The machine, drawn from its file: its axes, the major motions and the secondary ones.",
            "A payload with telescope and detector on six numbered struts above a round base. "
            "Rotations alpha and beta about x_b and y_b are major; gamma about z_b and the "
            "translations t_x, t_y, t_z are secondary.",
            partial(figure_machine, portrait.model),
        ),
        Picture(
            "figure2",
            "The paper's Fig. 2, drawn from the machine file: in 3D, top view and front view.",
            "Six struts, numbered, zigzag between three nodes on the base and three on the "
            "payload; both coordinate frames, laser, telescope and detector.",
            partial(figure_2, portrait.model),
            formats=("png", "pdf", "svg"),
        ),
        Picture(
            "figure3",
            "The paper's Fig. 3 with the numbers of the simulated loop.",
            "Block diagram: spiral, two compensators with transfer functions and margins, velocity "
            "mapping, drives, hexapod, and back through telescope and detector.",
            partial(figure_3, portrait),
        ),
        Picture(
            "bode",
            "Sampled open pointing loops, with gain and phase margins.",
            "Magnitude and phase of the alpha and beta loops over frequency; the suspension modes "
            "stand out at 39 Hz, below unity gain.",
            partial(figure_bode, portrait.loops),
        ),
        Picture(
            "atlas",
            "Every combination of sound, locked and free struts: can the hexapod still point?",
            "A map of 27 by 27 conditions; shares of the verdicts over the number of failures.",
            partial(figure_atlas, portrait.atlas),
        ),
    ]


def figure_bode(loops: tuple[OpenLoop, OpenLoop]) -> Figure:
    """Magnitude above phase, alpha beside beta: open loop, plant, compensator."""
    figure = new_figure(PAGE_IN, 4.4)
    figure.suptitle("Open pointing loops in discrete time, the plant with its zero-order hold")
    grid = figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=[1.2, 1])
    for (magnitude, phase), one in zip(grid.T, loops, strict=True):
        _curves(magnitude, phase, one)
        _margins(magnitude, phase, one)
        magnitude.set_title(f"$\\{one.angle}$ loop, sampled every {1e3 * one.loop.period_s:g} ms")
        phase.set(xlabel="frequency, Hz", xlim=one.frequency_hz[[0, -1]])
    grid[0, 0].set(ylabel="magnitude, dB", ylim=(-85, 55))
    grid[1, 0].set(ylabel="phase, deg", ylim=(-560, 20), yticks=range(-540, 1, 90))
    grid[0, 1].legend(loc="upper right")
    return figure


def _curves(magnitude: Axes, phase: Axes, one: OpenLoop) -> None:
    for response, style in (
        (one.open_loop, {"color": BLUE, "lw": 1.5, "label": "open loop"}),
        (one.open_loop / one.plant, {"color": ORANGE, "ls": "--", "label": "compensator"}),
        (one.plant, {"color": BLACK, "ls": ":", "label": "plant"}),
    ):
        magnitude.semilogx(one.frequency_hz, 20 * np.log10(abs(response)), **style)
        phase.semilogx(one.frequency_hz, np.rad2deg(np.unwrap(np.angle(response))), **style)
    magnitude.axhline(0, color=BLACK, lw=0.6)
    phase.axhline(-180, color=BLACK, lw=0.6)


def _margins(magnitude: Axes, phase: Axes, one: OpenLoop) -> None:
    """Arrows from the critical point to the curve, as long as the margins."""
    loop = one.loop
    hz, deg, db = loop.crossover_hz, loop.phase_margin_deg, loop.gain_margin_db
    said = f"phase margin {deg:.1f}°\nat {hz:.2f} Hz"
    _margin(phase, magnitude, hz, (-180, -180 + deg), said, ls="--")
    if np.isfinite(db):  # else the phase never passes -180 degrees
        hz = loop.phase_crossover_hz
        said = f"gain margin {db:.1f} dB\nat {hz:.1f} Hz"
        _margin(magnitude, phase, hz, (-db, 0), said, ls=":")


def _margin(
    axes: Axes, beside: Axes, hz: float, span: tuple[float, float], said: str, *, ls: str
) -> None:
    """An arrow over the span, named at its first end; a line in both panels."""
    for panel in (axes, beside):
        panel.axvline(hz, color=VERMILION, lw=0.6, ls=ls)
    arrow = {"arrowstyle": "<->", "color": VERMILION, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (hz, span[0]), (hz, span[1]), arrowprops=arrow)
    place: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "va": "top"}
    paper = {"fc": "white", "lw": 0, "pad": 1}
    axes.annotate(said, (hz, span[0]), (-4, -6), **place, bbox=paper)


def figure_atlas(atlas: FailureAtlas) -> Figure:
    """Map of all 3^6 conditions, and the share of each verdict over the number of failures."""
    figure = new_figure(PAGE_IN, 4.9)
    every = pointing_verdicts(atlas)
    found = [verdict for verdict in every if verdict.holds.any()]
    count = {verdict.name: verdict.holds.sum() for verdict in every}
    figure.suptitle(
        f"Pointing in the {len(atlas.codes)} failure conditions: still exact in {count['rigid']} "
        f"without springs, in {count['rigid'] + count['springs']} with them"
    )
    left, right = figure.subplots(1, 2, width_ratios=[1.4, 1])
    _map(left, found)
    _by_failures(right, found)
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
    axes.set_title("Each condition: S sound, L locked, F free")
    axes.axis("off")
    for place in (9, 18):
        axes.plot([place, place], [-3.2, 27], color=BLACK, lw=1)
        axes.plot([-3.2, 27], [place, place], color=BLACK, lw=1)
    for level in range(3):
        span, out = 3 ** (2 - level), -3 + level
        for k in range(3 ** (level + 1)):
            middle, letter = (k + 0.5) * span, LETTERS[k % 3]
            axes.text(middle, out + 0.5, letter, ha="center", va="center")
            axes.text(out + 0.5, middle, letter, ha="center", va="center")
        axes.text(27.3, out + 0.5, f"strut {4 + level}", va="center")
        axes.text(out + 0.5, 27.3, f"strut {1 + level}", va="top", ha="center", rotation=90)


def _by_failures(axes: Axes, found: list[Verdict]) -> None:
    """How many failures until the task is lost."""
    conditions = np.sum([verdict.by_failures for verdict in found], axis=0)
    left, rows = np.zeros(len(conditions)), range(len(conditions))
    for verdict in found:
        ink = "white" if verdict.color in (BLACK, BLUE) else BLACK
        count = verdict.by_failures
        share = 100 * count / conditions
        axes.barh(rows, share, left=left, color=verdict.color, ec="white", lw=0.4)
        for k in np.flatnonzero(share > 4).tolist():
            middle = float(left[k] + share[k] / 2)
            axes.text(middle, k, str(count[k]), ha="center", va="center", color=ink)
        left += share
    axes.set(
        ylim=(len(rows) - 0.4, -0.6),
        xlim=(0, 100),
        xlabel="share of the conditions with that many failures, %",
        ylabel="number of failed struts, locked or free",
    )
    axes.grid(False)
