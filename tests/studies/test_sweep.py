"""The sweep: runs that are a pure function, rows that are the run, numbers that are of the rows."""

import itertools
import json
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.again import fly_again
from experiments.app.cli import main
from experiments.study import UNFINISHED, Where
from experiments.sweep import (
    INPUT_PEAK,
    PREDICTED,
    RMS,
    again,
    beside_model,
    checks,
    figure,
    influence,
    prediction,
    row_of,
    sweep,
)
from experiments.sweep_design import (
    BENCH,
    DEFAULT,
    MOST_RUNS,
    VARIED,
    Design,
    read_design,
    runs_of,
    sweep_run,
)
from experiments.table1 import CONFIGURATIONS
from fjh.rig.hexapod.columns import secondary
from fjh.rig.hexapod.machine import detector_noise_rad
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.study.errors import Interrupted, WrongInput
from ftc import Goal
from sim import Failure, SimulationDiverged
from tests.figure_checks import faults

# The design.


def spread(low: float, high: float, log: bool = False, **points: int) -> dict[str, Any]:
    """A range."""
    return {"from": low, "to": high, "log": log, **points}


UNEVEN = Design(
    "latin-hypercube",
    17,
    0.1,
    {
        "roll_off_hz": spread(20.0, 30.0),
        "detector_noise_m": spread(1e-7, 1e-5, log=True),
        "dac_bits": spread(2, 18),
        "known": [True, False],
    },
)


def test_a_hypercube_has_one_run_in_each_slice_of_each_range():
    rows = pd.DataFrame([run.parameters() for run in runs_of(UNEVEN, seed=3)])
    for name, edges in (
        ("roll_off_hz", np.linspace(20, 30, 18)),
        ("detector_noise_m", np.geomspace(1e-7, 1e-5, 18)),
        ("dac_bits", np.arange(2, 20)),
    ):
        assert np.histogram(rows[name], edges)[0].tolist() == [1] * 17, name
    assert abs(2 * rows.known.sum() - 17) == 1


def test_a_grid_is_the_full_product_its_last_factor_the_fastest():
    factors = {
        "struts": ["SSSSSS", "LSSSSS"],
        "roll_off_hz": spread(20.0, 30.0, points=3),
        "detector_noise_m": spread(1e-7, 1e-5, log=True, points=3),
    }
    runs = runs_of(Design("grid", 18, 0.1, factors), seed=0)
    levels = (("SSSSSS", "LSSSSS"), (20, 25, 30), (1e-7, 1e-6, 1e-5))
    for run, (struts, *numbers) in zip(runs, itertools.product(*levels), strict=True):
        row = run.parameters()
        assert row["struts"] == struts
        assert [row["roll_off_hz"], row["detector_noise_m"]] == pytest.approx(numbers, rel=1e-12)


def test_a_run_is_a_pure_function_of_design_seed_and_number_and_small():
    runs = runs_of(UNEVEN, 3)
    assert runs == runs_of(UNEVEN, 3)
    assert [run.number for run in runs] == list(range(17))
    assert len({run.seed for run in runs}) == 17
    assert not set(runs) & set(runs_of(UNEVEN, 4))
    assert len(pickle.dumps(runs[0])) < 1000


def test_the_default_design_varies_weights_failures_times_and_bench():
    varied = set(read_design(None).factors)
    assert {"struts", "failure_time_s", "known", "joint_weight_1"} < varied
    assert "secondary_weight_gamma" in varied
    assert len(varied & set(BENCH)) >= 6
    assert set(VARIED) - varied  # and not all


def test_the_design_of_the_demand_limit_has_the_configuration_of_the_table_among_its_runs():
    design = read_design(DEFAULT.with_name("sweep_demand_limit.toml"))
    assert (design.runs, design.duration_s) == (1472, TestbedConfig().duration_s)
    runs = runs_of(design, seed=3)
    # Of each: sound or locked, corrected or not.
    assert [run.bench for run in runs].count(CONFIGURATIONS["demand-limit"]) == 4
    assert {run.seed for run in runs} == {0}


