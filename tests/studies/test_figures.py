"""Figures: drawn from what runs, printable, and the same file every time."""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from experiments.app.cli import main
from experiments.figures import OpenLoop, counted, figure_atlas, figure_bode, open_loop
from experiments.table1 import figure_4, figure_5, figure_6, figure_result
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import ANGLES, design, nominal_plant
from fjh.rig.hexapod.fault_tolerance import elastic_system, pointing_verdicts
from fjh.rig.hexapod.metrics import loop_measures
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.study.palette import BLACK, BLUE, SKY, YELLOW
from fjh.study.plotting import COLUMN_IN, new_figure, save_figure
from prioritized import FailureAtlas, failure_atlas
from sim import HEXAPOD_MJCF
from tests.made import run_of
from tests.printed import faults

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"


@pytest.fixture(scope="module")
def loops(model) -> dict[str, OpenLoop]:
    plant, pointing = nominal_plant(model)
    designed = enumerate(zip(ANGLES, design(plant, pointing, TestbedConfig()), strict=True))
    return {angle: open_loop(plant, pointing, loop, row) for row, (angle, loop) in designed}


@pytest.fixture(scope="module")
def atlas(model) -> FailureAtlas:
    return failure_atlas(elastic_system(model), MAJOR)


# What every figure keeps.


def test_the_law_of_print_sees_small_text_strange_colours_widths_and_fonts(tmp_path):
    good = new_figure(COLUMN_IN, 2)
    good.add_subplot(title="good").plot([0, 1], color=BLUE)
    save_figure(good, tmp_path, "good")
    assert faults(tmp_path / "good.pdf") == []
    bad = Figure(figsize=(5, 2))
    axes = bad.add_subplot()
    axes.plot([0, 1], color="red")
    axes.text(0.5, 0.5, "small", fontsize=6)
    bad.savefig(tmp_path / "bad.pdf")
    seen = ", ".join(faults(tmp_path / "bad.pdf"))
    for fault in ("360 pt wide", "text of 6 pt", "colour (1.0, 0.0, 0.0)", "a date"):
        assert fault in seen


def test_a_figure_is_the_same_file_every_time(figures_folder, atlas, tmp_path):
    save_figure(figure_atlas(pointing_verdicts(atlas)), tmp_path, "atlas")
    for name in ("atlas.png", "atlas.pdf"):
        assert (tmp_path / name).read_bytes() == (figures_folder / name).read_bytes(), name


def test_a_machine_that_is_no_hexapod_is_refused(capsys, tmp_path):
    arm = str(HEXAPOD_MJCF.with_name("arm.xml"))
    assert main(["figures", "--model", arm, "--out", str(tmp_path / "out")]) == 2
    assert "a hexapod has six actuators" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# Fig. 2, a drawing that is kept.

SVG = "{http://www.w3.org/2000/svg}"


def test_the_kept_drawing_is_of_the_machine(model):
    """All twelve ends of struts in both views, up to one scale and one shift for each view."""
    groups = ET.parse(PICTURES / "figure2.svg").iter(f"{SVG}g")
    lines = {each.get("id"): each for each in groups if "-strut" in str(each.get("id"))}
    machine, scales = hexapod(model), []
    for view, plane in (("top", [0, 1]), ("front", [0, 2])):
        drawn = [next(lines[f"{view}-strut{k}"].iter(f"{SVG}path")) for k in range(1, 7)]
        ends = [re.findall(r"[ML] (\S+) (\S+)", str(each.get("d"))) for each in drawn]
        paper = np.array(ends, dtype=float).reshape(-1, 2)
        truth = np.stack([machine.bottom_m, machine.top_m], axis=1)[..., plane].reshape(-1, 2)
        paper, truth = paper - paper.mean(axis=0), truth - truth.mean(axis=0)
        scales.append((truth * paper).sum() / (truth**2).sum())
        np.testing.assert_allclose(paper / scales[-1], truth, atol=1e-3)
    assert scales[0] == pytest.approx(scales[1], rel=1e-3)


# Bode plot.


@pytest.mark.parametrize("row", [0, 1], ids=ANGLES)
def test_the_published_compensator_has_the_published_margins(model, loops, row):
    """G(s) as in figures.json, and the plant's own matrices, without the sampled system."""
    measures = loop_measures(loops[ANGLES[row]].loop)
    plant, pointing = nominal_plant(model)
    s = 2j * np.pi * measures["crossover_hz"]
    moved = np.linalg.solve(s * np.eye(len(plant.A)) - plant.A, plant.B @ pointing[:, row])
    G = np.polyval(measures["numerator"], s) / np.polyval(measures["denominator"], s)
    L = G * complex(plant.C_twist[row] @ moved)
    assert abs(L) == pytest.approx(1, rel=1e-3)
    held_deg = np.rad2deg(abs(s) * TestbedConfig().control_period_s / 2)  # by the zero-order hold
    margin_deg = 180 + np.rad2deg(np.angle(L)) - held_deg
    assert margin_deg == pytest.approx(measures["phase_margin_deg"], abs=0.2)


