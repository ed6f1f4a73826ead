"""Sweeps: runs that are a pure function, rows that are the run, and bytes that nobody can move."""

import contextlib
import itertools
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest

from experiments.app.cli import main
from experiments.rig.hexapod.columns import secondary
from experiments.rig.hexapod.machine import detector_noise_rad
from experiments.rig.hexapod.rig import hexapod_rig, nominal_testbed
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study import basis, cluster
from experiments.study.basis import basis_in
from experiments.study.dataset import Columns, Dataset
from experiments.study.resumable import UNFINISHED, published_before, run_missing
from experiments.study.study import Interrupted, Unsound, WrongInput
from experiments.study.where import Where
from experiments.sweep.campaign import SOURCES, sweep_of
from experiments.sweep.design import DEFAULT, Design, SweepRuns, grid, read_design
from experiments.sweep.results import checks, prediction
from experiments.sweep.row import SCHEMA, row_of
from experiments.sweep.sweep_run import BENCH, KINDS, Choice, Range, sweep_run
from experiments.table1 import CONFIGURATIONS
from ftc.goal import Goal
from sim import Failure, SimulationDiverged

SHORT = Choice("settling_s", (0.05,))
FEW = Design(
    "latin-hypercube",
    24,
    0.05,
    (
        SHORT,
        Choice("struts", ("SSSSSS", "LSSSSS", "SFSSSS")),
        Range("roll_off_hz", 20, 30, False, None),
    ),
)


def run_into(folder: Path, runs, scheduler: str | None, *, resume: bool = False, on_progress=None):
    return run_missing(
        folder,
        sweep_of(runs),
        where=Where(scheduler),
        resume=resume,
        on_progress=on_progress or (lambda done, total: None),
    )


def bytes_of(folder: Path) -> dict[str, bytes]:
    """The dataset, part by part."""
    return {path.name: path.read_bytes() for path in (folder / UNFINISHED).glob("part-*")}


