"""Table and sentences on what events cost, from the JSON alone."""

from functools import partial
from typing import Any

from argument_checks.ties import greatest
from experiments.rig.events import EVENTS
from experiments.study.resumable import rate as session_rate
from experiments.study.tables import Column, Table, tabulate

_FAMILIES = {"all": "the usual family", "other family": "the other family"}
"""By mismatch."""


def tables(summary: dict[str, Any]) -> list[Table]:
    """One row for each event."""
    columns = (
        Column("event", "event"),
        Column("flights", "flights"),
        Column("over doing nothing: median", "over_median", ".2f"),
        Column("worst", partial(_worst, "since")),
        Column("worst from 0.5 s on", partial(_worst, "after")),
        Column("harmed", "harmed"),
        Column("over informed", "over_informed_median", ".2f"),
        Column("named", "named_rightly", _of),
        Column("sound named", "sound_named"),
        Column("unexplained", "unexplained"),
        Column("peak, urad", lambda entry: _peak(entry, "supervised")),
        Column("doing nothing", lambda entry: _peak(entry, "unaware")),
    )
    legend = (
        "over doing nothing: RMS pointing error from the event to the end of the flight, divided "
        "by that of the same controller without diagnosis; from 0.5 s on: without the first 0.5 s "
        "after the event. harmed: flights in which either is above "
        f"{summary['worst_allowed']:g} and the errors differ by more than the detector's noise, "
        f"{summary['noise_urad']:.2f} urad RMS. over informed: divided by that of a controller "
        "informed at once (median). named: the first strut named is the one that failed, where one "
        "did that a diagnosis has a name for; or what happened is named (offset, supply, scale), "
        "where it is no failure. sound named: flights in which a strut was named that "
        "had not failed. unexplained: flights with an alarm that nothing explained. peak: largest "
        "error from the event on."
    )
    return [tabulate("What events cost", columns, summary["events"], legend)]


def headline(summary: dict[str, Any]) -> str:
    """In how many events the diagnosis does no harm, and where it does most, in one sentence."""
    events, limit = summary["events"], summary["worst_allowed"]
    harmless = [each for each in events if not each["harmed"] and not each["ended"]]
    said = (
        f"At most {limit:g} times the error of doing nothing in {len(harmless)} of {len(events)} "
        "kinds of event"
    )
    if len(harmless) == len(events):
        return f"{said}."
    worst = events[greatest([each["counted_worst"] for each in events])]
    if not worst["harmed"]:
        return f"{said}; some flights ended."
    return f"{said}; the worst: {worst['event']}, {worst['counted_worst']:.3g} times."


def notes(summary: dict[str, Any]) -> list[str]:
    """What was flown, and what came of it."""
    prior, mismatch, other = (summary[key] for key in ("prior", "mismatch", "other_family"))
    sound, at_s = summary["sound"], summary["at_s"]
    early, later = ("{:g} to {:g} s".format(*at_s[key]) for key in ("early", "later"))
    flights = sum(each["flights"] for each in summary["events"])
    said = [
        f"{headline(summary)} {flights} flights, each with one event.",
        f"The diagnosis assumes errors of its model with standard deviations of {_sizes(prior)}. "
        f"Half of the plants are drawn with all mismatches, uniform within {_sizes(mismatch)} and "
        "independent, which is narrower; half log-normal, with standard deviations of "
        f"{_sizes(other)}, correlated by {other['correlation']:g} between parts.",
        f"An event happens {later} after the first tick; in two of twelve flights {early}, while "
        f"the diagnosis learns. A flight goes on for {at_s['after']:g} s. In turn it follows the "
        "spiral, twice at another speed and radius, a circle, steps that are held, or rests.",
        *(
            f"Plants of {_FAMILIES[name]}: the median RMS error is {entry['over_median']:.3g} "
            f"times that of a controller that does nothing; flights with harm: {entry['harmed']}."
            for name, entry in summary["families"].items()
            if entry["over_median"] is not None
        ),
        f"{sound['duration_s']:g} s without an event, in one flight: {sound['alarms']} alarms "
        f"({sound['low_per_hour_95']:.2g} to {sound['high_per_hour_95']:.2g} per hour, each bound "
        "at 95 %).",
    ]
    said += [
        f"{each['event']}: {EVENTS[each['event']].sentence}"
        for each in summary["events"]
        if each["harmed"] or each["ended"]
    ]
    return said + session_rate(summary)


def _sizes(sizes: dict[str, Any]) -> str:
    said = (f"{100 * sizes[name]:.2g} % ({name})" for name in ("gain", "stiffness", "damping"))
    return ", ".join((*said, f"{100 * sizes['inertia']:.2g} % (inertia)"))


def _worst(when: str, entry: dict[str, Any]) -> str | None:
    if entry["ended"]:
        return f"{entry['ended']} ended"
    ratios = entry[f"over_{when}"]
    return f"{max(ratios):.2f}" if ratios else None


def _of(counted: dict[str, Any]) -> str:
    return f"{counted['right']} of {counted['cases']}"


def _peak(entry: dict[str, Any], who: str) -> str | None:
    peak = entry["peak_urad"][who]
    return None if peak is None else f"{peak:.1f}"
