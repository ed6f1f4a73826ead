"""Whoever runs `make test` waits for every test that is not marked long: these are to be short."""

import os
from collections.abc import Generator

import pytest

LIMIT_S = 0.4
"""Wall time of a short test; `--durations` of the Makefile lists what takes longer."""
MISTAKE_S = 10 * LIMIT_S
"""Beyond any noise of a busy machine: in CI it fails."""
BUDGET_S = 110.0
"""Of all short tests and their fixtures, in all processes: 60 s on two cores with collection."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fail a test in CI that lacks the mark `long`."""
    report = yield
    is_slow = call.when == "call" and report.passed and call.duration > MISTAKE_S
    if is_slow and os.environ.get("CI") and not item.get_closest_marker("long"):
        report.outcome = "failed"
        report.longrepr = f"{call.duration:.1f} s: make it shorter, or mark it long"
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Show what all short tests took together."""
    reports = [
        report
        for outcome in ("passed", "failed", "")  # the last of fixtures
        for report in terminalreporter.stats.get(outcome, [])
        if isinstance(report, pytest.TestReport) and "long" not in report.keywords
    ]
    took_s = sum(report.duration for report in reports)
    terminalreporter.write_line(f"short tests: {took_s:.0f} s of {BUDGET_S:.0f} s, processes added")
