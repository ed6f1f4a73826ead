"""Figures: drawn from what runs, printable, and the same file every time."""

import json
import re
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from experiments.app.cli import main
from experiments.figures.block_diagram import figure_3
from experiments.figures.figure import figure_atlas, figure_bode, pictures
from experiments.figures.geometry import figure_2
from experiments.figures.results import notes, pointing_after_failures
from experiments.figures.runs import Portrait, portray
from experiments.rig.hexapod.controller import nominal_plant
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.palette import BLACK, BLUE, SKY, YELLOW
from experiments.study.plotting import COLUMN_IN, new_figure, save_figure
from experiments.study.results import Results
from experiments.table1 import figure_4, figure_5, figure_6, figure_result
from sim import hexapod, load_model
from sim.mjcf.model import HEXAPOD_MJCF
from tests.figure_checks import overlapping_texts
from tests.made import run_of
from tests.on_paper import is_printed, text_box, touches
from tests.printed import faults


@pytest.fixture(scope="module")
def portrait() -> Portrait:
    return portray(None, TestbedConfig(), 0)


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


def test_a_figure_is_the_same_file_every_time(figures_folder, portrait, tmp_path):
    save_figure(figure_2(portrait.model), tmp_path, "figure2", ("png", "pdf", "svg"))
    save_figure(figure_atlas(portrait.atlas), tmp_path, "atlas")
    written = sorted(tmp_path.iterdir())
    assert len(written) == 5
    for path in written:
        assert path.read_bytes() == (figures_folder / path.name).read_bytes(), path.name


def test_the_command_leaves_figures_and_their_numbers(figures_folder, portrait):
    names = {
        f"{name}.{kind}"
        for name in ("machine", "figure2", "figure3", "bode", "atlas")
        for kind in ("png", "pdf")
    }
    assert {file.name for file in figures_folder.iterdir()} == names | {
        "figure2.svg",
        "figures.json",
        "figures.md",
    }
    summary = json.loads((figures_folder / "figures.json").read_text())
    assert summary["loops"]["alpha"]["gain_margin_db"] == portrait.loops[0].loop.gain_margin_db
    atlas = summary["atlas"]
    assert (atlas["possible_rigid"], atlas["possible_elastic"]) == (54, 425)
    counts = [one["by_number_of_failures"] for one in atlas["verdicts"].values()]
    # So many conditions have 0..6 failures: each failed strut is locked or free.
    np.testing.assert_array_equal(np.sum(counts, axis=0), [1, 12, 60, 160, 240, 192, 64])


def test_the_page_is_made_of_the_json_alone(figures_folder, portrait):
    summary = json.loads((figures_folder / "figures.json").read_text())
    drawn = {f"{picture.name}.png" for picture in pictures(portrait)}
    assert drawn == {file for file in summary["files"] if file.endswith(".png")}
    table = pointing_after_failures(summary)
    page = Results(summary, tables=[table], notes=notes(summary)).markdown()
    assert (figures_folder / "figures.md").read_text() == page
    assert {len(row) for row in table.rows} == {len(table.headings)}


def test_a_machine_that_is_no_hexapod_is_refused(capsys, tmp_path):
    arm = str(HEXAPOD_MJCF.with_name("arm.xml"))
    assert main(["figures", "--model", arm, "--out", str(tmp_path / "out")]) == 2
    assert "a hexapod has six actuators" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# Fig. 2.

SVG = "{http://www.w3.org/2000/svg}"


def points_on_paper(svg, gid: str) -> np.ndarray:
    """Where the line or marker of that name is in an SVG file, shape (., 2)."""
    (group,) = (each for each in svg.iter(f"{SVG}g") if each.get("id") == gid)
    if uses := list(group.iter(f"{SVG}use")):
        return np.array([[float(use.get(axis)) for axis in "xy"] for use in uses])
    (path,) = group.iter(f"{SVG}path")
    return np.array(re.findall(r"[ML] (\S+) (\S+)", path.get("d")), dtype=float)


@pytest.mark.parametrize("moved", [False, True])
def test_the_geometry_reads_back_as_its_mjcf(tmp_path, moved):
    """All twelve ends of struts in both views, up to one scale and one shift for each view."""
    text = HEXAPOD_MJCF.read_text()
    if moved:
        before, after = 'name="housing1" pos="0 0.3318', 'name="housing1" pos="0.05 0.2918'
        assert before in text
        text = text.replace(before, after)
    (tmp_path / "machine.xml").write_text(text)
    model = load_model(tmp_path / "machine.xml")
    save_figure(figure_2(model), tmp_path, "figure2", ("svg",))
    svg, machine = ET.parse(tmp_path / "figure2.svg"), hexapod(model)
    scales = []
    for view, plane in (("top", [0, 1]), ("front", [0, 2])):
        paper = np.stack([points_on_paper(svg, f"{view}-strut{k}") for k in range(1, 7)])
        truth = np.stack([machine.bottom_m, machine.top_m], axis=1)[..., plane]
        paper, truth = paper.reshape(-1, 2), truth.reshape(-1, 2)
        centred = truth - truth.mean(axis=0)
        scale = (centred * paper).sum() / (centred**2).sum()
        off = paper - paper.mean(axis=0) - scale * centred
        assert abs(off).max() < 1e-3 * scale  # a millimetre of the machine
        scales.append(scale)
        nodes = {"p1": machine.top_m[0], "q2": machine.bottom_m[2 if not moved else 1]}
        for name, node in nodes.items():
            place = points_on_paper(svg, f"{view}-{name}")[0] - paper.mean(axis=0)
            np.testing.assert_allclose(place / scale, node[plane] - truth.mean(axis=0), atol=1e-3)
    assert scales[0] == pytest.approx(scales[1], rel=1e-3)
    # Strut 1 of the moved machine no longer starts where strut 2 does.
    assert np.ptp(machine.bottom_m[:2], axis=0).max() == pytest.approx(
        0.05 if moved else 0, abs=1e-9
    )