# A row.


@pytest.mark.long
@pytest.mark.parametrize("anti_windup", [False, True])
def test_a_run_with_a_limit_on_the_demand_is_predicted_with_it(anti_windup):
    """Reached within the first second; without limit, or held otherwise, errors are others."""
    values = {"seed": 2, "struts": "LSSSSS", "known": False, "spiral_exponent": 0.5}
    limited = values | {"demand_limit_urad": 20.0, "anti_windup": anti_windup}
    row = row_of(sweep_run(0, 1.5, limited))
    other = row_of(sweep_run(0, 1.5, limited | {"anti_windup": not anti_windup}))
    free = row_of(sweep_run(0, 1.5, values))
    assert (row["demand_limit_urad"], free["demand_limit_urad"]) == (20.0, None)
    for name in RMS:
        assert row[name] == pytest.approx(row[f"predicted_{name}"], rel=0.01)
        assert abs(other[name] / row[name] - 1) > 0.05
        assert abs(free[name] / row[name] - 1) > 0.05


@pytest.mark.long
def test_a_row_is_what_the_run_and_the_linear_model_say():
    """With compensators designed anew."""
    bench = TestbedConfig(detector_noise_m=1e-6)
    values = {"seed": 7, "detector_noise_m": 1e-6, "weight": "W_e", "struts": "SSLSSS"}
    row = row_of(sweep_run(3, 0.3, values))
    goal = Goal(secondary_weight=(10, 10, 1, 1), locked_at={2: 0.0})
    lock = (Failure(2, "locked"),)
    rig = hexapod_rig(nominal_testbed(bench), goal, jacobian="analytic")
    path = bench.spiral_rad(0.3)
    simulated = rig.fly(rig.controller(), path, failures=lock, seed=7)
    np.testing.assert_allclose([row[name] for name in RMS], 1e6 * simulated.rms(), rtol=1e-12)
    assert row["t_x_peak_um"] == 1e6 * abs(secondary(simulated)[:, 1]).max()
    assert row["strut_input_peak_percent_3"] == 0.0
    noise = detector_noise_rad(bench, 7, len(path))
    found = rig.predict(path, failures=lock, told=False, noise=noise)
    np.testing.assert_allclose([row[name] for name in PREDICTED], 1e6 * found.rms, rtol=1e-9)
    assert (row["case"], row["status"], row["message"]) == (3, "exact", None)


@pytest.mark.parametrize(
    ("values", "status"),
    [
        ({}, "exact"),
        ({"struts": "SLLSLL"}, "least_squares"),
        ({"struts": "LLLLLL"}, "least_squares"),
        ({"struts": "BSSSSS", "failure_time_s": 0.02}, "exact"),
        ({"alpha_crossover_hz": 60.0}, "refused"),
        ({"control_period_s": 3e-4}, "refused"),
        # Half the struts bear what six did: so fast a loop is not closed on them.
        (
            {
                "struts": "LSLSLS",
                "alpha_crossover_hz": 10.0,
                "beta_crossover_hz": 7.7,
                "roll_off_hz": 60.0,
            },
            "unstable",
        ),
    ],
)
def test_a_run_that_ends_badly_is_a_row_with_its_status(values, status):
    row = row_of(sweep_run(0, 0.05, {"seed": 1, "settling_s": 0.05} | values))
    assert row["status"] == status
    assert (row["message"] is not None) == (row["alpha_rms_urad"] is None) == (status == "refused")


def test_a_diverging_run_is_a_row(monkeypatch):
    def diverge(*_args, **_options):
        raise SimulationDiverged(0.03, np.zeros(3))

    monkeypatch.setattr("fjh.rig.rig.simulate", diverge)
    row = row_of(sweep_run(0, 0.05, {"seed": 1}))
    assert (row["status"], row["diverged_at_s"]) == ("diverged", 0.03)
    assert "non-finite at t = 0.0300 s" in row["message"]


# The study.


