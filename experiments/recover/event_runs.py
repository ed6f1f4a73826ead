"""Flights in which anything happens, on the workers there are."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from experiments.recover.campaign import event_flights_of
from experiments.recover.event_plan import QUICK, WHOLE, EventPlan
from experiments.study.resumable import Complete, complete


@dataclass(frozen=True)
class Events:
    """Everything that `fjh recover --events` publishes: the flights, whose rows are on disk."""

    done: Complete[EventPlan]


@contextmanager
def run_events(*, seed: int, quick: bool, **options: Any) -> Iterator[Events | dict[str, Any]]:
    """Fly all events; flights are kept as they finish.

    Args:
        seed: Of all that is drawn, and of all noise.
        quick: One flight of a few events.
        options: As of :func:`experiments.study.resumable.complete`.

    Raises:
        WrongInput: As `complete`.
    """
    plan = EventPlan(QUICK if quick else WHOLE, seed)
    with complete("recover", event_flights_of(plan), **options) as done:
        yield Events(done) if isinstance(done, Complete) else done
