"""The benchmark's arithmetic and its honesty; times are made up, none is asserted."""

import numpy as np
import pandas as pd
import pytest

from benchmarks import table
from benchmarks.contender import agree

ANSWERS = {name: np.array([[1.0, 2.0], [3.0, 4.0]]) for name in ("ours", "theirs", "lapack")}
STABLE = table.RATIOS[table.RATIOS["stable"]]


@pytest.mark.parametrize("wrong", [1.001, np.nan])
def test_one_who_answers_otherwise_is_named_and_nobody_else(wrong):
    agree(ANSWERS, 1e-9)
    spoilt = ANSWERS | {"theirs": ANSWERS["theirs"] * [1.0, wrong]}
    with pytest.raises(ValueError, match=r"more than 1e-09: theirs by \S+$"):
        agree(spoilt, 1e-9)


def test_a_time_is_the_least_of_all_turns_of_one_unit():
    """Of pytest-benchmark's JSON of calls with ten units each."""
    told = {"question": "problem_1", "name": "daqp", "units": 10}
    turns = [{"extra_info": told, "stats": {"min": 1e-5 * one}} for one in (9.0, 3.0, 4.0)]
    us = table.times_us({"benchmarks": turns})
    assert us.to_dict() == pytest.approx({("problem_1", "daqp"): 3.0})


def test_only_what_hardly_scatters_fails_beyond_three_times_its_bound():
    def failing(ratio: float | pd.Series) -> set[str]:
        rows = table.RATIOS.assign(ratio=ratio)
        return {line.partition(":")[0] for line in table.exceeding(rows)}

    assert failing(1e3) == {*STABLE["compared"]}
    assert failing(2.9 * table.RATIOS["bound"]) == set()
