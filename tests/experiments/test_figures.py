"""Tests of the study `figures`: margins of the loops, and counts of conditions."""

from functools import cache

import numpy as np
import pytest

from experiments.figures import OpenLoop, class_counts, open_loop
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import ANGLES, design, nominal_plant
from fjh.rig.hexapod.fault_tolerance import elastic_system, pointing_classifications
from fjh.rig.hexapod.metrics import loop_measures
from fjh.rig.hexapod.testbed import TestbedConfig
from prioritized import failure_atlas
from sim import load_model


@cache
def loops() -> dict[str, OpenLoop]:
    plant, pointing = nominal_plant(load_model())
    designed = enumerate(zip(ANGLES, design(plant, pointing, TestbedConfig()), strict=True))
    return {angle: open_loop(plant, pointing, loop, row) for row, (angle, loop) in designed}


@pytest.mark.parametrize("row", [0, 1], ids=ANGLES)
def test_the_published_compensator_has_the_published_margins(model, row):
    """G(s) is that of figures.json, the plant continuous, without the sampled system."""
    measures = loop_measures(loops()[ANGLES[row]].loop)
    plant, pointing = nominal_plant(model)
    s = 2j * np.pi * measures["crossover_hz"]
    moved = np.linalg.solve(s * np.eye(len(plant.A)) - plant.A, plant.B @ pointing[:, row])
    G = np.polyval(measures["numerator"], s) / np.polyval(measures["denominator"], s)
    L = G * complex(plant.C_twist[row] @ moved)
    assert abs(L) == pytest.approx(1, rel=1e-3)
    delay_deg = np.rad2deg(abs(s) * TestbedConfig().control_period_s / 2)  # by the zero-order hold
    margin_deg = 180 + np.rad2deg(np.angle(L)) - delay_deg
    assert margin_deg == pytest.approx(measures["phase_margin_deg"], abs=0.2)


def test_the_map_counts_what_the_atlas_counts(model):
    atlas = failure_atlas(elastic_system(model), MAJOR)
    classes = pointing_classifications(atlas)
    table = class_counts(classes)
    assert atlas.elastic is not None
    assert (atlas.possible.sum(), atlas.elastic.possible.sum()) == (54, 54 + 371)
    # Two states of failure for each strut: six lost, 2^6; all but one lost, 6 * 2^5.
    assert table.conditions[table.conditions > 0].tolist() == [54, 371, 729 - 425 - 64, 64]
    # Numbers of conditions with 0..6 failures: each failed strut is locked or free.
    by_failures = table.filter(like="failures_").sum()
    assert by_failures.tolist() == [1, 12, 60, 160, 240, 192, 64]
