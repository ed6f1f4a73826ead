"""Flights of the study's dataset, drawn anew from their numbers and flown once more."""

from typing import Any

from experiments.recording.marks import Mark
from experiments.recover.campaign import event_flights_of, flights_of
from experiments.recover.event_plan import EventCounts, EventPlan
from experiments.recover.flight import Flight
from experiments.recover.plan import Counts, FlightPlan
from experiments.recover.recordings import marks
from experiments.recover.recovery import supervised
from experiments.recover.row import supervised_columns
from experiments.rig.hexapod.simulation import Trajectory, trajectory
from experiments.study.campaign import Again, Row
from experiments.study.study import WrongInput


def again(summary: dict[str, Any]) -> Again:
    """The flights that a `recover.json` is of.

    Another controller is not flown again: its columns are not among those of the dataset.

    Raises:
        WrongInput: They are of another robot, whose file its results do not have.
    """
    if "robot" in summary:
        raise WrongInput("flights of another robot cannot be repeated without its file")
    basis = summary["basis"]
    if "events" in basis:
        drawn = basis["events"]
        names = tuple(drawn["names"])
        events = EventPlan(EventCounts(**drawn | {"names": names}), basis["seed"])
        return Again(event_flights_of(events), fly)
    drawn = {name: value for name, value in basis["flights"].items() if name != "controller"}
    drawn |= {"mismatches": tuple(drawn["mismatches"]), "sound": summary["flights"]["sound"]}
    return Again(flights_of(FlightPlan(Counts(**drawn), basis["seed"])), fly)


def fly(flight: Flight) -> tuple[Row, Trajectory, list[Mark]]:
    """The supervised controller's columns of the row, its run, and marks of the failures."""
    run, found = supervised(flight.rig(), flight)
    whole = trajectory(run)
    return supervised_columns(flight, run, found), whole, marks(whole, found)
