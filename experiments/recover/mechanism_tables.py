"""Tables and sentences on the recovery of any robot, from its JSON alone."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from experiments.rig.units import sizes_said
from experiments.study.tables import Column, Table, tabulate

SENSED = {"task": "task sensor", "joints": "encoders", "both": "both"}
"""What the diagnosis looks at, by the words of the command."""

MISSED = ("sense", "actuator", "kind", "isolable", "named", "alarms")
"""What is said of a failure that was not found."""


def counted(sense: str, kind: str, flights: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Counts of the flights of one sensing and kind of failure; `none` are those without."""
    chosen = [each for each in flights if (each["sense"], each["kind"]) == (sense, kind)]

    def number(key: str) -> int:
        return sum(bool(each[key]) for each in chosen)

    found: dict[str, Any] = {"sense": sense, "kind": kind, "flights": len(chosen)}
    found |= {key: number(key) for key in ("alarms", "sound_named", "unexplained", "task_lost")}
    if kind == "none":
        return found
    pairs = [(each["rms_after"], each["rms_informed"]) for each in chosen]
    ratios = [after / informed for after, informed in pairs if informed is not None]
    delays = [each["named_delay_s"] for each in chosen if each["right"]]
    return found | {
        "isolable": number("isolable"),
        "named": number("named"),
        "right": number("right"),
        "isolable_right": sum(each["right"] and each["isolable"] for each in chosen),
        "kind_right": sum(each["right"] and each["kind"] in each["kinds"] for each in chosen),
        "kinds_alike": sum(len(each["kinds"]) > 1 for each in chosen),
        "lost": number("lost_rightly"),
        "lost_and_said": sum(each["task_lost"] and each["lost_rightly"] for each in chosen),
        "lost_wrongly": sum(each["task_lost"] and not each["lost_rightly"] for each in chosen),
        "named_delay_s": float(np.median(delays)) if delays else None,
        "rms_over_informed": {
            "flights": len(ratios),
            "median": float(np.median(ratios)) if ratios else None,
            "largest": max(ratios, default=None),
        },
    }


def tables(summary: dict[str, Any]) -> list[Table]:
    """What was found, then what became of the flight: a row for each sensing and failure."""
    each = (
        Column("sees", lambda entry: SENSED[entry["sense"]]),
        Column("failure", "kind"),
    )
    found = (
        Column("flights", "flights"),
        Column("alarm", "alarms"),
        Column("named", partial(_given, "named")),
        Column("right", partial(_given, "right")),
        Column("isolable", lambda entry: _of(entry, "isolable_right", "isolable")),
        Column("kind", partial(_given, "kind_right")),
        Column("sound", "sound_named"),
        Column("ms", lambda entry: _ms(entry.get("named_delay_s")), ".0f"),
    )
    after = (
        Column("RMS: median", lambda entry: _ratio(entry, "median"), ".2f"),
        Column("largest", lambda entry: _ratio(entry, "largest"), ".2f"),
        Column("task lost", lambda entry: _of(entry, "lost_and_said", "lost")),
        Column("wrongly", partial(_given, "lost_wrongly")),
    )
    legend = (
        "sees: what the diagnosis looks at. right: the first actuator named is the one that "
        "failed; isolable: of those that the dither separates in half a second, by the uncertain "
        "linear model. kind: it is among those not told apart. sound: flights in which a sound "
        "actuator was named, at any time. ms: median delay until named."
    )
    rest = (
        "RMS: after recovery, divided by that of a controller informed at once. task lost: given "
        "up, of those where the remaining actuators cannot do the task; wrongly: where they can."
    )
    entries = summary["sensed"]
    failing = [entry for entry in entries if entry["kind"] != "none"]
    return [
        tabulate(f"{summary['robot']}: failures found", (*each, *found), entries, legend),
        tabulate(f"{summary['robot']}: recovery", (*each, *after), failing, rest),
    ]


def notes(summary: dict[str, Any]) -> list[str]:
    """What was flown, what the dither does, and each failure that was not found."""
    said = [
        "Each plant differs from the model of controller and diagnosis: gains by up to 3 %, "
        "dampers by 20 %, masses and inertias by 2 %, a tick of delay, drifting sensors, half the "
        f"physics step. {sizes_said(summary)}"
    ]
    for sense, dither in summary["dither"].items():
        if dither is None:
            said.append(f"{SENSED[sense].capitalize()}: without a dither.")
        else:
            said.append(
                f"{SENSED[sense].capitalize()}: dither of {dither['frequency_hz']:g} Hz, which "
                f"separates {len(dither['isolable'])} failures; it moves the major rows with "
                f"amplitudes of up to {max(dither['task_motion']) / summary['path_size']:.2g} of "
                "the path's size."
            )
    return said + [_missed(each) for each in summary["missed"]]


def _missed(entry: dict[str, Any]) -> str:
    what = f"{SENSED[entry['sense']].capitalize()}: {entry['actuator']} {entry['kind']}"
    what += "" if entry["isolable"] else ", not isolable,"
    if entry["named"] is not None:
        return f"{what} was taken for {entry['named']}."
    if not entry["alarms"]:
        return f"{what} raised no alarm."
    return f"{what} raised an alarm that named no actuator."


def _given(key: str, entry: dict[str, Any]) -> int | None:
    """A count that flights without failures do not have."""
    return entry.get(key)


def _of(entry: dict[str, Any], part: str, whole: str) -> str | None:
    return f"{entry[part]} of {entry[whole]}" if whole in entry else None


def _ms(delay_s: float | None) -> float | None:
    return None if delay_s is None else 1e3 * delay_s


def _ratio(entry: dict[str, Any], key: str) -> float | None:
    return entry.get("rms_over_informed", {}).get(key)