@pytest.fixture(scope="module")
def rows(sweep_folder):
    """The runs beside the linear model."""
    return beside_model(pd.read_parquet(sweep_folder / "sweep.parquet"))


def test_the_rows_are_the_runs_in_order(sweep_folder, sweep_design, rows):
    runs = runs_of(read_design(sweep_design), 0)
    drawn = pd.DataFrame([run.parameters() for run in runs])
    names = [name for name in drawn if drawn[name].notna().all()]
    pd.testing.assert_frame_equal(rows[names], drawn[names], check_dtype=False)
    for case in (0, 29):
        _, beside = fly_again(sweep_folder, case)
        assert beside.same.all() and len(beside) > 20


def test_more_runs_than_a_design_may_have_are_not_flown_again(sweep_folder):
    summary = json.loads((sweep_folder / "sweep.json").read_text())
    summary["basis"]["design"]["runs"] = MOST_RUNS + 1
    with pytest.raises(WrongInput, match="at most 200000 runs"):
        again(summary)


def test_the_command_tells_what_is_in_its_dataset(sweep_folder, rows):
    summary = json.loads((sweep_folder / "sweep.json").read_text())
    assert summary["status"] == [{"status": "exact", "runs": 30}]
    told = rows[(rows.struts != "SSSSSS") & rows.known]
    [group] = [one for one in summary["groups"] if one["failures"] == 1 and one["told"]]
    assert group["runs"] == len(told)
    assert group["alpha_median_urad"] == pytest.approx(np.median(told.alpha_rms_urad), rel=1e-12)
    found = summary["prediction"][0]
    assert found["compared"] == rows.predicted_alpha_rms_urad.notna().sum() < 30
    assert [each["name"] for each in summary["influence"]] == ["roll_off_hz"]
    assert all(check.passed for check in checks(rows))


def test_an_interrupted_sweep_goes_on_to_the_same_bytes_and_a_finished_one_is_read(
    sweep_folder, sweep_design, scheduler, tmp_path, capsys
):
    def interrupt(done: int, total: int) -> None:
        if done == 9:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="9 of 30 runs are kept"):
        sweep(
            design=sweep_design,
            where=Where(scheduler=scheduler),
            folder=tmp_path,
            on_progress=interrupt,
        )
    words = ["sweep", "--design", str(sweep_design), "--out", str(tmp_path), "--quiet"]
    assert main(words) == 2
    assert main([*words, "--resume", "--seed", "5"]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main([*words, "--resume", "--scheduler", scheduler]) == 0
    assert not (tmp_path / UNFINISHED).exists()
    before, now = ((each / "sweep.parquet").read_bytes() for each in (sweep_folder, tmp_path))
    assert before == now
    assert main([*words, "--resume"]) == 0
    written = [(each / "sweep.json").read_text() for each in (sweep_folder, tmp_path)]
    assert written[0] == written[1]


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("beta_rms_urad", 9.0, r"run {case}: difference between the RMS error and the linear"),
        ("closure_residual_max_m", 1e-7, r"all runs: closure residual \[m\] is 1e-07"),
        ("closure_residual_max_m", np.nan, r"all runs: closure residual \[m\] is nan"),
    ],
)
def test_a_check_of_an_unsound_sweep_fails(rows, column, value, said):
    case = rows.case[rows.compared].iloc[-1]
    spoilt = beside_model(rows.assign(**{column: rows[column].where(rows.case != case, value)}))
    [failed] = [str(check) for check in checks(spoilt) if not check.passed]
    assert re.match(said.format(case=case), failed)
    assert prediction(spoilt).off[0] == (column == "beta_rms_urad")


@pytest.mark.parametrize("column", [PREDICTED[0], INPUT_PEAK[3]])
def test_runs_without_prediction_or_with_saturated_amplifiers_are_not_compared(rows, column):
    """And where none is left, nothing is checked, and the figure says so."""
    none = beside_model(rows.assign(**{column: np.nan if column in PREDICTED else 100.0}))
    assert not none.compared.any() and prediction(none).compared[0] == 0
    assert checks(none) == []
    assert "as predicted" not in figure(none, influence(none, [])).axes[0].get_title()


