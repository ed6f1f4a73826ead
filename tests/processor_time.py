"""In CI a test that is not marked long must be short, or whoever runs `make test` waits for it."""

import os
import time
from collections.abc import Generator

import pytest

from tests import profiles

LIMIT_S = 2.0
"""Processor time of a test, without its fixtures but with the processes that it starts and ends, on
a processor that takes `LOOP_S` for :func:`loop_s`; on a slower or busier one more is allowed."""

UNCERTAIN = 3.0
"""Up to so many times the limit a test is listed at the end, and passes. One test, minutes apart:
3.5 and 3.4 s where the loop took 19 and 31 ms, and 5.8 s in a process that had to load what is
compiled."""

NAME = "over the limit"
"""Of the property of a report that says so."""

LOOP_S = 8.3e-3
"""On an AMD EPYC with nothing else to do."""


def is_limited() -> bool:
    """Whether the rule holds: with the examples of CI, on the processor as it is."""
    return profiles.chosen() == "ci" and os.environ.get("PROCESSOR_TIME") != "unlimited"


def processor_s() -> float:
    """Processor time of this process and of its children that have ended."""
    return sum(os.times()[:4])


def loop_s() -> float:
    """Processor time of a fixed computation now, the best of five."""
    took = []
    for _ in range(5):
        before = time.process_time()
        sum(i * i for i in range(300_000))
        took.append(time.process_time() - before)
    return min(took)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None]:
    """Note how long a test takes that should be short, and fail it far beyond the limit."""
    before = processor_s()
    yield
    took = processor_s() - before
    if not is_limited() or item.get_closest_marker("long") is not None or took <= LIMIT_S:
        return
    took *= LOOP_S / max(LOOP_S, loop_s())
    if took <= LIMIT_S:
        return
    said = (
        f"{took:.1f} s of an idle processor's time, {LIMIT_S:g} are allowed: make it cheaper or "
        "mark it with pytest.mark.long"
    )
    item.user_properties.append((NAME, said))
    if took > UNCERTAIN * LIMIT_S:
        pytest.fail(said, pytrace=False)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List the tests that passed beyond the limit."""
    for report in terminalreporter.stats.get("passed", []):
        for name, said in report.user_properties:
            if name == NAME:
                terminalreporter.write_line(f"{report.nodeid}: {said}")
