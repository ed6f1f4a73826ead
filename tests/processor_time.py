"""In CI a test that is not marked long must be short, or whoever runs `make test` waits for it."""

import os
import time
from collections.abc import Generator

import pytest

from tests import profiles

LIMIT_S = 2.0
"""Processor time of a test, without its fixtures but with the processes that it starts and ends, on
a processor that takes `LOOP_S` for :func:`loop_s`; on a slower or busier one more is allowed."""

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
    """Fail a test that passes but takes too long; with other numbers of examples, none."""
    before = processor_s()
    yield
    took = processor_s() - before
    is_short = item.get_closest_marker("long") is None
    too_long = is_limited() and is_short and took > LIMIT_S
    if too_long and took > LIMIT_S * loop_s() / LOOP_S:
        pytest.fail(
            f"{took:.1f} s of processor time, {LIMIT_S:g} are allowed: make it cheaper or mark it "
            "with pytest.mark.long",
            pytrace=False,
        )
