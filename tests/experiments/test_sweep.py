"""Tests of the sweep and the atlas: designs, rows, resuming, and classification."""

import itertools
import json
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments import sweep as sweeps
from experiments import sweep_design as designs
from experiments.again import repeat_run
from experiments.app.cli import main
from experiments.study import UNFINISHED, Where
from experiments.table1 import CONFIGURATIONS
from fjh.rig.conditions import every_condition
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import secondary
from fjh.rig.hexapod.controller import StrutMapping
from fjh.rig.hexapod.fault_tolerance import strut_and_payload_stiffness
from fjh.rig.hexapod.machine import detector_noise_rad
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import LIMITS, TestbedConfig
from fjh.study.errors import Interrupted, WrongInput
from ftc import Goal
from sim import NOMINAL, Failure, SimulationDiverged
from tests.experiments.conftest import CONDITIONS, SHORT_SWEEP
from tests.experiments.results import Results

UNEVEN = designs.Design(
    "latin-hypercube",
    17,
    0.1,
    {
        "roll_off_hz": {"from": 20.0, "to": 30.0, "log": False},
        "detector_noise_m": {"from": 1e-7, "to": 1e-5, "log": True},
        "dac_bits": {"from": 2, "to": 18, "log": False},
        "known": [True, False],
    },
)


def test_a_hypercube_has_one_run_in_each_slice_of_each_range():
    runs = designs.runs_of(UNEVEN, seed=3)
    rows = pd.DataFrame([run.parameters() for run in runs])
    for name, edges in (
        ("roll_off_hz", np.linspace(20, 30, 18)),
        ("detector_noise_m", np.geomspace(1e-7, 1e-5, 18)),
        ("dac_bits", np.arange(2, 20)),
    ):
        assert np.histogram(rows[name], edges)[0].tolist() == [1] * 17, name
    assert abs(2 * rows.known.sum() - 17) == 1
    # Runs depend on design, seed and number alone, and are small.
    assert runs == designs.runs_of(UNEVEN, 3) and len({run.seed for run in runs}) == 17
    assert not set(runs) & set(designs.runs_of(UNEVEN, 4))
    assert len(pickle.dumps(runs[0])) < 1000


def test_a_grid_is_the_full_product_with_the_last_factor_fastest():
    factors: dict[str, Any] = {
        "struts": ["SSSSSS", "LSSSSS"],
        "roll_off_hz": {"from": 20.0, "to": 30.0, "log": False, "points": 3},
        "detector_noise_m": {"from": 1e-7, "to": 1e-5, "log": True, "points": 3},
    }
    runs = designs.runs_of(designs.Design("grid", 18, 0.1, factors), seed=0)
    levels = (("SSSSSS", "LSSSSS"), (20, 25, 30), (1e-7, 1e-6, 1e-5))
    for run, (struts, *numbers) in zip(runs, itertools.product(*levels), strict=True):
        row = run.parameters()
        assert row["struts"] == struts
        assert [row["roll_off_hz"], row["detector_noise_m"]] == pytest.approx(numbers, rel=1e-12)


def test_the_design_of_the_demand_limit_has_the_configuration_of_the_table():
    """The configuration occurs for healthy and locked, corrected and not."""
    design = designs.read_design(designs.DEFAULT.with_name("sweep_demand_limit.toml"))
    benches = [run.bench for run in designs.runs_of(design, seed=3)]
    assert len(benches) == design.runs and benches.count(CONFIGURATIONS["demand-limit"]) == 4


def test_a_bench_has_no_constant_beyond_its_limits():
    for name, (low, high) in LIMITS.items():
        for value in (low, high):
            assert getattr(replace(TestbedConfig(), **{name: value}), name) == value
        for value in [np.nextafter(low, -np.inf), np.nextafter(high, np.inf), 10**400, np.nan, "1"]:
            with pytest.raises(ValueError, match=rf"{name} must be a .*number from .* to .*, got"):
                replace(TestbedConfig(), **{name: value})