@pytest.fixture(scope="session")
def undisturbed(scheduler, tmp_path_factory):
    """The few runs on two workers."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert run_into(folder, SweepRuns(FEW, 0), scheduler).took["runs"] == len(SweepRuns(FEW, 0))
    return bytes_of(folder)


# The design.

UNEVEN = Design(
    "latin-hypercube",
    17,
    0.1,
    (
        Range("roll_off_hz", 20.0, 30.0, False, None),
        Range("detector_noise_m", 1e-7, 1e-5, True, None),
        Range("dac_bits", 2, 18, False, None),
        Choice("known", (True, False)),
    ),
)


def test_a_hypercube_has_one_run_in_each_slice_of_each_range():
    runs = SweepRuns(UNEVEN, seed=3)
    rows = [runs[k].parameters() for k in range(len(runs))]
    for name, edges in (
        ("roll_off_hz", np.linspace(20, 30, 18)),
        ("detector_noise_m", np.geomspace(1e-7, 1e-5, 18)),
        ("dac_bits", np.arange(2, 20)),
    ):
        counts, _ = np.histogram([row[name] for row in rows], edges)
        assert counts.tolist() == [1] * 17, name
    assert abs(2 * sum(row["known"] for row in rows) - 17) == 1


def test_a_grid_is_the_full_product_its_last_factor_the_fastest():
    factors = [
        Choice("struts", ("SSSSSS", "LSSSSS")),
        Range("roll_off_hz", 20.0, 30.0, False, 3),
        Range("detector_noise_m", 1e-7, 1e-5, True, 3),
    ]
    runs = SweepRuns(grid(0.1, factors), seed=0)
    names = [factor.name for factor in factors]
    rows = [tuple(runs[k].parameters()[name] for name in names) for k in range(len(runs))]
    levels = (("SSSSSS", "LSSSSS"), (20, 25, 30), (1e-7, 1e-6, 1e-5))
    for row, expected in zip(rows, itertools.product(*levels), strict=True):
        assert row[0] == expected[0]
        assert row[1:] == pytest.approx(expected[1:], rel=1e-12)


def test_a_run_is_a_pure_function_of_design_seed_and_number_and_small():
    runs, again = SweepRuns(UNEVEN, 3), SweepRuns(UNEVEN, 3)
    order = np.random.default_rng(0).permutation(len(runs)).tolist()
    assert [again[k] for k in order] == [runs[k] for k in order]
    assert len({runs[k].seed for k in order}) == len(runs)
    other = SweepRuns(UNEVEN, 4)
    assert all(other[k] != runs[k] for k in order)
    assert len(pickle.dumps(runs[0])) < 1000


def test_the_default_design_varies_weights_failures_times_and_bench():
    varied = {factor.name for factor in read_design(None).factors}
    assert {
        "struts",
        "failure_time_s",
        "known",
        "joint_weight_1",
        "secondary_weight_gamma",
    } < varied
    assert len(varied & set(BENCH)) >= 6
    assert set(KINDS) - varied  # and not all


def test_the_design_of_the_demand_limit_has_the_configuration_of_the_table_among_its_runs():
    design = read_design(DEFAULT.with_name("demand_limit.toml"))
    assert (design.runs, design.duration_s) == (1472, TestbedConfig().duration_s)
    runs = SweepRuns(design, seed=3)
    benches = [runs[k].bench for k in range(len(runs))]
    # Of each: sound or locked, corrected or not.
    assert benches.count(CONFIGURATIONS["demand-limit"]) == 4
    assert {runs[k].seed for k in range(len(runs))} == {0}


@pytest.mark.parametrize("anti_windup", [False, True])
def test_a_run_with_a_limit_on_the_demand_is_predicted_with_it(anti_windup):
    """Reached within the first second; without limit, or held otherwise, errors are others."""
    values = {"seed": 2, "struts": "LSSSSS", "known": False, "spiral_exponent": 0.5}
    limited = values | {"demand_limit_urad": 20.0, "anti_windup": anti_windup}
    row = row_of(sweep_run(0, 1.5, limited))
    other = row_of(sweep_run(0, 1.5, limited | {"anti_windup": not anti_windup}))
    free = row_of(sweep_run(0, 1.5, values))
    assert (row["demand_limit_urad"], free["demand_limit_urad"]) == (20.0, None)
    for name in ("alpha_rms_urad", "beta_rms_urad"):
        assert row[name] == pytest.approx(row[f"predicted_{name}"], rel=0.01)
        assert abs(other[name] / row[name] - 1) > 0.05
        assert abs(free[name] / row[name] - 1) > 0.05


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("layout = ", "not TOML"),
        ("layout = 'random'", "'random'"),
        ("layout = 'grid'\nrun = 3", "no 'run'"),
        ("layout = 'grid'", r"\[vary\]"),
        ("layout = 'grid'\nruns = 3\nvary.seed = [1]", "runs must not be given for a grid"),
        ("layout = 'latin-hypercube'\nvary.seed = [1]", "runs must be a whole number"),
        ("layout = 'grid'\nduration_s = 99\nvary.seed = [1]", "duration_s .* 99"),
        ("layout = 'grid'\nvary.colour = ['red']", "no 'colour'"),
        ("layout = 'grid'\nvary.struts = ['SSSXSS']", "struts .* 'SSSXSS'"),
        ("layout = 'grid'\nvary.weight = ['W_z']", "weight .* 'W_z'"),
        ("layout = 'grid'\nvary.known = [1]", "known .* true or false"),
        ("layout = 'grid'\nvary.seed = [-1]", "seed .* -1"),
        ("layout = 'grid'\nvary.roll_off_hz = 0", "roll_off_hz .* from 0.01 to 10000, got 0"),
        ("layout = 'grid'\nvary.roll_off_hz = []", "at least one"),
        ("layout = 'grid'\nvary.roll_off_hz = {from = 1, to = 2}", "number of grid points"),
        ("layout = 'grid'\nvary.roll_off_hz = {from = 2, to = 1, points = 2}", "2.0 to 1.0"),
        ("layout = 'grid'\nvary.roll_off_hz = {from = 1, too = 2}", "no 'too'"),
        ("layout = 'grid'\nvary.struts = {from = 1, to = 2, points = 2}", "a list"),
        ("layout = 'grid'\nvary.dac_bits = {from = 2, to = 9, log = true, points = 2}", "log"),
        ("layout = 'latin-hypercube'\nruns = 2\nvary.seed = {from=1, to=2, points=2}", "points"),
    ],
)
def test_a_design_that_makes_no_sense_is_one_sentence(tmp_path, text, said):
    file = tmp_path / "design.toml"
    file.write_text(text)
    with pytest.raises(WrongInput, match=said) as wrong:
        read_design(file)
    assert str(file) in str(wrong.value)
    with pytest.raises(WrongInput, match="cannot be read"):
        read_design(tmp_path / "none.toml")


# A row.


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
    rms = row["alpha_rms_urad"], row["beta_rms_urad"]
    np.testing.assert_allclose(rms, 1e6 * simulated.rms(), rtol=1e-12)
    assert row["t_x_peak_um"] == 1e6 * abs(secondary(simulated)[:, 1]).max()
    assert row["strut_input_peak_percent_3"] == 0.0
    noise = detector_noise_rad(bench, 7, len(path))
    found = rig.predict(path, failures=lock, told=False, noise=noise)
    predicted = row["predicted_alpha_rms_urad"], row["predicted_beta_rms_urad"]
    np.testing.assert_allclose(predicted, 1e6 * found.rms, rtol=1e-9)
    assert row["case"] == 3
    assert row["status"] == "exact"
    assert set(row) <= set(SCHEMA.names)


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
    assert ("message" in row) == (status == "refused")
    assert ("alpha_rms_urad" in row) == (status != "refused")


def test_a_diverging_run_is_a_row(monkeypatch):
    def diverge(*_args, **_options):
        raise SimulationDiverged(0.03, np.zeros(3))

    monkeypatch.setattr("experiments.rig.rig.simulate", diverge)
    row = row_of(sweep_run(0, 0.05, {"seed": 1}))
    assert (row["status"], row["diverged_at_s"]) == ("diverged", 0.03)
    assert "non-finite at t = 0.0300 s" in row["message"]


# The bytes.


def test_the_rows_are_the_runs_in_order(undisturbed, tmp_path):
    (tmp_path / "part").write_bytes(undisturbed["part-000000.parquet"])
    table = pq.read_table(tmp_path / "part")
    assert table.schema.equals(SCHEMA)
    runs = SweepRuns(FEW, 0)
    for k in (0, 11, 23):
        [row] = table.slice(k, 1).to_pylist()
        expected = dict.fromkeys(SCHEMA.names) | row_of(runs[k])
        for name, value in row.items():
            # Here numpy has as many threads as it likes.
            number = isinstance(value, float)
            assert value == (pytest.approx(expected[name], rel=1e-9) if number else expected[name])


def test_neither_order_nor_interruption_changes_a_byte(scheduler, undisturbed, tmp_path):
    def interrupt(done, _total):
        if done == 9:
            raise KeyboardInterrupt

    runs = SweepRuns(FEW, 0)
    with pytest.raises(Interrupted, match="9 of 24 runs are kept"):
        run_into(tmp_path, runs, scheduler, on_progress=interrupt)
    with pytest.raises(WrongInput, match="--resume continues"):
        run_into(tmp_path, runs, scheduler)
    with pytest.raises(WrongInput, match="another seed"):
        run_into(tmp_path, SweepRuns(FEW, 1), scheduler, resume=True)
    with pytest.raises(WrongInput, match="another design"):
        run_into(tmp_path, SweepRuns(replace(FEW, duration_s=0.06), 0), scheduler, resume=True)
    assert run_into(tmp_path, runs, scheduler, resume=True).took["runs"] == 24 - 9
    assert bytes_of(tmp_path) == undisturbed
    assert run_into(tmp_path, runs, scheduler, resume=True).took["runs"] == 0


def test_one_worker_writes_the_bytes_of_two(undisturbed, tmp_path):
    runs, alone = SweepRuns(FEW, 0), Where(workers=1)
    quiet = {"on_progress": lambda done, total: None}
    run_missing(tmp_path, sweep_of(runs), where=alone, resume=False, **quiet)
    assert bytes_of(tmp_path) == undisturbed


def test_parts_are_written_when_they_are_whole_whatever_comes_first(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.study.dataset.PART", 4)
    rows = [sweep_run(k, 0.1, {"seed": k}).parameters() | {"status": "exact"} for k in range(10)]
    datasets = {}
    for name, order in (("forth", range(10)), ("back", range(9, -1, -1))):
        dataset = Dataset(tmp_path / name, 10, {}, SCHEMA)
        for k in order:
            assert k in dataset.missing()
            dataset.add(rows[k])
            dataset.keep()
            dataset = Dataset(tmp_path / name, 10, {}, SCHEMA)  # all that is known is on disk
            assert k not in dataset.missing()
        datasets[name] = [path.read_bytes() for path in dataset.files()]
    assert datasets["forth"] == datasets["back"]
    assert len(datasets["forth"]) == 3


def test_another_seed_is_another_sweep(scheduler, undisturbed, tmp_path):
    run_into(tmp_path, SweepRuns(replace(FEW, runs=3), 1), scheduler)
    found = pq.read_table(tmp_path / UNFINISHED)["alpha_rms_urad"].to_pylist()
    (tmp_path / "part").write_bytes(undisturbed["part-000000.parquet"])
    assert not set(found) & set(pq.read_table(tmp_path / "part")["alpha_rms_urad"].to_pylist())


# The cluster.


def test_a_killed_worker_loses_nothing_that_was_received(
    crew, scheduler, undisturbed, tmp_path, monkeypatch
):
    """Its runs go to another; those received before are not run again: the scheduler's own log."""
    received, log = [], crew.cluster.scheduler.transition_log
    plain = cluster.finished_rows
    log.clear()

    def kill_in_the_middle(client, campaign, numbers):
        for finished in plain(client, campaign, numbers):
            received.append(finished["case"])
            if len(received) == 6:
                os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)
            yield finished

    monkeypatch.setattr(cluster, "finished_rows", kill_in_the_middle)
    run_into(tmp_path, SweepRuns(FEW, 0), scheduler)
    assert bytes_of(tmp_path) == undisturbed
    assert sorted(received) == list(range(24))
    moves = [(key, start, end) for key, start, end, *_ in log]
    done = Counter(key.rpartition("-")[2] for key, *move in moves if move == FINISHED)
    assert [done[str(number)] for number in received[:6]] == [1] * 6
    # It was in the middle of something, or held what nobody had fetched.
    assert any(end == "released" for _, start, end in moves if start == "processing") or (
        max(done.values()) > 1
    )