def test_the_margins_lie_on_the_curve_of_the_sampled_loop(model, loops):
    """L(e^jwT) by matrix exponential and inverses: the curves, and both ends of each arrow."""
    plant, pointing = nominal_plant(model)
    T, n = TestbedConfig().control_period_s, len(plant.A)

    def open_loop(frequency_hz: float, row: int) -> complex:
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = plant.A, plant.B @ pointing[:, row]
        held = scipy.linalg.expm(T * both)
        z, loop = np.exp(2j * np.pi * frequency_hz * T), loops[ANGLES[row]].loop
        P = plant.C_twist[row] @ np.linalg.solve(z * np.eye(n) - held[:n, :n], held[:n, n])
        inner = np.linalg.solve(z * np.eye(len(loop.A)) - loop.A, loop.B)
        return complex(P * (loop.C @ inner + loop.D)[0, 0])

    axes = figure_bode(loops).axes
    for row, one in enumerate(loops.values()):
        magnitude, phase = axes[row], axes[2 + row]
        curve = np.asarray(magnitude.lines[0].get_xydata())
        for frequency_hz, decibels in curve[::100]:
            assert decibels == pytest.approx(
                20 * np.log10(abs(open_loop(frequency_hz, row))), abs=1e-6
            )
        degrees = np.asarray(phase.lines[0].get_xydata())
        for frequency_hz, angle in degrees[::100]:
            off = np.deg2rad(angle) - np.angle(open_loop(frequency_hz, row))
            assert abs(np.exp(1j * off) - 1) < 1e-6
        gain = arrow(magnitude)
        (at_hz, low), (same_hz, high) = gain.xy, gain.xyann
        assert (same_hz, high) == (at_hz, 0)
        assert 20 * np.log10(-open_loop(at_hz, row).real) == pytest.approx(low, abs=0.01)
        assert abs(np.angle(-open_loop(at_hz, row))) < 1e-3
        lag = arrow(phase)
        (at_hz, low), (same_hz, high) = lag.xy, lag.xyann
        assert (same_hz, low) == (at_hz, -180)
        assert abs(open_loop(at_hz, row)) == pytest.approx(1, abs=1e-3)
        assert np.rad2deg(np.angle(open_loop(at_hz, row))) == pytest.approx(high, abs=0.05)
        assert f"gain margin {one.loop.gain_margin_db:.1f} dB" in said_on(magnitude)
        assert f"phase margin {one.loop.phase_margin_deg:.1f}°" in said_on(phase)


def arrow(axes: Axes) -> Annotation:
    """The one mark without words."""
    (mark,) = (text for text in axes.texts if not text.get_text())
    assert isinstance(mark, Annotation)
    return mark


def said_on(axes: Axes) -> str:
    return " ".join(text.get_text() for text in axes.texts)


# Failure atlas.


def cells(axes: Axes) -> list[str]:
    """Colours of the map, row by row."""
    mesh = axes.collections[0]
    values = np.asarray(mesh.get_array()).ravel()
    return [to_hex(color).upper() for color in mesh.to_rgba(values).tolist()]


def test_the_map_counts_what_the_atlas_counts(atlas):
    found = pointing_verdicts(atlas)
    figure = figure_atlas(found)
    counts = Counter(cells(figure.axes[0]))
    assert counts[BLUE] == atlas.possible.sum() == 54
    assert counts[BLUE] + counts[SKY] == atlas.elastic.possible.sum() == 425
    # Two states of failure for each strut: six lost, 2^6; all but one lost, 6 * 2^5.
    assert counts[BLACK] == 64
    assert counts[YELLOW] == 729 - 425 - 64
    table = counted(found)
    assert table.conditions[table.conditions > 0].tolist() == [54, 371, 240, 64]
    # So many conditions have 0..6 failures: each failed strut is locked or free.
    by_failures = table.filter(like="failures_").sum()
    assert by_failures.tolist() == [1, 12, 60, 160, 240, 192, 64]