def test_errors_that_are_all_alike_depend_on_nothing(rows):
    """A limit that is never reached changes no error: there is no rank correlation."""
    varied = ["roll_off_hz", "settling_s"]  # the second is a constant
    found = influence(rows, varied).set_index("name")
    mean = rows.roll_off_hz.rank().corr(rows.alpha_rms_urad.rank())
    assert list(found.index) == ["roll_off_hz"] and found.alpha.iloc[0] == pytest.approx(mean)
    assert influence(rows.assign(beta_rms_urad=1.0), varied).empty
    assert influence(rows.head(2), varied).empty


@pytest.mark.parametrize("off", [0.005, 0.02, -0.02])
def test_points_off_the_line_are_hollow_and_the_titles_say_how_many_agree(off):
    predicted = np.array([0.5, 1.0, 2.0])
    rows = pd.DataFrame(dict.fromkeys((*RMS, *PREDICTED), predicted))
    rows.alpha_rms_urad = predicted * [1.0, 1.0 + off, 1.0]
    rows = beside_model(rows.assign(dac_step_urad=0.0, **dict.fromkeys(INPUT_PEAK, 1.0)))
    drawn = figure(rows, pd.DataFrame({"name": ["dac_bits"], "alpha": [-0.5], "beta": [-0.1]}))
    left, right = drawn.axes
    hollow = [
        x
        for line in left.lines
        if line.get_markerfacecolor() == "none" and "alpha" in str(line.get_label())
        for x in np.asarray(line.get_xdata())
    ]
    assert hollow == ([1.0] if abs(off) > 0.01 else [])
    agree = 3 - len(hollow)
    assert left.get_title().startswith(f"The error is as predicted in {agree} of 3 runs")
    assert right.get_title(loc="right").endswith("dac_bits, 0.50")
    assert faults(drawn) == []


# The page.

PAGE = (Path(__file__).parents[2] / "docs" / "sweep.md").read_text()


def first_cells(heading: str) -> set[str]:
    """Names in the first column of the table below a heading, `a_1` to `a_3` counted out."""
    table = PAGE[PAGE.index(heading) :].split("\n\n")[0]
    names = set()
    for cell in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE):
        names |= set(re.findall(r"`(\w+)`", cell))
        for stem, first, last in re.findall(r"`(\w+?)(\d)` to `\w+?(\d)`", cell):
            names |= {f"{stem}{k}" for k in range(int(first), int(last) + 1)}
    return names


def test_the_page_names_the_columns_of_the_file(sweep_folder, atlas_folder):
    columns, of_atlas = (
        set(pd.read_parquet(folder / f"{name}.parquet"))
        for folder, name in ((sweep_folder, "sweep"), (atlas_folder, "atlas"))
    )
    assert first_cells("| column | |") == columns
    assert of_atlas > columns
    assert {name for name in of_atlas - columns if f"`{name}`" not in PAGE} == set()


def test_the_page_names_what_can_be_varied(tmp_path):
    assert first_cells("| what can be varied | |") | set(BENCH) == set(VARIED)
    path = tmp_path / "mine.toml"
    path.write_text(re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[0])
    assert read_design(path).runs == 10000


def test_the_pages_lines_read_a_dataset(sweep_folder, monkeypatch, capsys):
    monkeypatch.chdir(sweep_folder)
    exec(re.findall(r"```python\n(import pandas.*?)```", PAGE, re.DOTALL)[0], {})
    assert "SLSSSS" in capsys.readouterr().out


def test_the_pages_arithmetic_is_right():
    cost_s = float(re.findall(r"all in \| ([\d.]+) s of one core", PAGE)[0])
    size = float(re.findall(r"row on disk \| (\d+) bytes", PAGE)[0])
    most = f"{MOST_RUNS:,} runs of 4 s are {MOST_RUNS * cost_s / 3600:.0f} core-hours"
    assert f"{most} and {MOST_RUNS * size / 1e9:.2f} GB" in PAGE