FINISHED = ["processing", "memory"]


@pytest.mark.parametrize("on", ["a scheduler", "this machine"])
def test_a_bug_ends_the_sweep_with_one_sentence_and_keeps_what_is_done(scheduler, tmp_path, on):
    class Broken(SweepRuns):
        def __getitem__(self, number):
            run = super().__getitem__(number)
            return replace(run, weight=None, bench=None) if number == 20 else run

    with pytest.raises(Unsound, match=r"run 20 failed: \w+Error in \w+\.py, line \d+: "):
        run_into(tmp_path, Broken(FEW, 0), scheduler if on == "a scheduler" else None)
    assert pq.read_table(tmp_path / UNFINISHED / "_rest.parquet").num_rows > 0


def test_a_worker_of_other_code_is_refused(scheduler, tmp_path, monkeypatch):
    """At the start by what it says of itself; if it joins later, by its first run."""
    monkeypatch.setattr(cluster, "digest", lambda identity: "other")
    with pytest.raises(Unsound, match="ForeignWorker"):
        run_into(tmp_path / "later", SweepRuns(FEW, 0), scheduler)
    ours, worker = basis.identity(SOURCES), "tcp://there:1"
    basis.check_workers(ours, {worker: dict(ours)})
    for said, why in (
        (ours | {"version of mujoco": "3.0"}, "another version of mujoco"),
        (ours | {"code_sha256": "0"}, "another code_sha256"),
        (ModuleNotFoundError("No module named 'experiments'"), "cannot run this package"),
    ):
        with pytest.raises(WrongInput, match=f"{worker} (has|cannot).*") as wrong:
            basis.check_workers(ours, {worker: said})
        assert why in str(wrong.value)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere"])
