"""In CI a test that is not marked long must be short, or whoever runs `make test` waits for it."""

import os
import time
from collections.abc import Generator

import pytest

from tests import profiles

LIMIT_S = 2.0
"""Processor time of a test, without its fixtures but with the processes that it starts and ends, on
a processor that takes `LOOP_S` for :func:`loop_s`; on a slower or busier one more is allowed."""

NOISE = 3.0
"""A test up to so many times over the limit is listed at the end, and passes: on a busy machine the
loop and a test slow down differently. One that took 0.87 s on one day took over 2 on another."""

NAME = "processor_s"
"""Of the property of a report that has the time."""

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
    item.user_properties.append((NAME, took))
    if took > NOISE * LIMIT_S:
        pytest.fail(sentence(took), pytrace=False)


def sentence(took_s: float) -> str:
    """What a test is told that is not short."""
    return (
        f"{took_s:.1f} s of an idle processor's time, {LIMIT_S:g} are allowed: make it cheaper or "
        "mark it with pytest.mark.long"
    )


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List the tests that passed beyond the limit."""
    for report in terminalreporter.stats.get("passed", []):
        took = dict(report.user_properties).get(NAME, 0.0)
        if took > LIMIT_S:
            terminalreporter.write_line(f"{report.nodeid}: {sentence(took)}")
