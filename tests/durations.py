"""Whoever runs `make test` waits for every test that is not marked long: these are to be short."""

import pytest

BUDGET_S = 110.0
"""Of all short tests and their fixtures, in all processes: 60 s on two cores with collection. One
takes 0.4 s at most on an idle machine; `--durations` of the Makefile lists what takes longer."""


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Show what all short tests took together; timings are noise, so none of them fails."""
    reports = [
        report
        for outcome in ("passed", "failed", "")  # the last of fixtures
        for report in terminalreporter.stats.get(outcome, [])
        if isinstance(report, pytest.TestReport) and "long" not in report.keywords
    ]
    took_s = sum(report.duration for report in reports)
    terminalreporter.write_line(f"short tests: {took_s:.0f} s of {BUDGET_S:.0f} s, processes added")
