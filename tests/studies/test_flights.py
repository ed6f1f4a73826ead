"""Flights of `fjh recover`: pure functions of a number, rows that come back, and no flight lost."""

import math
import pickle
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.app.cli import main
from experiments.recover import row as rows
from experiments.recover import runs
from experiments.recover.campaign import flights_of
from experiments.recover.flight import MISMATCHES, STRUCK, exact_rig
from experiments.recover.plan import QUICK, Counts, FlightPlan, for_hours
from experiments.recover.rates import per_hour, quantiles, rate
from experiments.recover.recovery import Identification, fault_unaware, struck, supervised
from experiments.recover.row import SCHEMA, row_of
from experiments.study import parquet
from experiments.study.campaign import table_of
from experiments.study.resumable import UNFINISHED, run_missing
from experiments.study.study import Interrupted, WrongInput
from experiments.study.where import Where
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault, FaultKind
from sim import Failure, SimulationDiverged
from tests.profiles import examples

WHOLE = for_hours(2.0)
SHORT = Counts(exact=0, all=0, alone=0, mismatches=(), size=0, sound=10, sound_s=0.1, pairs=0)
"""Ten flights of a tenth of a second, without failures."""


# The plan.


def test_a_flight_is_a_pure_function_of_counts_seed_and_number_and_small():
    plan, again, other = FlightPlan(WHOLE, 3), FlightPlan(WHOLE, 3), FlightPlan(WHOLE, 4)
    numbers = np.random.default_rng(0).permutation(len(plan))[:200].tolist()
    flights = [plan[k] for k in numbers]
    assert [again[k] for k in reversed(numbers)] == flights[::-1]
    assert all(other[k] != flight for k, flight in zip(numbers, flights, strict=True))
    assert [flight.number for flight in flights] == numbers
    assert len(pickle.dumps(flights[0])) < 1500


def test_every_block_has_its_flights_and_the_sizes_are_those_of_its_mismatch():
    """And each of them is one that a plant can have: `scaled` refuses all others."""
    plan, at = FlightPlan(WHOLE, 0), 0
    for block in plan.blocks:
        for k in (0, block.count - 1):
            flight = plan[at + k]
            found = flight.sort, flight.mismatch, flight.factor, flight.draw
            assert found == (block.sort, block.mismatch, block.factor, k)
        MISMATCHES[block.mismatch].scaled(block.factor)
        at += block.count
    assert at == len(plan)
    assert {block.mismatch for block in plan.blocks if block.sort == "failure"} == set(MISMATCHES)


@pytest.mark.parametrize("hours", [1e-3, 0.25, 1.0, 10.0])
def test_so_many_hours_are_flown_and_not_a_flight_more(hours):
    counts = for_hours(hours)
    flown_s = counts.sound * counts.sound_s
    assert 0 <= flown_s - 3600 * hours < counts.sound_s


@pytest.mark.parametrize("hours", [0.0, -1.0, math.nan, math.inf])
def test_hours_that_cannot_be_flown_are_refused(hours):
    with pytest.raises(WrongInput, match="--hours must be positive and finite"):
        for_hours(hours)


def test_a_study_goes_on_with_more_hours_or_fewer():
    """What was flown before them is the same, and so is what the dataset depends on."""
    short, long = FlightPlan(for_hours(0.1), 3), FlightPlan(for_hours(0.2), 3)
    assert len(short) < len(long)
    assert all(short[k] == long[k] for k in range(len(short)))
    assert flights_of(short).basis == flights_of(long).basis
    sized = FlightPlan(replace(for_hours(0.1), size=7), 3)
    assert flights_of(short).basis != flights_of(sized).basis


