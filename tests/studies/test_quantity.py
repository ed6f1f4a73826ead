"""A number of a study, written once: its entry, column, check and words."""

import math
from dataclasses import replace

import pytest

from experiments.study.quantity import Quantity, checks_of, columns_of, entry_of, of_each
from experiments.study.tables import tabulate

LENGTH = Quantity("length_m", lambda s: s["l"], "length [m]", "length", ".2f", below=2.0)
WIDE = Quantity("width_m", lambda s: s["w"], "the width, {:.1f} m,", agrees_with="computed_m")
WIDE = replace(WIDE, within=0.1)
COMPUTED = Quantity("computed_m", lambda s: s["c"], "the computed one, {:.1f} m,", heading="")
ALL = (LENGTH, WIDE, COMPUTED)
SOURCE = {"l": 1.234, "w": 4.0, "c": 4.2}


def said(entry, quantities=ALL) -> list[str]:
    return [str(each) for each in checks_of(quantities, entry, "here") if not each.passed]


def test_the_entry_has_each_number_under_its_key():
    assert entry_of(ALL, SOURCE) == {"length_m": 1.234, "width_m": 4.0, "computed_m": 4.2}


def test_columns_are_of_those_with_a_heading_even_an_empty_one():
    in_mm = replace(LENGTH, heading="mm", format=lambda metres: f"{1e3 * metres:g}")
    table = tabulate("", columns_of([*ALL, in_mm]), [entry_of(ALL, SOURCE)])
    assert table.headings == ("length", "", "mm")
    assert table.rows == [("1.23", "4.2", "1234")]


def test_a_number_that_does_not_apply_is_an_empty_cell_and_not_checked():
    nothing = {"length_m": None, "width_m": None, "computed_m": None}
    in_mm = replace(LENGTH, heading="mm", format=lambda metres: f"{1e3 * metres:g}")
    assert tabulate("", columns_of([LENGTH, in_mm]), [nothing]).rows == [("", "")]
    assert checks_of(ALL, nothing, "here") == []
    assert len(checks_of(ALL, nothing | {"length_m": 1.0, "width_m": 1.0}, "here")) == 1


def test_a_number_above_its_limit_fails_in_its_words():
    entry = entry_of(ALL, SOURCE)
    assert [each.passed for each in checks_of(ALL, entry, "here")] == [True, True]
    assert said(entry | {"length_m": 2.0}) == ["here: length [m] is 2, expected below 2"]


@pytest.mark.parametrize("width", [4.7, 3.7])
def test_two_numbers_that_do_not_agree_are_both_said(width):
    assert said(entry_of(ALL, SOURCE) | {"width_m": width}) == [
        f"here: relative difference between the width, {width:.1f} m, and the computed one, 4.2 m, "
        "is 0.119, expected below 0.1"
    ]


@pytest.mark.parametrize("sign", [1, -1])
def test_agreement_is_relative_to_the_size_of_the_other_number(sign):
    entry = {"length_m": 0.0, "width_m": sign * 5.0, "computed_m": sign * 4.2}
    assert len(said(entry)) == 1


@pytest.mark.parametrize("key", ["length_m", "width_m", "computed_m"])
def test_nan_fails(key):
    assert len(said(entry_of(ALL, SOURCE) | {key: math.nan})) == 1


@pytest.mark.parametrize("key", ["length_m", "width_m", "computed_m"])
def test_a_missing_key_raises(key):
    entry = entry_of(ALL, SOURCE)
    del entry[key]
    with pytest.raises(KeyError, match=key):
        checks_of(ALL, entry, "here")


def test_a_limit_may_depend_on_the_entry_and_be_none():
    depends = replace(LENGTH, below=lambda entry: entry["limit_m"])
    assert said({"length_m": 1.0, "limit_m": 2.0}, [depends]) == []
    assert len(said({"length_m": 3.0, "limit_m": 2.0}, [depends])) == 1
    assert checks_of([depends], {"length_m": 3.0, "limit_m": None}, "here") == []


def test_one_line_makes_the_quantities_of_each_component():
    each = of_each(
        ("x", "y"),
        Quantity("*_m", lambda s: s, "the way along *, {:.1f} m,", "*", agrees_with="computed_*_m"),
        Quantity("computed_*_m", lambda s: None),
    )
    assert [one.key for one in each] == ["x_m", "computed_x_m", "y_m", "computed_y_m"]
    assert [one.heading for one in each] == ["x", None, "y", None]
    assert each[2].agrees_with == "computed_y_m"
    entry = entry_of(each, (1.0, 2.0))
    assert entry == {"x_m": 1.0, "computed_x_m": None, "y_m": 2.0, "computed_y_m": None}
    assert each[2].said(entry) == "the way along y, 2.0 m,"
