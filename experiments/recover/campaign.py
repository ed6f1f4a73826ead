"""The campaign of the study: its flights as rows."""

from typing import Any

from experiments.recover.event_plan import EventPlan
from experiments.recover.plan import FlightPlan
from experiments.recover.row import SCHEMA, row_of
from experiments.study.basis import sources_of
from experiments.study.campaign import Campaign
from experiments.study.controllers import controller_sha256

SOURCES = sources_of(
    "recover",
    without=(
        *(
            "__init__",
            "again",
            "campaign",
            "checks",
            "command",
            "comparison",
            "curves",
            "exact_flights",
            "figure",
        ),
        *("event_figure", "event_results", "event_runs", "event_tables"),
        *("mechanism_event_results", "mechanism_event_row", "mechanism_events"),
        *("mechanism_flight", "mechanism_results", "mechanism_row", "mechanism_tables"),
        *("mechanisms", "notes", "rates", "recordings", "results", "runs", "summary", "tables"),
    ),
)


def flights_of(plan: FlightPlan) -> Campaign[FlightPlan]:
    """The flights of a plan.

    Another controller changes no row, but what is published: its name and module count as well.
    """
    drawn_from: dict[str, Any] = {"flights": plan.as_json(), "seed": plan.seed}
    if plan.controller is not None:
        drawn_from["controller_sha256"] = controller_sha256(plan.controller)
    return Campaign(plan, row_of, SCHEMA, SOURCES, drawn_from)


def event_flights_of(plan: EventPlan) -> Campaign[EventPlan]:
    """The flights in which anything happens."""
    return Campaign(plan, row_of, SCHEMA, SOURCES, {"events": plan.as_json(), "seed": plan.seed})
