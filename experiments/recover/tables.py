"""Tables of the study, from its JSON alone."""

from functools import partial
from typing import Any

from argument_checks.ties import least
from experiments.study.tables import Column, Table, tabulate
from ftc.fdi.fault_model import KINDS
from ftc.fdi.separation import ACCURACY

WORDS = {
    "exact": "exact",
    "gain": "gain of each coil",
    "stiffness": "stiffness of each spring",
    "damping": "damping of each damper",
    "inertia": "mass and inertia",
    "delay_ticks": "delay",
    "floor_um_per_s": "floor vibration",
    "drift_urad_per_s": "detector drift",
    "gain_drift_per_s": "gain drift",
    "hysteresis": "hysteresis",
    "timestep_s": "integrator step",
    "all": "all",
}
"""Mismatches by their names."""


def percent(counted: dict[str, Any]) -> str:
    """A rate with its interval."""
    if counted["rate"] is None:
        return ""
    low, high = 100 * counted["low"], 100 * counted["high"]
    return f"{counted['right']} of {counted['cases']} ({low:.1f}-{high:.1f} %)"


def _count(name: str, entry: dict[str, Any]) -> str:
    return f"{entry[name]['right']}"


def _of(name: str, entry: dict[str, Any]) -> str:
    return f"{entry[name]['right']} of {entry[name]['cases']}"


def _levels(name: str, entry: dict[str, Any]) -> str:
    return "" if entry[name] is None else "/".join(f"{ms:.0f}" for ms in entry[name].values())


def mismatches(summary: dict[str, Any]) -> Table:
    """One row for each mismatch of plant and model."""
    columns = (
        Column("mismatch", lambda entry: WORDS[entry["mismatch"]]),
        Column("alarm before", partial(_count, "alarm_before")),
        Column("alarm", partial(_of, "detected")),
        Column("named", partial(_count, "named")),
        Column("right strut (95 %)", lambda entry: percent(entry["strut"])),
        Column("sound strut named", partial(_count, "sound_named")),
        Column("kind", partial(_of, "kind")),
        Column("named, ms", partial(_levels, "named_ms")),
        Column("RMS", lambda entry: entry["after_over_oracle"]["pooled"], ".4f"),
    )
    return tabulate(
        "Failures on plants that differ from the model",
        columns,
        summary["failures"],
        "Number of flights. alarm before: false alarm before the failure. alarm: from the failure "
        "on. right strut: the first strut that was named is the one that failed, with the exact "
        "95 % interval. sound strut named: at any time. kind: of those, right or among the kinds "
        "that are not told apart. named, ms: median/95 %/largest time from the failure. RMS: of "
        "the pointing error after recovery, divided by that of a controller informed at once.",
    )


def curves(summary: dict[str, Any]) -> Table:
    """One row for each mismatch and size."""
    columns = (
        Column("mismatch", lambda entry: WORDS[entry["mismatch"]]),
        Column("size", "factor", "g"),
        Column("alarm before", partial(_of, "alarm_before")),
        Column("alarm", partial(_of, "detected")),
        Column("right strut (95 %)", lambda entry: percent(entry["strut"])),
        Column("sound strut named", partial(_count, "sound_named")),
        Column("alarm, ms", partial(_levels, "alarm_ms")),
        Column("named, ms", partial(_levels, "named_ms")),
    )
    return tabulate(
        "Detection and isolation against the size of each mismatch",
        columns,
        summary["sizes"],
        "size: 1 is that of the table above, 0 an exact plant. All else as there.",
    )


def recovery(summary: dict[str, Any]) -> Table:
    """Delays and pointing errors by kind of failure."""

    def delay(what: str, kind: str) -> str:
        return _levels(what, summary["delay_ms"][kind])

    def error(controller: str, when: str, kind: str) -> str:
        pooled = summary["errors_urad"][kind]
        return "" if pooled is None else "{rms:.2f}/{peak:.1f}".format(**pooled[controller][when])

    controllers = {"supervised": "supervised"}
    controllers |= {"informed": "informed at once", "unaware": "fault-unaware"}
    if "controller" in summary:
        controllers["other"] = summary["controller"]["name"]
    cells = {
        "alarm, ms: median/95 %/largest": partial(delay, "alarm"),
        "identified, ms: median/95 %/largest": partial(delay, "named"),
        "before, urad: RMS/peak": partial(error, "supervised", "before"),
    }
    for when in ("during", "after"):
        cells |= {f"{when}: {said}": partial(error, key, when) for key, said in controllers.items()}
    rows = [{"": label} | {kind: cell(kind) for kind in KINDS} for label, cell in cells.items()]
    return tabulate(
        "Unannounced actuator failures: detection, isolation and recovery",
        [Column(heading, heading) for heading in ("", *KINDS)],
        rows,
        "With all mismatches of plant and model. Delays are from the failure on; pointing errors "
        "are before the failure, from it until recovery (during), and after. weak: the coil has "
        "lost part of its force. supervised: the controller diagnoses the failure. informed: it is "
        "given the failure at once. fault-unaware: it does not change.",
    )


def ambiguity(summary: dict[str, Any]) -> Table:
    """Smallest distances between failures over the struts, and the pairs that look alike."""
    by_failure: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for seen in summary["ambiguity"]["failures"]:
        key = (seen["failure"]["kind"], seen["where"], seen["setting"])
        by_failure.setdefault(key, []).append(seen)
    headings, entries = ("failure", "where", "setting", "other strut", "other kind", "alike"), []
    for (kind, where, setting), seen in sorted(by_failure.items()):
        strut = min(each["from_other_struts"] for each in seen)
        other = seen[least([each["from_other_kinds"] for each in seen], ACCURACY)]
        nearest = f"{other['from_other_kinds']:.1f} ({other['nearest_other_kind']})"
        alike = " ".join(
            f"{each['failure']['strut']}={twin['strut']}{'' if twin['kind'] == kind else ' ?'}"
            for each in seen
            for twin in each["alike"]
        )
        cells = kind, where, setting, f"{strut:.1f}", nearest, alike
        entries.append(dict(zip(headings, cells, strict=True)))
    below, evidence = summary["ambiguity"]["alike_below"], summary["ambiguity"]["evidence_s"]
    return tabulate(
        "Isolability: distances between failures, exact model",
        [Column(heading, heading) for heading in headings],
        entries,
        f"Distance between the outputs of a failure over {evidence:g} s and those of the most "
        f"similar failure of another strut or kind, in standard deviations; minimum over the six "
        f"struts. alike: pairs of struts with a distance below {below:g}; ?: of another kind.",
    )