def test_a_scheduler_that_does_not_answer_is_wrong_input(capsys, tmp_path, address, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWERS_IN_S", 0.5)
    out = tmp_path / "out"
    assert main(["sweep", "--quick", "--scheduler", address, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"fjh: --scheduler {address} does not answer")
    assert error.count("\n") == 1
    assert not out.exists()


def test_workers_belong_to_this_machine_or_to_a_scheduler(capsys, tmp_path):
    words = ["atlas", "--scheduler", "tcp://127.0.0.1:1", "--workers", "2"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    assert "--workers" in capsys.readouterr().err


# The command.


def test_the_command_tells_what_is_in_its_dataset(sweep_folder):
    summary = json.loads((sweep_folder / "sweep.json").read_text())
    table = pq.read_table(sweep_folder / "sweep.parquet").to_pydict()
    assert summary["status"] == {"exact": 30}
    told = [
        failures and known
        for failures, known in zip(
            (s != "SSSSSS" for s in table["struts"]), table["known"], strict=True
        )
    ]
    group = next(one for one in summary["groups"] if one["told"] is True)
    assert group["runs"] == sum(told)
    alpha = [rms for rms, mine in zip(table["alpha_rms_urad"], told, strict=True) if mine]
    assert group["alpha_median_urad"] == pytest.approx(np.median(alpha), rel=1e-12)
    covered = [rms for rms in table["predicted_alpha_rms_urad"] if rms is not None]
    assert summary["prediction"]["compared"] == len(covered) < 30
    assert set(summary["influence"]) == {"roll_off_hz"}
    assert all(check.passed for check in checks(summary))


@pytest.mark.long
def test_errors_that_are_all_alike_depend_on_nothing(tmp_path, scheduler):
    """A limit that is never reached changes no error: there is no rank correlation."""
    design = tmp_path / "design.toml"
    limits = "vary.demand_limit_urad = {from = 90, to = 110, points = 3}"
    design.write_text(f"layout = 'grid'\nduration_s = 0.05\nvary.seed = 0\n{limits}")
    words = ["sweep", "--design", str(design), "--scheduler", scheduler, "--out", str(tmp_path)]
    assert main(words) == 0
    assert json.loads((tmp_path / "sweep.json").read_text())["influence"] == {}


def test_a_finished_sweep_is_found_again_and_another_refused(sweep_folder, sweep_design, capsys):
    words = ["sweep", "--resume", "--design", str(sweep_design), "--out", str(sweep_folder)]
    stamps = {path: path.stat().st_mtime_ns for path in sweep_folder.iterdir()}
    assert main([*words, "--json"]) == 0
    assert capsys.readouterr().out == (sweep_folder / "sweep.json").read_text()
    assert main([*words, "--seed", "5"]) == 2
    assert "another seed" in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in sweep_folder.iterdir()} == stamps
    assert published_before(sweep_folder / "none", "sweep", sweep_of(SweepRuns(FEW, 0))) is None


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (
            {"largest_over_allowed": 1.25, "worst_case": 7},
            "run 7: difference between the RMS error and the linear model's, .* is 1.25, "
            "expected below",
        ),
        ({"closure_residual_max_m": 1e-7}, r"all runs: closure residual \[m\] is 1e-07"),
    ],
)
def test_a_check_of_an_unsound_sweep_fails(sweep_folder, spoil, said):
    summary = json.loads((sweep_folder / "sweep.json").read_text())
    summary["prediction"] |= spoil
    [failed] = [check for check in checks(summary) if not check.passed]
    assert re.match(said, str(failed))


