"""A short test that takes long fails in CI, and there only."""

from types import SimpleNamespace
from typing import Any

import pytest

from tests import conftest, processor_time


def ends(took_s: float, *, marker: object = None, slower: float = 1.0) -> None:
    """Raise what a test ends with that takes so long and passes, on a processor so much slower."""
    clock = iter([7.0, 7.0 + took_s])
    item: Any = SimpleNamespace(get_closest_marker={"long": marker}.get)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processor_time, "processor_s", lambda: next(clock))
        patch.setattr(processor_time, "loop_s", lambda: slower * processor_time.LOOP_S)
        hook = processor_time.pytest_runtest_call(item)
        next(hook)
        with pytest.raises(StopIteration):
            hook.send(None)


def test_more_than_two_seconds_fail_in_ci(monkeypatch):
    monkeypatch.setenv("PROPERTIES", "ci")
    monkeypatch.delenv("PROCESSOR_TIME", raising=False)
    with pytest.raises(pytest.fail.Exception, match=r"^2\.5 s of processor time, 2 are allowed"):
        ends(2.5)
    ends(1.9)
    ends(2.5, marker=pytest.mark.long)
    ends(2.5, slower=1.3)
    with pytest.raises(pytest.fail.Exception):
        ends(2.7, slower=1.3)


def test_as_on_another_processor_it_may_take_longer(monkeypatch):
    monkeypatch.setenv("PROPERTIES", "ci")
    monkeypatch.setenv("PROCESSOR_TIME", "unlimited")
    ends(2.5)


@pytest.mark.parametrize("profile", ["local", "night"])
def test_elsewhere_a_test_takes_as_long_as_it_takes(monkeypatch, profile):
    monkeypatch.setenv("PROPERTIES", profile)
    ends(2.5)


def test_the_rule_is_in_force_for_every_test():
    assert conftest.pytest_runtest_call is processor_time.pytest_runtest_call


def test_processor_time_counts_what_a_test_computes():
    before = processor_time.processor_s()
    while processor_time.processor_s() - before < 0.05:
        sum(range(1000))