def test_a_failure_is_the_same_whatever_the_plant_and_all_are_drawn():
    """So that what a mismatch costs is not the luck of the draw."""
    plan = FlightPlan(WHOLE, 7)
    flights = [plan[k] for k in range(len(plan)) if plan[k].sort in ("failure", "size")]
    by_draw: dict[int, set] = {}
    for flight in flights:
        drawn = replace(flight, number=0, sort="size", mismatch="exact", factor=1.0)
        by_draw.setdefault(flight.draw, set()).add(drawn)
    assert {len(same) for same in by_draw.values()} == {1}
    drawn = [plan[k].fault for k in range(18)]
    assert len({(fault.actuator, fault.kind) for fault in drawn}) == 18
    for flight in flights[:18]:
        assert struck(exact_rig(), flight) == (STRUCK,)
        assert flight.begin_s > 0 and flight.begin_s + flight.duration_s <= 16.0


def test_second_failures_are_of_another_strut_some_time_later():
    plan = FlightPlan(WHOLE, 7)
    pairs = [plan[k] for k in range(len(plan)) if plan[k].sort == "pair"]
    assert len(pairs) >= 20
    for flight in pairs:
        first, second = flight.failures
        assert first.actuator != second.actuator
        assert 0.1 <= second.time_s - first.time_s <= 2.0
        assert flight.begin_s + flight.duration_s == pytest.approx(second.time_s + 2.0)


def test_a_quick_study_has_every_sort_of_flight():
    plan = FlightPlan(QUICK, 0)
    assert {plan[k].sort for k in range(len(plan))} == {"failure", "size", "sound", "pair"}
    assert {plan[k].fault.kind for k in range(1, 4)} == {"locked", "free", "weak"}


# A row.


def test_a_flight_repeats_to_the_bit_and_its_row_has_only_columns_of_the_schema():
    flight = FlightPlan(SHORT, 5)[3]
    row = row_of(flight)
    assert row_of(flight) == row
    assert row["status"] == "flown" and row["case"] == 3
    assert set(row) <= set(SCHEMA.names)
    assert (
        row_of(FlightPlan(SHORT, 5)[4])["closure_residual_max_m"] != row["closure_residual_max_m"]
    )


VALUES = {
    pa.int64(): st.integers(-(2**63), 2**63 - 1),
    pa.float64(): st.floats(allow_nan=False),
    pa.bool_(): st.booleans(),
    pa.string(): st.text(max_size=9),
}


@examples(15)
@given(st.fixed_dictionaries({each.name: st.none() | VALUES[each.type] for each in SCHEMA}))
def test_a_row_comes_back_from_its_file_as_it_was(tmp_path_factory, row):
    path = tmp_path_factory.mktemp("rows") / "row.parquet"
    row |= {"case": row["case"] or 0}
    parquet.write(path, [table_of([row], SCHEMA)])
    assert parquet.read(path).to_pylist() == [row]


def test_a_flight_that_diverges_is_a_row(monkeypatch):
    def diverge(*_arguments):
        raise SimulationDiverged(0.03, np.zeros(3))

    monkeypatch.setattr(rows, "supervised", diverge)
    row = row_of(FlightPlan(SHORT, 0)[0])
    assert row["status"] == "diverged" and "non-finite" in row["message"]


@pytest.mark.long
@pytest.mark.parametrize("draw", [3, 288])
def test_a_lock_is_not_taken_for_the_opposite_strut_in_half_a_period_of_the_dither(draw):
    """On plants of the study whose hysteresis and dampers make them alike at first."""
    plan = FlightPlan(replace(SHORT, all=draw + 1, sound=0), 0)
    flight = plan[draw]
    found = supervised(flight.rig(), flight)[1]
    assert {each.fault.actuator for each in found.diagnoses} == {flight.fault.actuator}


@pytest.mark.long
def test_a_lock_is_named_in_a_floor_whose_spectrum_is_known():
    """With an autoregression of order 1 instead of 10 its alarm would stay unexplained."""
    flight = FlightPlan(replace(SHORT, all=28, sound=0), 1)[27]
    found = supervised(flight.rig(), flight)[1]
    assert {each.fault.actuator for each in found.diagnoses} == {flight.fault.actuator}
    assert not found.alarm_before


