"""Recovery from unannounced failures as numbers, checks, tables and files."""

from dataclasses import replace
from functools import partial
from typing import Any

from experiments.recover.checks import checks
from experiments.recover.comparison import record_compared
from experiments.recover.figure import pictures
from experiments.recover.notes import notes
from experiments.recover.recordings import record
from experiments.recover.runs import Recover
from experiments.recover.summary import read_rows, summarize
from experiments.recover.tables import ambiguity, curves, mismatches, recovery
from experiments.study.results import Results


def results(outcome: Recover) -> Results:
    """Everything that `fjh recover` publishes."""
    rows = read_rows(outcome)
    summary = summarize(outcome, rows)
    return replace(
        described(summary),
        pictures=pictures(summary, rows),
        records=[
            lambda folder: outcome.done.dataset.merge(folder / summary["dataset"]),
            *(partial(record, outcome, summary, name) for name in outcome.shown),
            *(partial(record_compared, outcome, summary, name) for name in outcome.compared),
        ],
    )


def described(summary: dict[str, Any]) -> Results:
    """Tables, sentences and checks, from `recover.json` alone."""
    tables = mismatches(summary), curves(summary), recovery(summary), ambiguity(summary)
    return Results(summary, tables, notes(summary), checks(summary))
