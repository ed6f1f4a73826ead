"""Total duration of the short tests, which `make test` runs."""

import pytest

BUDGET_S = 110.0
"""Limit of the total duration [s] of short tests, 60 s on two cores; a test takes at most 0.4 s."""


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the total duration; it fails no test, since timings vary."""
    reports = [
        report
        for outcome in ("passed", "failed", "")  # the last of fixtures
        for report in terminalreporter.stats.get(outcome, [])
        if isinstance(report, pytest.TestReport) and "long" not in report.keywords
    ]
    took_s = sum(report.duration for report in reports)
    terminalreporter.write_line(f"short tests: {took_s:.0f} s of {BUDGET_S:.0f} s, processes added")
