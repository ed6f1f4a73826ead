"""A failure as text, NAME:KIND@SECONDS: what is written is read back, all else is refused."""

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import Failure
from sim.mjcf import number_of
from sim.plant import FailureKind

KINDS = st.sampled_from(get_args(FailureKind))
NAMES = st.text(min_size=1).filter(lambda name: not name.isdecimal())


@given(NAMES | st.integers(0, 10**9 - 1), KINDS, st.floats(0, 1e9))
def test_a_failure_is_read_back_from_its_text(actuator, kind, time_s):
    failure = Failure(actuator, kind, time_s)
    assert Failure.parse(str(failure)) == failure


@pytest.mark.parametrize(
    ("text", "failure"),
    [
        ("strut1:locked@1.3", Failure("strut1", "locked", 1.3)),
        ("a:b@c:weak@2", Failure("a:b@c", "weak", 2.0)),
        ("4:free@.5", Failure(4, "free", 0.5)),
    ],
)
def test_a_text_is_a_failure_by_name_or_number(text, failure):
    assert Failure.parse(text) == failure


NO_FAILURE = (
    *("", "strut1", "strut1:locked", "strut1@1", ":locked@1", "a:locked@", "a:locked@-1"),
    *("a:locked@nan", "a:locked@inf", "a:locked@x", "a: locked@1", "a:tired@1", "a:locked@1 s"),
)


@pytest.mark.parametrize("text", NO_FAILURE)
def test_a_text_that_is_no_failure_is_shown_with_what_was_expected(text):
    with pytest.raises(
        ValueError, match=r"^text must be NAME:KIND@SECONDS, .*locked.*, got"
    ) as said:
        Failure.parse(text)
    assert repr(text) in str(said.value)


def test_the_nearest_kind_is_named():
    with pytest.raises(ValueError, match=r'got .*; did you mean "locked"'):
        Failure.parse("strut1:loked@1")
    with pytest.raises(ValueError, match=r"got 'strut1:locked@x'$"):
        Failure.parse("strut1:locked@x")


def test_digits_are_a_name_first_and_a_number_where_there_is_no_such_name():
    """Some hands call their joints 0, 1, ... in another order than their actuators are in."""
    assert number_of("0", [("a", "2"), ("b", "0"), ("c", "1")]) == 1
    assert number_of("2", [("a",), ("b",), ("c",)]) == 2
    with pytest.raises(ValueError, match='no actuator or joint "3"'):
        number_of("3", [("a",), ("b",), ("c",)])
