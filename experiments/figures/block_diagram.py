"""Figure 3 of the paper, its blocks labelled with the numbers of the loop that runs."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from experiments.figures.runs import OpenLoop, Portrait
from experiments.study.palette import BLACK, ORANGE, SKY
from experiments.study.plotting import PAGE_IN, new_figure
from sim import Array

_HEIGHT_IN = 3.85


def labels(portrait: Portrait) -> dict[str, str]:
    """What each block says, by its name."""
    bench, gain = portrait.bench, portrait.model.actuator_gainprm[0, 0]
    amplifier = bench.amplifier(newton_per_m=float(gain))
    step_m = amplifier.displacements(np.array(100 / 2 ** (amplifier.bits - 1)))
    noise_urad = 1e6 * bench.detector_noise_m / bench.focal_length_m
    low_hz, high_hz = portrait.modes_hz[[0, -1]]
    return {
        "command": f"command spiral\n{bench.spiral_radius_urad:g} µrad in {bench.duration_s:g} s,\n"
        f"{bench.duration_s / bench.spiral_period_s:g} turns",
        "alpha": _compensator(portrait.loops[0]),
        "beta": _compensator(portrait.loops[1]),
        "secondary": "desired SDOF displacements\n"
        r"$[\delta\gamma_d,\,\delta t_{xd},\,\delta t_{yd},\,\delta t_{zd}]^T$, zero in Table I",
        "mapping": "velocity mapping\n(28), (30)\n"
        r"$\delta\alpha_d$, $\delta\beta_d$ exactly,"
        "\nthe rest least in\n"
        r"$W_1\,\delta l$ and"
        "\n"
        r"$W_2\,(\delta x_s - \delta x_{sd})$",
        "drive": f"{amplifier.bits}-bit DAC, one step\n"
        f"{1e9 * step_m:.1f} nm, held {1e3 * bench.control_period_s:g} ms\n"
        f"amplifier ±{amplifier.limit_a:.2f} A\n"
        f"coil {amplifier.newton_per_a:g} N/A\n"
        f"against {1e-3 * amplifier.newton_per_m:g} N/mm",
        "hexapod": f"hexapod\nsix modes,\n{low_hz:.1f} to\n{high_hz:.1f} Hz",
        "detector": f"telescope, {bench.focal_length_m:g} m, and PSD\n"
        f"±{1e3 * bench.detector_half_width_m:g} mm; noise {noise_urad:g} µrad RMS\n"
        f"each {1e3 * bench.control_period_s:g} ms",
        "estimator": "estimator\nforward kinematics of\nthe displacements sent",
    }


def polynomial(coefficients: Array) -> str:
    """A polynomial in s as mathtext, highest power first."""
    terms = []
    for power, value in zip(range(len(coefficients) - 1, -1, -1), coefficients, strict=True):
        if value == 0:
            continue
        number = f"{value:.4g}"
        if "e" in number:
            mantissa, exponent = number.split("e")
            number = rf"{mantissa}\cdot 10^{{{int(exponent)}}}"
        variable = {0: "", 1: "s"}.get(power, f"s^{power}")
        terms.append(variable if number == "1" and variable else f"{number}\\,{variable}")
    return " + ".join(terms).replace("+ -", "- ")


def figure_3(portrait: Portrait) -> Figure:
    """Command, two compensators, mapping, drives, hexapod, detector, and the estimator aside."""
    figure = new_figure(PAGE_IN, _HEIGHT_IN)
    axes = figure.add_subplot(xlim=(0, PAGE_IN), ylim=(0, _HEIGHT_IN), aspect="equal")
    axes.axis("off")
    text = labels(portrait)
    for name, (left, bottom, width, height, color) in _BLOCKS.items():
        _block(axes, (left, bottom, width, height), text[name], color)
    for corners, label, offset in _SIGNALS:
        _signal(axes, corners, label, offset)
    for x, y in _SUMS:
        axes.add_patch(Circle((x, y), 0.09, fc="white", ec=BLACK, lw=0.8, zorder=3))
        axes.text(x - 0.15, y - 0.11, "+", ha="center", va="center")
        axes.text(x + 0.1, y - 0.17, "$-$", ha="center", va="center")
    return figure


def _compensator(one: OpenLoop) -> str:
    loop, symbol = one.loop, f"\\{one.angle}"
    fraction = rf"\dfrac{{{polynomial(loop.numerator)}}}{{{polynomial(loop.denominator)}}}"
    return (
        f"$G_{symbol}(s) = {fraction}$\n\n"
        f"by Tustin's rule, {1e3 * loop.period_s:g} ms\n"
        f"crossover {loop.crossover_hz:.2f} Hz, margins\n"
        f"{loop.gain_margin_db:.1f} dB and {loop.phase_margin_deg:.1f}°"
    )


_BLOCKS = {
    "command": (0.01, 1.00, 0.93, 2.00, "white"),
    "alpha": (1.48, 2.05, 1.90, 0.95, SKY),
    "beta": (1.48, 1.00, 1.90, 0.95, SKY),
    "secondary": (3.10, 3.38, 2.40, 0.42, "white"),
    "mapping": (3.76, 1.00, 1.08, 2.00, ORANGE),
    "drive": (5.10, 1.30, 1.14, 0.95, "white"),
    "hexapod": (6.40, 1.30, 0.74, 0.95, "white"),
    "detector": (5.10, 0.12, 2.04, 0.60, "white"),
    "estimator": (5.10, 2.60, 1.32, 0.55, "white"),
}
"""Left, bottom, width and height [in], and colour."""

_ALPHA_IN, _BETA_IN = 2.525, 1.475
"""Heights of the two channels."""
_SUMS = ((1.30, _ALPHA_IN), (1.14, _BETA_IN))
_SIGNALS = (
    (((0.94, _ALPHA_IN), (1.21, _ALPHA_IN)), r"$\alpha_d$", (1.00, 2.59)),
    (((0.94, _BETA_IN), (1.05, _BETA_IN)), r"$\beta_d$", (0.97, 1.57)),
    (((1.39, _ALPHA_IN), (1.48, _ALPHA_IN)), "", (0, 0)),
    (((1.23, _BETA_IN), (1.48, _BETA_IN)), "", (0, 0)),
    (((3.38, _ALPHA_IN), (3.76, _ALPHA_IN)), r"$\delta\alpha_d$", (3.42, 2.59)),
    (((3.38, _BETA_IN), (3.76, _BETA_IN)), r"$\delta\beta_d$", (3.42, 1.54)),
    (((4.30, 3.38), (4.30, 3.00)), "", (0, 0)),
    (((4.84, 1.775), (5.10, 1.775)), r"$\delta l$", (4.89, 1.84)),
    (((6.24, 1.775), (6.40, 1.775)), "", (0, 0)),
    (((6.77, 1.30), (6.77, 0.72)), "payload pose", (6.06, 0.97)),
    (((5.10, 0.28), (1.30, 0.28), (1.30, _ALPHA_IN - 0.09)), r"$\alpha$", (4.95, 0.33)),
    (((5.10, 0.54), (1.14, 0.54), (1.14, _BETA_IN - 0.09)), r"$\beta$", (4.95, 0.59)),
    (((5.67, 2.25), (5.67, 2.60)), "", (0, 0)),
    (((5.10, 2.78), (4.84, 2.78)), r"$J$", (4.94, 2.84)),
    (
        ((6.42, 2.875), (7.14, 2.875)),
        "$\\alpha_e, \\beta_e, \\gamma_e,$\n$t_{xe}, t_{ye}, t_{ze}$",
        (6.48, 2.95),
    ),
)
"""Corners of each line, its label, and where that begins [in]."""


def _block(axes: Axes, box: tuple[float, float, float, float], text: str, color: str) -> None:
    """A tinted box; what stands before an empty line, a formula, is given the upper half."""
    left, bottom, width, height = box
    axes.add_patch(Rectangle((left, bottom), width, height, fc=color, alpha=0.25, lw=0))
    axes.add_patch(Rectangle((left, bottom), width, height, fill=False, lw=0.8))
    parts = text.split("\n\n")
    for part, place in zip(parts, (0.5,) if len(parts) == 1 else (0.76, 0.29), strict=True):
        y = bottom + place * height
        axes.text(left + width / 2, y, part, ha="center", va="center", linespacing=1.4)


def _signal(
    axes: Axes, corners: tuple[tuple[float, float], ...], label: str, place: tuple[float, float]
) -> None:
    """A line with an arrow at its end."""
    axes.plot(*zip(*corners, strict=True), color=BLACK, lw=0.8)
    arrow = {"arrowstyle": "-|>", "color": BLACK, "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", corners[-1], corners[-2], arrowprops=arrow)
    if label:
        axes.text(*place, label)
