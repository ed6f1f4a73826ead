"""The atlas simulated: conditions, verdicts beside their runs, and what may disagree."""

import copy
import itertools
import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.rig.conditions import every_condition
from experiments.sweep.atlas import checks, notes
from experiments.sweep.row import classified, verdict_columns
from experiments.sweep.runs import representatives
from sim import NOMINAL, hexapod
from tests.conftest import FLOWN


@pytest.fixture(scope="module")
def simulated(atlas_folder):
    """`atlas.json`."""
    return json.loads((atlas_folder / "atlas.json").read_text())


@pytest.fixture(scope="module")
def rows(atlas_folder):
    """`atlas.parquet`, by struts and Jacobian."""
    table = pq.read_table(atlas_folder / "atlas.parquet").to_pylist()
    return {(row["struts"], row["jacobian"]): row for row in table}


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


def test_symmetry_leaves_the_verdict_alone():
    atlas = classified()
    assert atlas.elastic is not None
    for struts in ("FSSSSS", "SLFSSL", "SFFSLF"):
        turned = [struts[k:] + struts[:k] for k in (0, 2, 4)]
        rows = [every_condition(6).index(each) for each in turned]
        for flag in (atlas.possible, atlas.elastic.possible, atlas.elastic.major_rank):
            assert len(set(flag[rows].tolist())) == 1


def test_verdicts_stand_beside_their_conditions():
    atlas, asked = classified(), ["LLLLLL", "SSSSSS", "SLSSSF"]
    columns = verdict_columns(asked)
    at = [atlas.row(range(6)), atlas.row(), atlas.row(locked=[1], free=[5])]
    assert atlas.elastic is not None
    assert columns["rigid_possible"].tolist() == atlas.possible[at].tolist()
    assert columns["elastic_possible"].tolist() == atlas.elastic.possible[at].tolist()
    assert columns["failures"].tolist() == [6, 0, 2]
    assert columns["verdict"].tolist() == ["none", "rigid", "springs"]


def test_what_the_library_calls_possible_points_and_nothing_else_does(rows):
    """In the physics: as well as the sound machine, or as badly as something that cannot move."""
    assert len(rows) == 2 * len(FLOWN)
    for (struts, _), row in rows.items():
        possible = row["elastic_possible"]
        assert (row["status"] == "exact") == possible
        sound = rows["SSSSSS", "constant"]
        worse = max(row[f"{a}_rms_urad"] / sound[f"{a}_rms_urad"] for a in ("alpha", "beta"))
        assert (worse < 2) == possible, struts


def test_without_any_strut_the_error_is_the_whole_spiral(rows):
    row = rows["LLLLLL", "analytic"]
    from experiments.rig.hexapod.testbed import TestbedConfig

    desired_urad = 1e6 * TestbedConfig().desired_rad(TestbedConfig().time_s(0.5))
    alpha, beta = np.sqrt((desired_urad**2).mean(axis=0))
    assert row["alpha_rms_urad"] == pytest.approx(alpha, rel=1e-3)
    assert row["beta_rms_urad"] == pytest.approx(beta, rel=1e-3)


def test_the_only_disagreement_is_at_a_singularity_that_the_nominal_pose_alone_has(
    model, simulated, rows
):
    """Beside it the lost direction is within reach, at a price: by the machine's own geometry."""
    assert [each["struts"] for each in simulated["explained"]] == ["SFFSLF"]
    assert {each["jacobian"] for each in simulated["explained"]} == {"analytic"}
    assert simulated["contradicted"] == []
    there, beside = rows["SFFSLF", "constant"], rows["SFFSLF", "analytic"]
    assert there["alpha_rms_urad"] == pytest.approx(there["predicted_alpha_rms_urad"], rel=0.05)
    assert beside["alpha_rms_urad"] > 10 * there["alpha_rms_urad"]
    assert "SFFSLF" in " ".join(notes(simulated))

    from experiments.rig.hexapod.controller import StrutMapping
    from experiments.rig.hexapod.fault_tolerance import strut_and_payload_stiffness
    from ftc.goal import Goal

    goal = Goal(joint_weight=(1.0,) * 6, locked_at={4: 0.0}, free=(1, 2, 5))
    machine = hexapod(model)
    mapping = StrutMapping(machine, goal, "analytic", strut_and_payload_stiffness(model))
    gains = {}
    for name, pose in (("at", NOMINAL), ("beside", NOMINAL.moved(np.full(6, 1e-5)))):
        now = mapping.at(machine.posture(pose))
        gains[name] = np.linalg.norm(now.mapping.major)
    assert gains["beside"] > 1e3 * gains["at"]


@pytest.mark.parametrize(
    ("struts", "said"),
    [("SSLSSS", "SSLSSS with W_a and the constant Jacobian"), ("SLLSLL", "SLLSLL")],
)
def test_a_check_fails_where_physics_contradicts_theory(simulated, struts, said):
    assert all(check.passed for check in checks(simulated))
    spoilt = copy.deepcopy(simulated)
    entry = {"struts": struts, "weight": "W_a", "jacobian": "constant", "off_over_allowed": 3.0}
    spoilt["contradicted"] = [entry]
    assert said in failed(spoilt)
    opened = simulated | {"closure_residual_max_m": 1e-7}
    assert "closure residual [m] is 1e-07" in failed(opened)


def failed(summary) -> str:
    """The only check that does not pass."""
    [check] = [check for check in checks(summary) if not check.passed]
    return str(check)
