"""The study `figures`: margins of the control loops, and pointing in each failure condition."""

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
    """Frequency response of one pointing loop as it runs: sampled, behind the zero-order hold."""

    loop: Loop
    frequency_hz: Array  # (F,), from 0.1 Hz to four fifths of the Nyquist frequency
    plant: Array  # complex response of the pointing angle to its commanded value, (F,)
    open_loop: Array  # the same behind the compensator


def figures(*, model: MachineFile = None, on_progress: OnProgress) -> Result:
    """Compute margins of the control loops, and pointing in each failure condition.

    Designs both pointing loops for the machine: transfer functions, margins, a Bode plot. Of the
    3^6 conditions of sound, locked and free struts a map shows in which pointing is possible. 10 s.

    Writes figures.json, its tables as figures.md and Parquet, and bode and atlas, each as .png and
    .pdf.

    Example: fjh paper figures --model mine.xml --out /tmp/mine
    """
    machine, bench = load_model(model and check_file(model)), TestbedConfig()
    geometry, (plant, pointing) = hexapod(machine), nominal_plant(machine)
    loops = design(plant, pointing, bench)
    poles = np.linalg.eigvals(plant.A)
    found = pointing_classifications(failure_atlas(elastic_system(machine), MAJOR))
    margins = pd.DataFrame(map(loop_measures, loops)).drop(columns="sentence")
    margins.insert(0, "angle", ANGLES)
    settings = origin(0) | {
        "model_sha256": model_sha256(model),
        "bench": asdict(bench) | plant_constants(machine),
        "modes_hz": np.sort(abs(poles[poles.imag > 0])) / (2 * np.pi),
        "strut_length_m": geometry.nominal_length_m,
    }
    verdicts = counted(found)
    opened = {
        angle: open_loop(plant, pointing, loop, row)
        for row, (angle, loop) in enumerate(zip(ANGLES, loops, strict=True))
    }
    return Result(
        settings=settings,
        tables={"loops": margins, "verdicts": verdicts},
        views=shown(margins, verdicts),
        pictures=pictures(opened, found),
    )


def open_loop(plant: LinearPlant, pointing: Array, loop: Loop, row: int) -> OpenLoop:
    """The response of the loop of one pointing angle, alpha in row 0 or beta in row 1."""
    frequency_hz = np.geomspace(0.1, 0.4 / loop.period_s, 1500)
    P, C = (
        control.frequency_response(system, 2 * np.pi * frequency_hz).complex
        for system in (sampled(plant, pointing, loop.period_s)[row, row], loop.discrete)
    )
    return OpenLoop(loop, frequency_hz, P, P * C)


def counted(found: Sequence[Classification]) -> pd.DataFrame:
    """In how many conditions each verdict holds, in all and by the number of failed struts."""
    rows = [
        {"verdict": verdict.name, "pointing": verdict.label, "conditions": int(verdict.holds.sum())}
        | {f"failures_{k}": int(count) for k, count in enumerate(verdict.by_failures)}
        for verdict in found
    ]
    return pd.DataFrame(rows)


def shown(margins: pd.DataFrame, verdicts: pd.DataFrame) -> list[TableView]:
    """The printed tables."""
    counts = verdicts.rename(columns=lambda name: name.removeprefix("failures_"))
    return [
        TableView(
            "Pointing loops",
            margins,
            "angle crossover_hz:.2f gain_margin_db:.1f phase_crossover_hz:.1f phase_margin_deg:.1f",
        ),
        TableView(
            "Pointing by number of failed struts",
            counts,
            "pointing 0 1 2 3 4 5 6 conditions",
            f"Numbers of conditions, {verdicts.conditions.sum()} in all; a failed strut is locked "
            "or free.",
        ),
    ]


def pictures(loops: Mapping[str, OpenLoop], found: Sequence[Classification]) -> list[Picture]:
    """Both figures and their captions."""
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
            "Every combination of sound, locked and free struts: can the hexapod still point?",
            "A map of 27 by 27 conditions; shares of the verdicts over the number of failures.",
            partial(figure_atlas, found),
        ),
    ]


def figure_bode(loops: Mapping[str, OpenLoop]) -> Figure:
    """Magnitude above phase, alpha beside beta: open loop, plant, compensator."""
    figure = new_figure(PAGE_IN, 4.4)
    figure.suptitle("Open pointing loops in discrete time, the plant with its zero-order hold")
    grid = figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=[1.2, 1])
    for (magnitude, phase), (angle, one) in zip(grid.T, loops.items(), strict=True):
        for response, style in (
            (one.open_loop, {"color": BLUE, "lw": 1.5, "label": "open loop"}),
            (one.open_loop / one.plant, {"color": ORANGE, "ls": "--", "label": "compensator"}),
            (one.plant, {"color": BLACK, "ls": ":", "label": "plant"}),
        ):
            magnitude.semilogx(one.frequency_hz, 20 * np.log10(abs(response)), **style)
            phase.semilogx(one.frequency_hz, np.rad2deg(np.unwrap(np.angle(response))), **style)
        magnitude.axhline(0, color=BLACK, lw=0.6)
        phase.axhline(-180, color=BLACK, lw=0.6)
        loop = one.loop
        hz, deg, db = loop.crossover_hz, loop.phase_margin_deg, loop.gain_margin_db
        said = f"phase margin {deg:.1f}°\nat {hz:.2f} Hz"
        _margin(phase, magnitude, hz, (-180, -180 + deg), said, ls="--")
        if np.isfinite(db):  # else the phase never passes -180 degrees
            hz = loop.phase_crossover_hz
            said = f"gain margin {db:.1f} dB\nat {hz:.1f} Hz"
            _margin(magnitude, phase, hz, (-db, 0), said, ls=":")
        magnitude.set_title(f"$\\{angle}$ loop, sampled every {1e3 * loop.period_s:g} ms")
        phase.set(xlabel="frequency, Hz", xlim=one.frequency_hz[[0, -1]])
    grid[0, 0].set(ylabel="magnitude, dB", ylim=(-85, 55))
    grid[1, 0].set(ylabel="phase, deg", ylim=(-560, 20), yticks=range(-540, 1, 90))
    grid[0, 1].legend(loc="upper right")
    return figure


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


def figure_atlas(every: Sequence[Classification]) -> Figure:
    """Map of all 3^6 conditions, and the share of each verdict over the number of failures."""
    figure, found = new_figure(PAGE_IN, 4.9), [each for each in every if each.holds.any()]
    count = {verdict.name: verdict.holds.sum() for verdict in every}
    figure.suptitle(
        f"Pointing in the {len(every[0].holds)} failure conditions: still exact in "
        f"{count['rigid']} without springs, in {count['rigid'] + count['springs']} with them"
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


def _map(axes: Axes, found: Sequence[Classification]) -> None:
    """Struts 1 to 3 down the rows, 4 to 6 along the columns: the order of the atlas itself."""
    number = np.argmax([verdict.holds for verdict in found], axis=0)  # noqa: TID251 - truth values
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
            middle, letter = (k + 0.5) * span, CODE_LETTERS[k % 3]
            axes.text(middle, out + 0.5, letter, ha="center", va="center")
            axes.text(out + 0.5, middle, letter, ha="center", va="center")
        axes.text(27.3, out + 0.5, f"strut {4 + level}", va="center")
        axes.text(out + 0.5, 27.3, f"strut {1 + level}", va="top", ha="center", rotation=90)


def _by_failures(axes: Axes, found: Sequence[Classification]) -> None:
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