@pytest.mark.long
def test_a_plant_is_learned_long_enough_to_raise_no_alarm_thereafter():
    """After 0.2 s instead of 0.8 s of learning a sound strut would be named."""
    flight = FlightPlan(replace(SHORT, sound=2, sound_s=4.0), 1)[1]
    assert supervised(flight.rig(), flight)[1].alarm_ticks == ()


def test_without_an_alarm_the_supervised_controller_sends_the_commands_of_the_unaware_one():
    flight = FlightPlan(SHORT, 0)[0]
    run, found = supervised(exact_rig(), flight)
    unaware = fault_unaware(exact_rig(), flight)
    assert found.alarm_ticks == ()
    np.testing.assert_array_equal(run.inputs, unaware.inputs)


@pytest.mark.parametrize("moved", [0.0, 1e-12])
def test_a_command_that_an_alarm_changes_is_noticed_however_little(monkeypatch, moved):
    flight = FlightPlan(SHORT, 0)[0]
    run, found = supervised(flight.rig(), flight)
    other = replace(run, inputs=run.inputs + moved)
    alarmed = other, replace(found, alarm_ticks=(5,))
    monkeypatch.setattr(rows, "supervised", lambda *_: alarmed)
    row = row_of(flight)
    assert row["alarms"] == 1
    assert row["commands_changed"] == (moved > 0)


# What a diagnosis is worth.

PAIR = (Failure(0, "locked", 2.0), Failure(4, "free", 3.0))


def diagnosed(*named: tuple[int, FaultKind, int]) -> tuple[Diagnosis, ...]:
    """Diagnoses of struts and kinds at ticks."""
    told = [replace(Diagnosis.told(Fault(strut, kind)), tick=at) for strut, kind, at in named]
    return tuple(told)


def identification(
    failures: tuple[Failure, ...], *named: tuple[int, FaultKind, int]
) -> Identification:
    every = diagnosed(*named)
    standing = tuple({each.fault.actuator: each for each in every}.values())
    struck = tuple(round(1000 * each.time_s) for each in failures)
    alarms = tuple(each.tick for each in every)
    return Identification(failures, struck, alarms, every, (), standing, False, False, False, 0.0)


@pytest.mark.parametrize(
    ("named", "strut_right", "sound_named", "all_right"),
    [
        ([(0, "locked", 2010), (4, "free", 3010)], True, False, True),
        ([(0, "locked", 2010)], True, False, False),
        ([(0, "free", 2010), (4, "free", 3010)], True, False, False),
        ([(4, "free", 2010), (0, "locked", 2020), (4, "free", 3010)], False, True, True),
        ([(0, "locked", 1999), (0, "locked", 2010), (4, "free", 3010)], False, True, True),
        ([(0, "locked", 2010), (4, "free", 3010), (5, "weak", 3500)], True, True, False),
        ([], False, False, False),
    ],
)
def test_a_strut_is_rightly_named_only_after_it_has_failed(
    named, strut_right, sound_named, all_right
):
    found = identification(PAIR, *named)
    assert (found.strut_right, found.sound_named) == (strut_right, sound_named)
    assert found.all_right == all_right


def test_without_a_failure_every_alarm_is_false_and_every_strut_sound():
    found = identification((), (2, "weak", 40))
    assert found.alarm_before and found.sound_named
    assert not identification(()).alarm_before


def test_rates_have_the_bounds_of_the_textbooks():
    """No alarm in T hours: below 3 / T at 95 %, the rule of three; 306 of 306: from 98.8 % on."""
    assert per_hour(0, 10.0)["high_per_hour_95"] == pytest.approx(0.2996, abs=1e-3)
    assert per_hour(0, 10.0)["low_per_hour_95"] == 0.0
    assert per_hour(3, 10.0)["low_per_hour_95"] < 0.3 < per_hour(3, 10.0)["high_per_hour_95"]
    found = rate([True] * 306)
    assert found["low"] == pytest.approx(0.025 ** (1 / 306))
    assert rate([])["rate"] is None and quantiles([]) is None
    assert quantiles([1.0, 2.0, 9.0]) == pytest.approx(
        {"median": 2.0, "percentile_95": 8.3, "largest": 9.0}
    )