def test_a_cell_of_the_map_is_the_condition_that_its_letters_say(atlas):
    """Letters above and beside the map, by their places, against the atlas' rows."""
    axes = figure_atlas(pointing_verdicts(atlas)).axes[0]
    colors = cells(axes)
    letters = {
        tuple(np.round(text.get_position(), 6)): text.get_text()
        for text in axes.texts
        if text.get_text() in ("S", "L", "F")
    }
    assert len(letters) == 2 * (3 + 9 + 27)

    def code(cell: int, *, along: int) -> list[str]:
        """The three letters of a row (along=1) or column (along=0), outermost first."""
        places = [place for place in letters if place[1 - along] < 0]
        levels = sorted({place[1 - along] for place in places})
        return [
            letters[
                min(
                    (p for p in places if p[1 - along] == level),
                    key=lambda p: abs(p[along] - cell - 0.5),
                )
            ]
            for level in levels
        ]

    for row in range(0, 27, 4):
        for column in range(27):
            state = code(row, along=1) + code(column, along=0)
            locked = [k for k in range(6) if state[k] == "L"]
            free = [k for k in range(6) if state[k] == "F"]
            at = atlas.row(locked, free)
            expected = BLUE if atlas.possible[at] else SKY
            assert (colors[27 * row + column] == expected) == atlas.elastic.possible[at]


# Fig. 4 to 6.


def test_the_panels_of_figures_4_to_6_show_their_runs(runs):
    made = {name: run_of(arrays) for name, arrays in runs.items()}
    axes = figure_4(made).axes
    for plane, panel, name in zip(axes[:3], axes[3:], ("W_a", "W_b", "W_c"), strict=True):
        assert_plane(plane, runs[name], name)
        assert panel.get_xlim() == (0, 16)
        for line, current in zip(panel.lines, runs[name]["strut_input_percent"].T, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), current)
    axes = figure_6(made).axes
    for (plane, *panels), name in zip((axes[:3], axes[3:]), ("W_d", "W_e"), strict=True):
        assert_plane(plane, runs[name], name)
        lines = [line for panel in panels for line in panel.lines]
        labels = ["$t_x$, µm", "$t_y$, µm", "$t_z$, µm", "$\\gamma$, µrad"]
        assert [line.get_label() for line in lines] == labels
        for line, column in zip(lines, (1, 2, 3, 0), strict=True):
            shown = 1e6 * runs[name]["secondary"][:, column]
            np.testing.assert_allclose(np.asarray(line.get_ydata()), shown, rtol=1e-9, atol=1e-12)
    sound, locked = (runs[name] for name in ("W_a", "W_a_uncorrected"))
    spiral, *both = figure_5(made).axes
    np.testing.assert_array_equal(spiral.lines[0].get_xydata(), 1e6 * locked["measured_rad"])
    assert_errors(both, locked)
    assert_errors(both, sound, line=1)
    for figure in (figure_4, figure_5, figure_6):
        drawn = figure(made)
        assert not any(panel.get_legend() for panel in drawn.axes)
        (legend,) = drawn.legends
        labels = [text.get_text() for text in legend.get_texts()]
        assert len(labels) == len(set(labels))
        assert "error: desired minus true" in labels


def assert_plane(plane: Axes, run: dict[str, np.ndarray], name: str) -> None:
    """Its curve is the error of beta over that of alpha, on the same scale, with both RMS."""
    (curve,) = plane.lines
    errors_urad = 1e6 * (run["desired_rad"] - run["true_rad"])
    np.testing.assert_array_equal(curve.get_xydata(), errors_urad)
    assert plane.get_xlim() == plane.get_ylim()
    alpha, beta = np.sqrt((errors_urad**2).mean(axis=0))
    assert plane.get_title() == f"$W_{name[-1]}$: RMS {alpha:.2f} and {beta:.2f} µrad"


def assert_errors(panels: list[Axes], run: dict[str, np.ndarray], line: int = 0) -> None:
    """Alpha and beta, desired minus true."""
    errors_urad = 1e6 * (run["desired_rad"] - run["true_rad"])
    for panel, angle, error in zip(panels, ("alpha", "beta"), errors_urad.T, strict=True):
        np.testing.assert_array_equal(panel.lines[line].get_ydata(), error)
        if panel.get_ylabel():
            assert angle in panel.get_ylabel()
        if line == 0:
            rms = np.sqrt((error**2).mean())
            assert panel.get_title(loc="left") == f"RMS {rms:.2f} µrad"


def test_the_result_shows_what_its_legends_say(runs):
    """Sizes and peaks by other words of numpy's."""
    made = {name: run_of(arrays) for name, arrays in runs.items()}
    left, right = figure_result(made).axes
    for line, name in zip(left.lines, ("W_a_uncorrected", "W_a", "W_e"), strict=True):
        run = runs[name]
        size = 1e6 * np.hypot(*(run["desired_rad"] - run["true_rad"]).T)
        np.testing.assert_allclose(np.asarray(line.get_ydata()), size, rtol=1e-12)
        assert str(line.get_label()).endswith(f"RMS {np.sqrt((size**2).mean()):.1f} µrad")
    for line, name in zip(right.lines, ("W_d", "W_e"), strict=True):
        t_x = 1e6 * runs[name]["secondary"][:, 1]
        np.testing.assert_array_equal(line.get_ydata(), t_x)
        assert str(line.get_label()).endswith(f"peak {abs(t_x).max():.3g} µm")
