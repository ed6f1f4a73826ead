"""Study `figures`: margins of the pointing loops, and pointing in each failure condition."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any, NamedTuple

import control
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from fjh.rig.classification import Classification
from fjh.rig.conditions import CODE_LETTERS
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import ANGLES, Loop, design, nominal_plant, sampled
from fjh.rig.hexapod.fault_tolerance import elastic_system, pointing_classifications
from fjh.rig.hexapod.metrics import loop_measures, plant_constants
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.options import MachineFile
from fjh.study.input_checks import check_file
from fjh.study.option import OnProgress
from fjh.study.palette import BLACK, BLUE, ORANGE, VERMILION
from fjh.study.plotting import PAGE_IN, new_figure
from fjh.study.result import Picture, Result, TableView, origin
from prioritized import failure_atlas
from sim import Array, LinearPlant, load_model
from sim.mjcf import model_sha256


class OpenLoop(NamedTuple):
    """Frequency response of one pointing loop in discrete time, with its zero-order hold."""

    loop: Loop
    frequency_hz: Array  # (F,), from 0.1 Hz to four fifths of the Nyquist frequency
    plant: Array  # complex response of the pointing angle to its commanded value, (F,)
    open_loop: Array  # the plant's response times the compensator's, (F,)


def figures(*, model: MachineFile = None, on_progress: OnProgress) -> Result:
    """Compute margins of the control loops, and pointing in each failure condition.

    Designs both pointing loops for the machine: transfer functions, margins, a Bode plot. A map
    shows in which of the 3^6 conditions of healthy, locked and free struts pointing is possible.
    Takes 10 s.

    Writes figures.json, its tables as figures.md and Parquet, and bode and atlas, each as .png and
    .pdf.

    Example: fjh paper figures --model mine.xml --out /tmp/mine
    """
    machine, bench = load_model(model and check_file(model)), TestbedConfig()
    geometry, (plant, pointing) = hexapod(machine), nominal_plant(machine)
    loops = design(plant, pointing, bench)
    poles = np.linalg.eigvals(plant.A)
    classes = pointing_classifications(failure_atlas(elastic_system(machine), MAJOR))
    margins = pd.DataFrame(map(loop_measures, loops)).drop(columns="sentence")
    margins.insert(0, "angle", ANGLES)
    settings = origin(0) | {
        "model_sha256": model_sha256(model),
        "bench": asdict(bench) | plant_constants(machine),
        "modes_hz": np.sort(abs(poles[poles.imag > 0])) / (2 * np.pi),
        "strut_length_m": geometry.nominal_length_m,
    }
    counts = class_counts(classes)
    opened = {
        angle: open_loop(plant, pointing, loop, row)
        for row, (angle, loop) in enumerate(zip(ANGLES, loops, strict=True))
    }
    return Result(
        settings=settings,
        tables={"loops": margins, "verdicts": counts},
        views=printed_tables(margins, counts),
        pictures=pictures(opened, classes),
    )


def open_loop(plant: LinearPlant, pointing: Array, loop: Loop, row: int) -> OpenLoop:
    """Return the response of the loop of alpha (row 0) or beta (row 1)."""
    frequency_hz = np.geomspace(0.1, 0.4 / loop.period_s, 1500)
    P, C = (
        control.frequency_response(system, 2 * np.pi * frequency_hz).complex
        for system in (sampled(plant, pointing, loop.period_s)[row, row], loop.discrete)
    )
    return OpenLoop(loop, frequency_hz, P, P * C)


def class_counts(classes: Sequence[Classification]) -> pd.DataFrame:
    """Return the number of conditions in each class, total and by number of failed struts."""
    rows = [
        {"verdict": entry.name, "pointing": entry.label, "conditions": int(entry.holds.sum())}
        | {f"failures_{k}": int(count) for k, count in enumerate(entry.by_failures)}
        for entry in classes
    ]
    return pd.DataFrame(rows)


def printed_tables(margins: pd.DataFrame, counts: pd.DataFrame) -> list[TableView]:
    """Return the printed tables."""
    table = counts.rename(columns=lambda name: name.removeprefix("failures_"))
    return [
        TableView(
            "Pointing loops",
            margins,
            "angle crossover_hz:.2f gain_margin_db:.1f phase_crossover_hz:.1f phase_margin_deg:.1f",
        ),
        TableView(
            "Pointing by number of failed struts",
            table,
            "pointing 0 1 2 3 4 5 6 conditions",
            f"Numbers of conditions, {counts.conditions.sum()} in all; a failed strut is locked "
            "or free.",
        ),
    ]


def pictures(loops: Mapping[str, OpenLoop], classes: Sequence[Classification]) -> list[Picture]:
    """Return both figures with their captions."""
    return [
        Picture(
            "bode",
            "Sampled open pointing loops, with gain and phase margins.",
            "Magnitude and phase of the alpha and beta loops over frequency; the suspension modes "
            "stand out at 39 Hz, below unity gain.",
            partial(figure_bode, loops),
        ),
        Picture(
            "atlas",
            "Pointing of the hexapod in every combination of healthy, locked and free struts.",
            "A map of 27 by 27 conditions; shares of the classes over the number of failures.",
            partial(figure_atlas, classes),
        ),
    ]


def figure_bode(loops: Mapping[str, OpenLoop]) -> Figure:
    """Plot magnitude and phase of the alpha and beta loops: open loop, plant, compensator."""
    figure = new_figure(PAGE_IN, 4.4)
    figure.suptitle("Open pointing loops in discrete time, the plant with its zero-order hold")
    grid = figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=[1.2, 1])
    for (magnitude, phase), (angle, data) in zip(grid.T, loops.items(), strict=True):
        for response, style in (
            (data.open_loop, {"color": BLUE, "lw": 1.5, "label": "open loop"}),
            (data.open_loop / data.plant, {"color": ORANGE, "ls": "--", "label": "compensator"}),
            (data.plant, {"color": BLACK, "ls": ":", "label": "plant"}),
        ):
            magnitude.semilogx(data.frequency_hz, 20 * np.log10(abs(response)), **style)
            phase.semilogx(data.frequency_hz, np.rad2deg(np.unwrap(np.angle(response))), **style)
        magnitude.axhline(0, color=BLACK, lw=0.6)
        phase.axhline(-180, color=BLACK, lw=0.6)
        loop = data.loop
        hz, deg, db = loop.crossover_hz, loop.phase_margin_deg, loop.gain_margin_db
        text = f"phase margin {deg:.1f}°\nat {hz:.2f} Hz"
        _margin(phase, magnitude, hz, (-180, -180 + deg), text, ls="--")
        if np.isfinite(db):  # infinite if the phase never crosses -180 degrees
            hz = loop.phase_crossover_hz
            text = f"gain margin {db:.1f} dB\nat {hz:.1f} Hz"
            _margin(magnitude, phase, hz, (-db, 0), text, ls=":")
        magnitude.set_title(f"$\\{angle}$ loop, sampled every {1e3 * loop.period_s:g} ms")
        phase.set(xlabel="frequency, Hz", xlim=data.frequency_hz[[0, -1]])
    grid[0, 0].set(ylabel="magnitude, dB", ylim=(-85, 55))
    grid[1, 0].set(ylabel="phase, deg", ylim=(-560, 20), yticks=range(-540, 1, 90))
    grid[0, 1].legend(loc="upper right")
    return figure


def _margin(
    axes: Axes, other_axes: Axes, hz: float, span: tuple[float, float], text: str, *, ls: str
) -> None:
    """Draw an arrow over the span with a label at its first end, and a line in both panels."""
    for panel in (axes, other_axes):
        panel.axvline(hz, color=VERMILION, lw=0.6, ls=ls)
    arrow = {"arrowstyle": "<->", "color": VERMILION, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (hz, span[0]), (hz, span[1]), arrowprops=arrow)
    place: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "va": "top"}
    paper = {"fc": "white", "lw": 0, "pad": 1}
    axes.annotate(text, (hz, span[0]), (-4, -6), **place, bbox=paper)


def figure_atlas(classes: Sequence[Classification]) -> Figure:
    """Plot the class of all 3^6 conditions, and fractions of classes by number of failures."""
    figure, present = new_figure(PAGE_IN, 4.9), [entry for entry in classes if entry.holds.any()]
    count = {entry.name: entry.holds.sum() for entry in classes}
    figure.suptitle(
        f"Pointing in the {len(classes[0].holds)} failure conditions: still exact in "
        f"{count['rigid']} without springs, in {count['rigid'] + count['springs']} with them"
    )
    left, right = figure.subplots(1, 2, width_ratios=[1.4, 1])
    _map(left, present)
    _by_failures(right, present)
    legend = [
        Patch(fc=entry.color, ec=BLACK, lw=0.4, label=f"{entry.holds.sum()} {entry.label}")
        for entry in present
    ]
    figure.legend(handles=legend, loc="outside lower center", ncols=2)
    return figure


def _map(axes: Axes, classes: Sequence[Classification]) -> None:
    """Plot a map of conditions: struts 1 to 3 down the rows, 4 to 6 along the columns."""
    number = np.argmax([entry.holds for entry in classes], axis=0)  # noqa: TID251 - truth values
    colors = ListedColormap([entry.color for entry in classes])
    style: dict[str, Any] = {"cmap": colors, "vmin": -0.5, "vmax": len(classes) - 0.5}
    axes.pcolormesh(number.reshape(27, 27), **style, edgecolors="white", linewidth=0.4)
    axes.set(aspect="equal", xlim=(-3.2, 27), ylim=(27, -3.2))
    axes.set_title("Each condition: S healthy, L locked, F free")
    axes.axis("off")
    for place in (9, 18):
        axes.plot([place, place], [-3.2, 27], color=BLACK, lw=1)
        axes.plot([-3.2, 27], [place, place], color=BLACK, lw=1)
    for level in range(3):
        span, out = 3 ** (2 - level), -3 + level
        for k in range(3 ** (level + 1)):
            middle, letter = (k + 0.5) * span, CODE_LETTERS[k % 3]
            axes.text(middle, out + 0.5, letter, ha="center", va="center")
            axes.text(out + 0.5, middle, letter, ha="center", va="center")
        axes.text(27.3, out + 0.5, f"strut {4 + level}", va="center")
        axes.text(out + 0.5, 27.3, f"strut {1 + level}", va="top", ha="center", rotation=90)


def _by_failures(axes: Axes, classes: Sequence[Classification]) -> None:
    conditions = np.sum([entry.by_failures for entry in classes], axis=0)
    left, rows = np.zeros(len(conditions)), range(len(conditions))
    for entry in classes:
        ink = "white" if entry.color in (BLACK, BLUE) else BLACK
        count, share = entry.by_failures, 100 * entry.by_failures / conditions
        axes.barh(rows, share, left=left, color=entry.color, ec="white", lw=0.4)
        for k in np.flatnonzero(share > 4).tolist():
            middle = float(left[k] + share[k] / 2)
            axes.text(middle, k, str(count[k]), ha="center", va="center", color=ink)
        left += share
    axes.set(xlim=(0, 100), xlabel="share of the conditions with that many failures, %")
    axes.set(ylim=(len(rows) - 0.4, -0.6), ylabel="number of failed struts, locked or free")
    axes.grid(False)