SPREAD = "layout = 'latin-hypercube'\nruns = "


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("layout = 'random'", "layout must be latin-hypercube or grid, got 'random'"),
        ("layout = 'grid'", r"\[vary\] must name at least one"),
        ("layout = 'grid'\nruns = 3\nvary.seed = [1]", "runs must not be given for a grid"),
        (f"{SPREAD}2\nvary.seed = {{from=1, to=2, points=2}}", "points"),
        (f"{SPREAD}1{400 * '0'}\nvary.seed = [1]", "at most 200000 runs"),
        ("duration_s = 0.02\nvary.control_period_s = [1e-3, 0.05]", "duration_s .* from 0.05"),
        ("vary.colour = ['red']", "no 'colour' to vary; there are struts, known"),
        ("vary.struts = ['SSSXSS']", "struts must be six letters out of SLFB, got 'SSSXSS'"),
        ("vary.weight = ['W_z']", 'weight must be one of "W_a", .*, got .W_z.'),
        ("vary.roll_off_hz = {from = 2, to = 1, points = 2}", "from below to, got 2.0 to 1.0"),
        ("vary.roll_off_hz = {from = 1, to = 2, points = 1_000_000_000_000}", "at most 200000"),
        ("vary.dac_bits = {from = 2, to = 9, log = true, points = 2}", "dac_bits can have log"),
        (f"vary.dac_bits = 0x{'f' * 6000}", "from 2 to 32, got a huge int"),
        (f"vary.seed = {'[' * 100_000}", "recursion"),
    ],
)
def test_an_invalid_design_is_rejected(tmp_path, text, message):
    file = tmp_path / "design.toml"
    file.write_text(text if text.startswith("layout") else f"layout = 'grid'\n{text}")
    with pytest.raises(WrongInput, match=f"^--design {file}: .*{message}"):
        designs.read_design(file)


@pytest.mark.long
@pytest.mark.parametrize("anti_windup", [False, True])
def test_a_run_with_a_limit_on_the_demand_is_predicted_with_it(anti_windup):
    """The limit is reached; without it, or with other anti-windup, errors differ."""
    values = {"seed": 2, "struts": "LSSSSS", "known": False, "spiral_exponent": 0.5}
    limited = values | {"demand_limit_urad": 20.0, "anti_windup": anti_windup}
    row = sweeps.row_of(designs.sweep_run(0, 1.5, limited))
    other = sweeps.row_of(designs.sweep_run(0, 1.5, limited | {"anti_windup": not anti_windup}))
    free = sweeps.row_of(designs.sweep_run(0, 1.5, values))
    assert (row["demand_limit_urad"], free["demand_limit_urad"]) == (20.0, None)
    for name in sweeps.RMS:
        assert row[name] == pytest.approx(row[f"predicted_{name}"], rel=0.01)
        assert abs(other[name] / row[name] - 1) > 0.05
        assert abs(free[name] / row[name] - 1) > 0.05


@pytest.mark.long
def test_a_row_has_the_numbers_of_the_run_and_the_linear_model():
    """The compensators are designed for other constants."""
    bench = TestbedConfig(detector_noise_m=1e-6)
    values = {"seed": 7, "detector_noise_m": 1e-6, "weight": "W_e", "struts": "SSLSSS"}
    row = sweeps.row_of(designs.sweep_run(3, 0.3, values))
    goal = Goal(secondary_weight=(10, 10, 1, 1), locked_at={2: 0.0})
    lock = (Failure(2, "locked"),)
    rig = hexapod_rig(nominal_testbed(bench), goal, jacobian="analytic")
    path = bench.spiral_rad(0.3)
    simulated = rig.fly(rig.controller(), path, failures=lock, seed=7)
    np.testing.assert_allclose(
        [row[name] for name in sweeps.RMS], 1e6 * simulated.rms(), rtol=1e-12
    )
    assert row["t_x_peak_um"] == 1e6 * abs(secondary(simulated)[:, 1]).max()
    assert row["strut_input_peak_percent_3"] == 0.0
    noise = detector_noise_rad(bench, 7, len(path))
    model = rig.predict(path, failures=lock, told=False, noise=noise)
    np.testing.assert_allclose([row[name] for name in sweeps.PREDICTED], 1e6 * model.rms, rtol=1e-9)
    assert (row["case"], row["status"], row["message"]) == (3, "exact", None)