# Interrupted and resumed.


def cheap(flight):
    """A row as a flight would give, at no cost."""
    return flight.parameters() | {"status": "flown", "alarms": flight.number % 3}


@pytest.fixture
def here(monkeypatch):
    """Numbers of flights, done in this process, at no cost, in parts of four."""
    done: list[int] = []

    def in_this_process(campaign, numbers, _where):
        for number in numbers:
            done.append(number)
            yield cheap(campaign.runs[number])

    monkeypatch.setattr("experiments.study.dataset.PART", 4)
    monkeypatch.setattr(
        "experiments.study.resumable.rows_of", lambda *of: nullcontext(in_this_process(*of))
    )
    return done


HERE = Where()


def flown(folder: Path, *, resume: bool, seed: int = 0, where: Where = HERE, stop_at: int = 99):
    def interrupt(done: int, _total: int) -> None:
        if done == stop_at:
            raise KeyboardInterrupt

    campaign = flights_of(FlightPlan(SHORT, seed))
    return run_missing(folder, campaign, where=where, resume=resume, on_progress=interrupt)


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / UNFINISHED).glob("part-*")}


@pytest.mark.parametrize("stop_at", [0, 3, 4, 9])
def test_a_resumed_study_has_the_bytes_of_an_uninterrupted_one(here, tmp_path, stop_at):
    assert flown(tmp_path / "whole", resume=False).took["runs"] == 10
    folder = tmp_path / "resumed"
    if stop_at:
        with pytest.raises(Interrupted, match=f"{stop_at} of 10 runs are kept; --resume continues"):
            flown(folder, resume=False, stop_at=stop_at)
        with pytest.raises(WrongInput, match="--resume continues it"):
            flown(folder, resume=False)
        with pytest.raises(WrongInput, match="another seed"):
            flown(folder, resume=True, seed=1)
    here.clear()
    assert flown(folder, resume=True).took["runs"] == 10 - stop_at
    assert here == list(range(stop_at, 10))
    assert bytes_of(folder) == bytes_of(tmp_path / "whole")


@pytest.mark.long
def test_flights_on_workers_are_interrupted_and_resumed_to_the_bit(scheduler, tmp_path):
    where = Where(scheduler)
    flown(tmp_path / "whole", resume=False, where=where)
    with pytest.raises(Interrupted, match="4 of 10"):
        flown(tmp_path / "resumed", resume=False, where=where, stop_at=4)
    assert flown(tmp_path / "resumed", resume=True, where=where).took["runs"] == 6
    assert bytes_of(tmp_path / "resumed") == bytes_of(tmp_path / "whole")
    [part] = (tmp_path / "whole" / UNFINISHED).glob("part-*")
    assert pq.read_table(part).to_pylist()[7] == dict.fromkeys(SCHEMA.names) | row_of(
        FlightPlan(SHORT, 0)[7]
    )


def test_ctrl_c_beside_the_flights_keeps_all_of_them(here, monkeypatch, tmp_path, capsys):
    def interrupt(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(runs, "QUICK", SHORT)
    monkeypatch.setattr(runs, "in_parallel", interrupt)
    for words in ([], ["--resume"]):
        assert main(["recover", "--quick", "--quiet", *words, "--out", str(tmp_path)]) == 130
        said = capsys.readouterr().err
        assert said == "fjh: interrupted: all 10 runs are kept; --resume continues\n"
        assert len(bytes_of(tmp_path)) == 3
    assert main(["recover", "--quick", "--quiet", "--out", str(tmp_path)]) == 2
    assert "holds an unfinished study" in capsys.readouterr().err
