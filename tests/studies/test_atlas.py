"""The atlas: conditions, verdicts beside their runs, and what may disagree."""

import itertools
import json

import numpy as np
import pandas as pd
import pytest

from experiments.sweep import (
    PREDICTED,
    RMS,
    atlas_checks,
    atlas_figure,
    beside_model,
    classified,
    disagreements,
    representatives,
    verdicts,
)
from fjh.rig.conditions import every_condition
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.controller import StrutMapping
from fjh.rig.hexapod.fault_tolerance import (
    elastic_system,
    strut_and_payload_stiffness,
)
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc import Goal
from prioritized import failure_atlas
from sim import NOMINAL
from tests.conftest import FLOWN


@pytest.fixture(scope="module")
def rows(atlas_folder):
    """The runs beside the linear model."""
    return beside_model(pd.read_parquet(atlas_folder / "atlas.parquet"))


def test_the_representatives_are_one_of_each_set_that_symmetry_makes(model):
    """Symmetries found in the machine's own nodes: rotations and mirrors that map struts on struts.

    Burnside counts the sets: conditions left as they are, averaged over the six.
    """
    machine = hexapod(model)
    ends = np.stack([machine.bottom_m, machine.top_m])
    third = 2 * np.pi / 3
    found = []
    for turn, flip in itertools.product(range(3), (1, -1)):
        c, s = np.cos(turn * third), np.sin(turn * third)
        moved = ends @ (np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([flip, 1, 1])).T
        gaps = np.linalg.norm(moved[:, :, None] - ends[:, None], axis=-1).max(axis=0)
        assert gaps.min(axis=1).max() < 1e-9
        found.append(gaps.argmin(axis=1).tolist())
    every = every_condition(6)
    left_alone = sum("".join(c[k] for k in move) == c for move in found for c in every)
    chosen = representatives()
    assert len(chosen) == left_alone / 6 == 138
    reached = {"".join(c[k] for k in move) for move in found for c in chosen}
    assert reached == set(every)
    for struts in ("FSSSSS", "SLFSSL", "SFFSLF"):
        alike = classified().loc[["".join(struts[k] for k in move) for move in found]]
        assert (alike.drop(columns=[c for c in alike if "gain" in c]).nunique() == 1).all()


def test_verdicts_stand_beside_their_conditions(model):
    atlas, asked = failure_atlas(elastic_system(model), [0, 1]), ["LLLLLL", "SSSSSS", "SLSSSF"]
    columns = classified().loc[asked]
    at = [atlas.row(range(6)), atlas.row(), atlas.row(locked=[1], free=[5])]
    assert atlas.elastic is not None
    assert columns.rigid_possible.tolist() == atlas.possible[at].tolist()
    assert columns.elastic_possible.tolist() == atlas.elastic.possible[at].tolist()
    assert columns.failures.tolist() == [6, 0, 2]
    assert columns.verdict.tolist() == ["none", "rigid", "springs"]


def test_what_the_library_calls_possible_points_and_nothing_else_does(rows):
    """In the physics: as well as the sound machine, or as badly as something that cannot move."""
    assert len(rows) == 2 * len(FLOWN)
    sound = rows.set_index(["struts", "jacobian"]).loc[("SSSSSS", "constant"), RMS]
    worse = (rows[RMS] / sound.to_numpy(float)).max(axis=1)
    assert ((rows.status == "exact") == rows.elastic_possible).all()
    assert ((worse < 2) == rows.elastic_possible).all()


def test_without_any_strut_the_error_is_the_whole_spiral(rows):
    desired_urad = 1e6 * TestbedConfig().desired_rad(TestbedConfig().time_s(0.5))
    [(alpha, beta)] = rows.query("struts == 'LLLLLL' and jacobian == 'analytic'")[RMS].to_numpy()
    assert (alpha, beta) == pytest.approx(np.sqrt((desired_urad**2).mean(axis=0)), rel=1e-3)