# Three struts bear the load of six: this loop is too fast for them.
TOO_FAST = {"alpha_crossover_hz": 10.0, "beta_crossover_hz": 7.7, "roll_off_hz": 60.0}


@pytest.mark.long
@pytest.mark.parametrize(
    ("values", "status"),
    [
        ({}, "exact"),
        ({"struts": "SLLSLL"}, "least_squares"),
        ({"struts": "LLLLLL"}, "least_squares"),
        ({"struts": "BSSSSS", "failure_time_s": 0.02}, "exact"),
        ({"alpha_crossover_hz": 60.0}, "refused"),
        ({"control_period_s": 3e-4}, "refused"),
        (TOO_FAST | {"struts": "LSLSLS"}, "unstable"),
    ],
)
def test_an_unsuccessful_run_is_a_row_with_its_status(values, status):
    row = sweeps.row_of(designs.sweep_run(0, 0.05, {"seed": 1, "settling_s": 0.05} | values))
    assert row["status"] == status
    assert (row["message"] is not None) == (row["alpha_rms_urad"] is None) == (status == "refused")


def test_a_diverging_run_is_a_row(monkeypatch):
    def diverge(*_args, **_options):
        raise SimulationDiverged(0.03, np.zeros(3))

    monkeypatch.setattr("fjh.rig.rig.simulate", diverge)
    row = sweeps.row_of(designs.sweep_run(0, 0.05, {"seed": 1}))
    assert (row["status"], row["diverged_at_s"]) == ("diverged", 0.03)
    assert "non-finite at t = 0.0300 s" in row["message"]


@pytest.fixture(scope="module")
def rows(study):
    """Runs compared with the linear model."""
    return sweeps.compare_with_model(study.rows)


def test_the_rows_are_the_runs_in_order_and_repeatable(study, rows):
    sampled = pd.DataFrame(
        [run.parameters() for run in designs.runs_of(designs.read_design(SHORT_SWEEP), 0)]
    )
    names = [name for name in sampled if sampled[name].notna().all()]
    pd.testing.assert_frame_equal(rows[names], sampled[names], check_dtype=False)
    _, comparison = repeat_run(study.folder, 29)
    assert comparison.same.all() and len(comparison) > 20
    summary = json.loads(json.dumps(study.summary))
    summary["basis"]["design"]["runs"] = designs.MOST_RUNS + 1
    with pytest.raises(WrongInput, match="at most 200000 runs"):
        sweeps.repeatable_runs(summary)


def test_the_tables_are_those_of_the_rows(study, rows):
    summary = study.summary
    assert summary["status"] == [{"status": "exact", "runs": 30}]
    reported = rows[(rows.struts != "SSSSSS") & rows.known]
    [group] = [one for one in summary["groups"] if one["failures"] == 1 and one["told"]]
    assert group["runs"] == len(reported)
    assert group["alpha_median_urad"] == pytest.approx(
        np.median(reported.alpha_rms_urad), rel=1e-12
    )
    prediction = summary["prediction"][0]
    assert prediction["compared"] == rows.predicted_alpha_rms_urad.notna().sum() < 30
    assert [entry["name"] for entry in summary["influence"]] == ["roll_off_hz"]