def test_a_run_off_its_prediction_is_counted(sweep_folder, tmp_path):
    table = pq.read_table(sweep_folder / "sweep.parquet")
    at = table.schema.names.index("beta_rms_urad")
    spoilt = [1.1 * rms + 0.1 for rms in table["beta_rms_urad"].to_pylist()]
    pq.write_table(table.set_column(at, "beta_rms_urad", [spoilt]), tmp_path / "spoilt.parquet")
    found = prediction(Columns([tmp_path / "spoilt.parquet"]))
    assert 0 < found["off"] == found["compared"]


def left(process: subprocess.Popen) -> list[psutil.Process]:
    """Worker processes of a sweep."""
    found = []
    for child in psutil.Process(process.pid).children():
        with contextlib.suppress(psutil.Error):
            if any("spawn_main" in word for word in child.cmdline()):
                found.append(child)
    return found


@pytest.mark.long
def test_ctrl_c_is_clean_even_while_a_worker_is_starting_again(tmp_path, sweep_design):
    out, scratch = tmp_path / "out", tmp_path / "scratch"
    scratch.mkdir()
    design_file = tmp_path / "long.toml"
    design_file.write_text(sweep_design.read_text().replace("runs = 30", "runs = 300"))
    words = ["sweep", "--workers", "1", "--design", str(design_file), "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "experiments", *words],
        cwd=Path(__file__).parents[2],
        env=os.environ | {"TMPDIR": str(scratch)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not left(process) and time.monotonic() < deadline:
        time.sleep(0.05)
    [worker] = left(process)
    time.sleep(5)
    worker.kill()
    while left(process) in ([], [worker]) and time.monotonic() < deadline:
        time.sleep(0.02)
    [reborn] = left(process)
    time.sleep(0.3)
    os.killpg(process.pid, signal.SIGINT)
    printed, error = process.communicate(timeout=30)
    assert process.returncode == 130
    kept = re.fullmatch(
        r"fjh: interrupted: (\d+) of 300 runs are kept; --resume continues\n", error
    )
    assert kept
    assert printed == ""
    assert not psutil.pid_exists(reborn.pid)
    assert list(scratch.iterdir()) == []
    done = int(kept.group(1))
    of = basis_in(out / UNFINISHED)
    assert (of is None) == (done == 0)  # as on a machine that is too busy to finish one
    assert (
        of is None
        or len(list(Dataset(out / UNFINISHED, 300, of, SCHEMA).missing())) == 300 - done > 0
    )


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
    columns = set(pq.read_schema(sweep_folder / "sweep.parquet").names)
    assert first_cells("| column | |") == columns
    further = set(pq.read_schema(atlas_folder / "atlas.parquet").names) - columns
    assert further
    assert {name for name in further if f"`{name}`" not in PAGE} == set()


def test_the_page_names_what_can_be_varied():
    assert first_cells("| what can be varied | |") | set(BENCH) == set(KINDS)


def test_the_pages_lines_read_a_dataset(sweep_folder, monkeypatch, capsys):
    monkeypatch.chdir(sweep_folder)
    exec(re.findall(r"```python\n(import pyarrow.*?)```", PAGE, re.DOTALL)[0], {})
    assert "SLSSSS" in capsys.readouterr().out


def test_the_pages_design_is_one(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)[0])
    assert read_design(path).runs == 10000
    assert {factor.name for factor in read_design(path).factors} >= {"struts", "dac_bits"}


def test_the_pages_arithmetic_is_right():
    """Hours and saturation from the measured cost and throughput on the page."""
    cost_s = float(re.findall(r"all in \| ([\d.]+) s of one core", PAGE)[0])
    most = float(re.findall(r"scheduler and client \| (\d+) runs/s", PAGE)[0])
    size = float(re.findall(r"row on disk \| (\d+) bytes", PAGE)[0])
    assert f"{1e6 * cost_s / 3600:.0f} core-hours" in PAGE
    assert f"{1e6 * size / 1e9:.2f} GB" in PAGE
    rows = re.findall(r"^\| (\d+) \| ([\d.]+) \| ([\d.]+) h \|$", PAGE, re.MULTILINE)
    assert len(rows) == 4
    for cores, rate, hours in rows:
        expected = min(float(cores) / cost_s, most)
        assert float(rate) == pytest.approx(expected, rel=0.03)
        assert float(hours) == pytest.approx(1e6 / expected / 3600, rel=0.05)
    saturated = float(re.findall(r"saturates at (\d+) cores", PAGE)[0])
    assert saturated == pytest.approx(most * cost_s, rel=0.02)
