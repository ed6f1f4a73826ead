"""A short test that takes long is listed in CI, and there only; far too long a one fails."""

from types import SimpleNamespace
from typing import Any

import pytest

from tests import conftest, processor_time


def listed(took_s: float, *, marker: object = None, slower: float = 1.0) -> list[str]:
    """What the summary says of a test that takes so long and passes, on a processor so slow."""
    clock, lines = iter([7.0, 7.0 + took_s]), []
    item: Any = SimpleNamespace(get_closest_marker={"long": marker}.get, user_properties=[])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processor_time, "processor_s", lambda: next(clock))
        patch.setattr(processor_time, "loop_s", lambda: slower * processor_time.LOOP_S)
        hook = processor_time.pytest_runtest_call(item)
        next(hook)
        with pytest.raises(StopIteration):
            hook.send(None)
    report = SimpleNamespace(nodeid="test", user_properties=item.user_properties)
    reporter: Any = SimpleNamespace(stats={"passed": [report]}, write_line=lines.append)
    processor_time.pytest_terminal_summary(reporter)
    return lines


def test_in_ci_more_than_two_seconds_are_listed_and_three_times_as_much_fails(monkeypatch):
    monkeypatch.setenv("PROPERTIES", "ci")
    monkeypatch.delenv("PROCESSOR_TIME", raising=False)
    assert listed(2.5)[0].startswith("test: 2.5 s of an idle processor's time, 2 are allowed")
    with pytest.raises(pytest.fail.Exception, match=r"^6\.5 s of an idle processor's time"):
        listed(6.5)
    assert not listed(1.9)
    assert not listed(7.0, marker=pytest.mark.long)
    assert not listed(2.5, slower=1.3)
    assert listed(2.7, slower=1.3)
    assert listed(7.0, slower=1.3)
    with pytest.raises(pytest.fail.Exception):
        listed(7.9, slower=1.3)


def test_as_on_another_processor_it_may_take_longer(monkeypatch):
    monkeypatch.setenv("PROPERTIES", "ci")
    monkeypatch.setenv("PROCESSOR_TIME", "unlimited")
    assert not listed(7.0)


@pytest.mark.parametrize("profile", ["local", "night"])
def test_elsewhere_a_test_takes_as_long_as_it_takes(monkeypatch, profile):
    monkeypatch.setenv("PROPERTIES", profile)
    assert not listed(7.0)


def test_the_rule_is_in_force_for_every_test():
    assert conftest.pytest_runtest_call is processor_time.pytest_runtest_call
    assert conftest.pytest_terminal_summary is processor_time.pytest_terminal_summary


def test_processor_time_counts_what_a_test_computes():
    before = processor_time.processor_s()
    while processor_time.processor_s() - before < 0.05:
        sum(range(1000))