def test_a_resumed_sweep_has_the_same_bytes(sweep_folder, scheduler, tmp_path, capsys):
    """The sweep is resumed on a Dask cluster."""

    def interrupt(done: int, total: int) -> None:
        if done == 9:
            raise KeyboardInterrupt

    where = Where(scheduler=scheduler)
    with pytest.raises(Interrupted, match="9 of 30 runs are saved"):
        sweeps.sweep(design=SHORT_SWEEP, where=where, folder=tmp_path, on_progress=interrupt)
    arguments = ["sweep", "--design", str(SHORT_SWEEP), "--out", str(tmp_path), "--quiet"]
    assert main(arguments) == 2
    assert main([*arguments, "--resume", "--seed", "5"]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main([*arguments, "--resume", "--scheduler", scheduler]) == 0
    assert not (tmp_path / UNFINISHED).exists()
    assert main([*arguments, "--resume"]) == 0
    for file in ("sweep.parquet", "sweep.json"):
        assert (sweep_folder / file).read_bytes() == (tmp_path / file).read_bytes()


@pytest.mark.parametrize("column", [sweeps.PREDICTED[0], sweeps.INPUT_PEAK[3]])
def test_unpredicted_or_saturated_runs_are_not_compared(rows, column):
    none = sweeps.compare_with_model(
        rows.assign(**{column: np.nan if column in sweeps.PREDICTED else 100.0})
    )
    assert not none.compared.any() and sweeps.prediction(none).compared[0] == 0
    assert sweeps.checks(none) == []


@pytest.fixture(scope="module")
def atlas(atlas_folder):
    """Runs of the atlas compared with the linear model."""
    return sweeps.compare_with_model(Results(atlas_folder, "atlas").rows)


def test_there_is_one_representative_of_each_symmetry_class(model):
    """Symmetries are those of the nodes; the number of classes is by Burnside's lemma."""
    machine = hexapod(model)
    ends = np.stack([machine.bottom_m, machine.top_m])
    third = 2 * np.pi / 3
    moves = []
    for turn, flip in itertools.product(range(3), (1, -1)):
        c, s = np.cos(turn * third), np.sin(turn * third)
        moved = ends @ (np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([flip, 1, 1])).T
        gaps = np.linalg.norm(moved[:, :, None] - ends[:, None], axis=-1).max(axis=0)
        assert gaps.min(axis=1).max() < 1e-9
        moves.append(gaps.argmin(axis=1).tolist())
    every = every_condition(6)
    left_alone = sum("".join(c[k] for k in move) == c for move in moves for c in every)
    chosen = sweeps.representatives()
    assert len(chosen) == left_alone / 6 == 138
    reached = {"".join(c[k] for k in move) for move in moves for c in chosen}
    assert reached == set(every)
    for struts in ("FSSSSS", "SLFSSL", "SFFSLF"):
        equal = sweeps.classified().loc[["".join(struts[k] for k in move) for move in moves]]
        assert (equal.drop(columns=[c for c in equal if "gain" in c]).nunique() == 1).all()


def test_the_machine_points_only_if_classified_as_possible(atlas):
    """Simulated errors are those of the healthy machine, or of one that cannot move."""
    assert len(atlas) == 2 * len(CONDITIONS)
    healthy = atlas.set_index(["struts", "jacobian"]).loc[("SSSSSS", "constant"), sweeps.RMS]
    worse = (atlas[sweeps.RMS] / healthy.to_numpy(float)).max(axis=1)
    assert ((atlas.status == "exact") == atlas.elastic_possible).all()
    assert ((worse < 2) == atlas.elastic_possible).all()
    desired_urad = 1e6 * TestbedConfig().desired_rad(TestbedConfig().time_s(0.5))
    [none] = atlas.query("struts == 'LLLLLL' and jacobian == 'analytic'")[sweeps.RMS].to_numpy()
    np.testing.assert_allclose(none, np.sqrt((desired_urad**2).mean(axis=0)), rtol=1e-3)


def test_the_only_disagreement_is_at_a_singularity_of_the_nominal_pose(model, atlas):
    """Near it the lost direction can be moved with a large gain."""
    off_rows = sweeps.disagreements(atlas)
    assert off_rows.explained.all()
    assert set(zip(off_rows.struts, off_rows.jacobian, strict=True)) == {("SFFSLF", "analytic")}
    by = atlas.set_index(["struts", "jacobian"])
    constant, analytic = by.loc["SFFSLF", "constant"], by.loc["SFFSLF", "analytic"]
    assert constant[sweeps.RMS[0]] == pytest.approx(constant[sweeps.PREDICTED[0]], rel=0.05)
    assert analytic[sweeps.RMS[0]] > 10 * constant[sweeps.RMS[0]]
    goal = Goal(joint_weight=(1.0,) * 6, locked_at={4: 0.0}, free=(1, 2, 5))
    machine = hexapod(model)
    mapping = StrutMapping(machine, goal, "analytic", strut_and_payload_stiffness(model))
    at, near = (
        np.linalg.norm(mapping.at(machine.posture(pose)).mapping.major)
        for pose in (NOMINAL, NOMINAL.moved(np.full(6, 1e-5)))
    )
    assert near > 1e3 * at
