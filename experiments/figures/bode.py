"""Bode plot of both pointing loops, with the margins that were measured on them."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.figures.study import OpenLoop
from experiments.output.palette import BLACK, BLUE, ORANGE, VERMILION
from experiments.output.plotting import PAGE_IN, new_figure
from sim import Array

_MARGIN = {"arrowstyle": "<->", "color": VERMILION, "shrinkA": 0, "shrinkB": 0}


def figure_bode(loops: tuple[OpenLoop, OpenLoop]) -> Figure:
    """Magnitude above phase, alpha beside beta: open loop, plant, compensator."""
    figure = new_figure(PAGE_IN, 4.4)
    figure.suptitle("Open pointing loops as they run: sampled, plant behind the zero-order hold")
    grid = figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=[1.2, 1])
    for (magnitude, phase), one in zip(grid.T, loops, strict=True):
        _curves(magnitude, phase, one)
        _margins(magnitude, phase, one)
        magnitude.set_title(f"$\\{one.angle}$ loop, {1e3 * one.loop.period_s:g} ms")
        phase.set(xlabel="frequency, Hz", xlim=one.frequency_hz[[0, -1]])
    grid[0, 0].set(ylabel="magnitude, dB", ylim=(-85, 55))
    grid[1, 0].set(ylabel="phase, deg", ylim=(-560, 20), yticks=range(-540, 1, 90))
    grid[0, 1].legend(loc="upper right")
    return figure


def decibels(response: Array) -> Array:
    """Magnitude of a complex response."""
    return 20 * np.log10(abs(response))


def phase_deg(response: Array) -> Array:
    """Phase of a complex response over frequency, without jumps."""
    return np.rad2deg(np.unwrap(np.angle(response)))


def _curves(magnitude: Axes, phase: Axes, one: OpenLoop) -> None:
    compensator = one.open_loop / one.plant
    for response, style in (
        (one.open_loop, {"color": BLUE, "lw": 1.5, "label": "open loop"}),
        (compensator, {"color": ORANGE, "ls": "--", "label": "compensator"}),
        (one.plant, {"color": BLACK, "ls": ":", "label": "plant"}),
    ):
        magnitude.semilogx(one.frequency_hz, decibels(response), **style)
        phase.semilogx(one.frequency_hz, phase_deg(response), **style)
    magnitude.axhline(0, color=BLACK, lw=0.6)
    phase.axhline(-180, color=BLACK, lw=0.6)


def _margins(magnitude: Axes, phase: Axes, one: OpenLoop) -> None:
    """Arrows from the critical point to the curve, as long as the margins."""
    loop = one.loop
    for axes in (magnitude, phase):
        axes.axvline(loop.crossover_hz, color=VERMILION, lw=0.6, ls="--")
    _arrow(phase, loop.crossover_hz, -180, -180 + loop.phase_margin_deg)
    phase.annotate(
        f"phase margin {loop.phase_margin_deg:.1f}°\nat {loop.crossover_hz:.2f} Hz",
        (loop.crossover_hz, -180),
        (-4, -4),
        textcoords="offset points",
        ha="right",
        va="top",
    )
    if np.isfinite(loop.gain_margin_db):  # else the phase never passes -180 degrees
        for axes in (magnitude, phase):
            axes.axvline(loop.phase_crossover_hz, color=VERMILION, lw=0.6, ls=":")
        _arrow(magnitude, loop.phase_crossover_hz, -loop.gain_margin_db, 0)
        magnitude.annotate(
            f"gain margin {loop.gain_margin_db:.1f} dB\nat {loop.phase_crossover_hz:.1f} Hz",
            (loop.phase_crossover_hz, -loop.gain_margin_db),
            (-4, -6),
            textcoords="offset points",
            ha="right",
            va="top",
            bbox={"fc": "white", "lw": 0, "pad": 1},
        )


def _arrow(axes: Axes, frequency_hz: float, low: float, high: float) -> None:
    axes.annotate("", (frequency_hz, low), (frequency_hz, high), arrowprops=_MARGIN)
