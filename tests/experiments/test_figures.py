"""Figures of machine, loops and failures: drawn from what runs."""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.text import Annotation

from experiments.app.cli import main
from experiments.figures import OpenLoop, counted, figure_atlas, figure_bode, open_loop
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import ANGLES, design, nominal_plant
from fjh.rig.hexapod.fault_tolerance import elastic_system, pointing_verdicts
from fjh.rig.hexapod.metrics import loop_measures
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.study.palette import BLACK, BLUE, SKY, YELLOW
from prioritized import failure_atlas
from sim import HEXAPOD_MJCF, load_model

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
SVG = "{http://www.w3.org/2000/svg}"


@cache
def loops() -> dict[str, OpenLoop]:
    plant, pointing = nominal_plant(load_model())
    designed = enumerate(zip(ANGLES, design(plant, pointing, TestbedConfig()), strict=True))
    return {angle: open_loop(plant, pointing, loop, row) for row, (angle, loop) in designed}


def test_a_machine_that_is_no_hexapod_is_refused(capsys, tmp_path):
    arm = str(HEXAPOD_MJCF.with_name("arm.xml"))
    assert main(["figures", "--model", arm, "--out", str(tmp_path / "out")]) == 2
    assert "a hexapod has six actuators" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_figure_2_is_of_the_machine(model):
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


@pytest.mark.parametrize("row", [0, 1], ids=ANGLES)
def test_the_published_compensator_has_the_published_margins(model, row):
    """G(s) as in figures.json, and the plant's own matrices, without the sampled system."""
    measures = loop_measures(loops()[ANGLES[row]].loop)
    plant, pointing = nominal_plant(model)
    s = 2j * np.pi * measures["crossover_hz"]
    moved = np.linalg.solve(s * np.eye(len(plant.A)) - plant.A, plant.B @ pointing[:, row])
    G = np.polyval(measures["numerator"], s) / np.polyval(measures["denominator"], s)
    L = G * complex(plant.C_twist[row] @ moved)
    assert abs(L) == pytest.approx(1, rel=1e-3)
    held_deg = np.rad2deg(abs(s) * TestbedConfig().control_period_s / 2)  # by the zero-order hold
    margin_deg = 180 + np.rad2deg(np.angle(L)) - held_deg
    assert margin_deg == pytest.approx(measures["phase_margin_deg"], abs=0.2)


def test_the_margins_lie_on_the_curve_of_the_sampled_loop(model):
    """L(e^jwT) by matrix exponential and inverses: the curves, and both ends of each arrow."""
    plant, pointing = nominal_plant(model)
    T, n = TestbedConfig().control_period_s, len(plant.A)

    def sampled(row: int):
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = plant.A, plant.B @ pointing[:, row]
        held, loop = scipy.linalg.expm(T * both), loops()[ANGLES[row]].loop

        def response(frequency_hz: float) -> complex:
            z = np.exp(2j * np.pi * frequency_hz * T)
            P = plant.C_twist[row] @ np.linalg.solve(z * np.eye(n) - held[:n, :n], held[:n, n])
            inner = np.linalg.solve(z * np.eye(len(loop.A)) - loop.A, loop.B)
            return complex(P * (loop.C @ inner + loop.D)[0, 0])

        return response

    axes = figure_bode(loops()).axes
    for row, one in enumerate(loops().values()):
        magnitude, phase, L = axes[row], axes[2 + row], sampled(row)
        for frequency_hz, decibels in np.asarray(magnitude.lines[0].get_xydata())[::100]:
            assert decibels == pytest.approx(20 * np.log10(abs(L(frequency_hz))), abs=1e-6)
        for frequency_hz, angle in np.asarray(phase.lines[0].get_xydata())[::100]:
            off = np.deg2rad(angle) - np.angle(L(frequency_hz))
            assert abs(np.exp(1j * off) - 1) < 1e-6
        (at_hz, low), end = arrow(magnitude)
        assert end == (at_hz, 0)
        assert 20 * np.log10(-L(at_hz).real) == pytest.approx(low, abs=0.01)
        assert abs(np.angle(-L(at_hz))) < 1e-3
        (at_hz, low), (same_hz, high) = arrow(phase)
        assert (same_hz, low) == (at_hz, -180)
        assert abs(L(at_hz)) == pytest.approx(1, abs=1e-3)
        assert np.rad2deg(np.angle(L(at_hz))) == pytest.approx(high, abs=0.05)
        said = " ".join(text.get_text() for text in (*magnitude.texts, *phase.texts))
        assert f"gain margin {one.loop.gain_margin_db:.1f} dB" in said
        assert f"phase margin {one.loop.phase_margin_deg:.1f}°" in said


def arrow(axes: Axes) -> tuple[tuple[float, float], tuple[float, float]]:
    """Both ends of the one mark without words."""
    (mark,) = (text for text in axes.texts if not text.get_text())
    assert isinstance(mark, Annotation)
    return mark.xy, mark.xyann


def test_the_map_counts_what_the_atlas_counts(model):
    atlas = failure_atlas(elastic_system(model), MAJOR)
    found = pointing_verdicts(atlas)
    mesh = figure_atlas(found).axes[0].collections[0]
    colors = mesh.to_rgba(np.asarray(mesh.get_array()).ravel()).tolist()
    counts = Counter(to_hex(color).upper() for color in colors)
    assert atlas.elastic is not None
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
