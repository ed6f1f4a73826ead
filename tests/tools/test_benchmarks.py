"""The benchmark's arithmetic and its honesty; times are made up, none is asserted."""

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks import table
from benchmarks.contender import Contender, question
from tests.pages import assert_prints, assert_says

PAGE = (Path(__file__).parents[2] / "docs" / "performance.md").read_text()
ANSWERS = {name: np.array([[1.0, 2.0], [3.0, 4.0]]) for name in ("ours", "theirs", "lapack")}


def run_of(us: dict[str, list[float]]) -> dict:
    """pytest-benchmark's JSON of times of calls with ten units each, by turns."""
    return {
        "benchmarks": [
            {"extra_info": {"name": name, "units": 10}, "stats": {"median": 1e-5 * one}}
            for name, turns in us.items()
            for one in turns
        ]
    }


@pytest.mark.parametrize("wrong", [1.001, np.nan])
def test_one_who_answers_otherwise_is_named_and_nobody_else(wrong):
    contenders = [Contender(name, max) for name in ANSWERS]
    question(contenders, ANSWERS, 1e-9).check()
    spoilt = ANSWERS | {"theirs": ANSWERS["theirs"] * [1.0, wrong]}
    with pytest.raises(ValueError, match=r"more than 1e-09: ") as refused:
        question(contenders, spoilt, 1e-9).check()
    named = {name for name in ANSWERS if f"{name} by" in str(refused.value)}
    assert named == ({"theirs"} if np.isfinite(wrong) else {*ANSWERS})


def test_a_time_is_the_median_of_the_turns_of_one_unit():
    assert table.times_us(run_of({"daqp": [3.0, 9.0, 4.0]})) == pytest.approx({"daqp": 4.0})


def test_only_what_hardly_scatters_fails_beyond_three_times_its_bound():
    us = {each.under: 1.0 for each in table.RATIOS} | {each.over: 1e-3 for each in table.RATIOS}
    assert table.exceeding(us) == []
    slow = us | {each.over: 1e3 for each in table.RATIOS}
    failing = {line.partition(":")[0] for line in table.exceeding(slow)}
    assert failing == {each.words for each in table.RATIOS if each.stable}
    one = next(each for each in table.RATIOS if each.stable)
    assert table.exceeding(us | {one.over: 2.9 * (one.bound or 0.0)}) == []


def test_the_table_has_what_was_timed_and_the_figure_too():
    us = {"prioritized": 12.0, "daqp": 4.0}
    [row] = table.table(us).splitlines()[2:]
    assert row == "| one Problem 1 / daqp, matrices given | 12 | 4 | 3 | 1.5 | 0.8 |"
    [axes] = table.figure(us).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == [row.split(" | ")[0][2:]]


def test_the_page_has_every_ratio_and_counts_the_bounds_that_are_met():
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.splitlines()]
    printed = {cells[0]: cells for cells in rows if len(cells) == 6 and cells[0] != "compared"}
    assert {each.words for each in table.RATIOS} == printed.keys() - {"---"}
    bounded = [printed[each.words] for each in table.RATIOS if each.bound]
    met = sum(float(cells[3]) < float(cells[4]) for cells in bounded)
    assert_says(PAGE, f"{met} of {len(bounded)} bounds are met.")


def test_the_tick_on_the_page_runs_and_prints_what_it_says_by_both_of_its_ways(capsys):
    """With a rank in doubt at every tick, too."""
    (code,), (printed,) = (
        re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL) for kind in ("python", "text")
    )
    for way in (code, code.replace("if qvel is None", "if True")):
        exec(way, {})
        assert_prints(capsys.readouterr().out, printed)