def test_the_only_disagreement_is_at_a_singularity_that_the_nominal_pose_alone_has(model, rows):
    """Beside it the lost direction is within reach, at a price: by the machine's own geometry."""
    found = disagreements(rows)
    assert found.explained.all()
    assert set(zip(found.struts, found.jacobian, strict=True)) == {("SFFSLF", "analytic")}
    by = rows.set_index(["struts", "jacobian"])
    there, beside = by.loc["SFFSLF", "constant"], by.loc["SFFSLF", "analytic"]
    assert there[RMS[0]] == pytest.approx(there[PREDICTED[0]], rel=0.05)
    assert beside[RMS[0]] > 10 * there[RMS[0]]
    goal = Goal(joint_weight=(1.0,) * 6, locked_at={4: 0.0}, free=(1, 2, 5))
    machine = hexapod(model)
    mapping = StrutMapping(machine, goal, "analytic", strut_and_payload_stiffness(model))
    at, near = (
        np.linalg.norm(mapping.at(machine.posture(pose)).mapping.major)
        for pose in (NOMINAL, NOMINAL.moved(np.full(6, 1e-5)))
    )
    assert near > 1e3 * at


def test_the_json_has_the_tables_of_the_rows(atlas_folder, rows):
    summary = json.loads((atlas_folder / "atlas.json").read_text())
    assert [each["case"] for each in summary["disagreements"]] == disagreements(rows).case.tolist()
    assert sum(each["runs"] for each in summary["verdicts"]) == summary["runs"] == len(rows)
    of = verdicts(rows).set_index(["verdict", "jacobian"])
    alike = rows.query("verdict == 'rigid' and jacobian == 'analytic'")
    found = of.loc["rigid", "analytic"]
    assert found.simulated_beta_median_urad == alike.beta_rms_urad.median()
    assert found.largest_off_percent == alike.off_percent.max()


@pytest.mark.parametrize(
    ("struts", "column", "value", "said"),
    [
        ("SSLSSS", "beta_rms_urad", 9.0, "SSLSSS with W_a and the constant Jacobian: number of"),
        ("SFFSLF", "beta_rms_urad", 99.0, "SFFSLF with W_a and the constant Jacobian"),
        ("SLLSLL", "status", "exact", "SLLSLL with W_a"),
        ("SSSSSS", "alpha_rms_urad", np.nan, "SSSSSS with W_a"),
        ("SSSSSS", "closure_residual_max_m", 1e-7, r"closure residual [m] is 1e-07"),
        ("SSSSSS", "closure_residual_max_m", np.nan, r"closure residual [m] is nan"),
    ],
)
def test_a_check_fails_where_physics_contradicts_theory(rows, struts, column, value, said):
    assert all(check.passed for check in atlas_checks(rows))
    spoilt = rows.copy()
    spoilt.loc[(rows.struts == struts) & (rows.jacobian == "constant"), column] = value
    [failed] = [str(each) for each in atlas_checks(beside_model(spoilt)) if not each.passed]
    assert said in failed


def test_the_figure_claims_only_as_many_failures_as_every_condition_survives():
    """Both conditions of two failures lose a direction: any one is claimed, by its worst run."""
    rows = pd.DataFrame({name: [0.4, 0.5, 0.6, 0.4, 3.0, 90.0] for name in [*RMS, *PREDICTED]})
    rows = rows.assign(
        case=range(6),
        struts=["SS", "LS", "LS", "SL", "LL", "FF"],
        failures=[0, 1, 1, 1, 2, 2],
        elastic_possible=[True] * 4 + [False] * 2,
        verdict=["rigid"] * 4 + ["one_direction"] * 2,
        weight="W_a",
        jacobian="analytic",
        status=["exact"] * 4 + ["least_squares"] * 2,
        off_over_allowed=[0.0] * 5 + [9.0],
        compared=True,
    )
    (axes,) = atlas_figure(rows).axes
    assert axes.get_title().startswith("With any 1 struts failed")
    assert axes.get_title().endswith("at most 0.60 µrad, 0.40 with none failed")
    shown = {str(line.get_label()): np.asarray(line.get_ydata()).tolist() for line in axes.lines}
    assert sorted(shown["pointing exact"]) == [0.4, 0.4, 0.6]
    assert shown["one direction left"] == [3.0]
    assert shown["one direction left, singular pose"] == [90.0]
