"""Tests of the benchmark's arithmetic and of its agreement check, on made-up times."""

import numpy as np
import pandas as pd
import pytest

from benchmarks import table
from benchmarks.candidate import check_agreement

SOLUTIONS = {name: np.array([[1.0, 2.0], [3.0, 4.0]]) for name in ("ours", "mink", "lapack")}
STABLE = table.RATIOS[table.RATIOS["stable"]]


@pytest.mark.parametrize("factor", [1.001, np.nan])
def test_only_a_candidate_with_another_solution_is_reported(factor):
    check_agreement(SOLUTIONS, 1e-9)
    altered = SOLUTIONS | {"mink": SOLUTIONS["mink"] * [1.0, factor]}
    with pytest.raises(ValueError, match=r"more than 1e-09: mink by \S+$"):
        check_agreement(altered, 1e-9)


def test_a_time_is_the_least_of_all_turns_divided_by_the_units():
    """The JSON of pytest-benchmark has calls of ten units each."""
    labels = {"question": "problem_1", "name": "daqp", "units": 10}
    turns = [{"extra_info": labels, "stats": {"min": 1e-5 * time}} for time in (9.0, 3.0, 4.0)]
    us = table.times_us({"benchmarks": turns})
    assert us.to_dict() == pytest.approx({("problem_1", "daqp"): 3.0})


def test_only_stable_ratios_fail_above_three_times_their_bound():
    def failing(ratio: float | pd.Series) -> set[str]:
        rows = table.RATIOS.assign(ratio=ratio)
        return {line.partition(":")[0] for line in table.exceeding(rows)}

    assert failing(1e3) == {*STABLE["compared"]}
    assert failing(2.9 * table.RATIOS["bound"]) == set()