def test_the_title_of_the_picture_has_the_papers_strut_length(model):
    """And no label lies on a strut, in either view."""
    figure = figure_2(model)
    assert "The struts are 0.4064 m long" in " ".join(text.get_text() for text in figure.texts)
    figure.draw_without_rendering()
    assert overlapping_texts(figure) == []
    for axes in figure.axes[1:]:
        struts = [line for line in axes.lines if "strut" in str(line.get_gid())]
        assert len(struts) == 6
        for text in filter(is_printed, axes.texts):
            assert not any(touches(line, axes, text_box(text)) for line in struts), text


# Fig. 3.


def said(figure: Figure) -> str:
    return "\n".join(text.get_text() for axes in figure.axes for text in axes.texts)


def numbers(polynomial: str) -> np.ndarray:
    """Coefficients of a printed polynomial in s, highest power first."""
    found = np.zeros(4)
    for term in polynomial.split(" + "):
        number, _, power = term.partition("s")
        number = number.replace("\\,", "").replace("\\cdot 10^{", "e").replace("}", "")
        place = 0 if not _ else int(power.removeprefix("^") or 1)
        found[3 - place] = float(number or 1)
    return found


@pytest.mark.parametrize(
    "bench",
    [
        TestbedConfig(),
        replace(
            TestbedConfig(),
            alpha_crossover_hz=5.0,
            roll_off_hz=30.0,
            dac_bits=12,
            detector_noise_m=5e-7,
        ),
    ],
    ids=["the bench", "another"],
)
def test_the_block_diagram_prints_the_loop_that_runs(model, bench):
    """The printed G(s), and the plant's own matrices, have the printed crossover and margins."""
    text = said(figure_3(portray(None, bench, 0)))
    plant, pointing = nominal_plant(model)

    def response(w: float, row: int) -> complex:
        moved = np.linalg.solve(1j * w * np.eye(12) - plant.A, plant.B @ pointing[:, row])
        return complex(plant.C_twist[row] @ moved)

    compensators = re.findall(r"dfrac\{(.*)\}\{(.*)\}\$", text)
    printed = re.findall(r"crossover (\S+) Hz, margins\n(\S+) dB and (\S+)°", text)
    assert len(compensators) == len(printed) == 2
    for row, (G, margins) in enumerate(zip(compensators, printed, strict=True)):
        crossover_hz, _, phase_margin_deg = map(float, margins)
        assert crossover_hz == pytest.approx(bench.crossover_hz[row], rel=2e-3)
        s = 2j * np.pi * bench.crossover_hz[row]
        L = np.polyval(numbers(G[0]), s) / np.polyval(numbers(G[1]), s) * response(abs(s), row)
        assert abs(L) == pytest.approx(1, rel=1e-3)
        held = np.rad2deg(abs(s) * bench.control_period_s / 2)  # the zero-order hold's delay
        assert 180 + np.rad2deg(np.angle(L)) - held == pytest.approx(phase_margin_deg, abs=0.2)
    assert f"{bench.dac_bits}-bit DAC" in text
    assert f"{635e3 / 2 ** (bench.dac_bits - 1):.1f} nm" in text  # full stroke is 635 µm
    assert f"noise {1e6 * bench.detector_noise_m:g} µrad" in text


# Bode plot.


def test_the_margins_lie_on_the_curve_of_the_sampled_loop(model, portrait):
    """L(e^jwT) by matrix exponential and inverses: the curves, and both ends of each arrow."""
    plant, pointing = nominal_plant(model)
    T, n = TestbedConfig().control_period_s, len(plant.A)

    def open_loop(frequency_hz: float, row: int) -> complex:
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = plant.A, plant.B @ pointing[:, row]
        held = scipy.linalg.expm(T * both)
        z, loop = np.exp(2j * np.pi * frequency_hz * T), portrait.loops[row].loop
        P = plant.C_twist[row] @ np.linalg.solve(z * np.eye(n) - held[:n, :n], held[:n, n])
        inner = np.linalg.solve(z * np.eye(len(loop.A)) - loop.A, loop.B)
        return complex(P * (loop.C @ inner + loop.D)[0, 0])

    axes = figure_bode(portrait.loops).axes
    for row, one in enumerate(portrait.loops):
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


def test_the_map_counts_what_the_atlas_counts(portrait):
    atlas = portrait.atlas
    figure = figure_atlas(atlas)
    counts = Counter(cells(figure.axes[0]))
    assert counts[BLUE] == atlas.possible.sum() == 54
    assert counts[BLUE] + counts[SKY] == atlas.elastic.possible.sum() == 425
    # Two states of failure for each strut: six lost, 2^6; all but one lost, 6 * 2^5.
    assert counts[BLACK] == 64
    assert counts[YELLOW] == 729 - 425 - 64
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [int(text.split()[0]) for text in legend] == [54, 371, 240, 64]


def test_a_cell_of_the_map_is_the_condition_that_its_letters_say(portrait):
    """Letters above and beside the map, by their places, against the atlas' rows."""
    atlas = portrait.atlas
    axes = figure_atlas(atlas).axes[0]
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
