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


def _count(counted: dict[str, Any]) -> str:
    return f"{counted['right']}"


def _of(counted: dict[str, Any]) -> str:
    return f"{counted['right']} of {counted['cases']}"


def _levels(quantiles: dict[str, float]) -> str:
    return "/".join(f"{ms:.0f}" for ms in quantiles.values())


def mismatches(summary: dict[str, Any]) -> Table:
    """One row for each mismatch of plant and model."""
    columns = (
        Column("mismatch", "mismatch", WORDS.__getitem__),
        Column("alarm before", "alarm_before", _count),
        Column("alarm", "detected", _of),
        Column("named", "named", _count),
        Column("right strut (95 %)", "strut", percent),
        Column("sound strut named", "sound_named", _count),
        Column("kind", "kind", _of),
        Column("named, ms", "named_ms", _levels),
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
        Column("mismatch", "mismatch", WORDS.__getitem__),
        Column("size", "factor", "g"),
        Column("alarm before", "alarm_before", _of),
        Column("alarm", "detected", _of),
        Column("right strut (95 %)", "strut", percent),
        Column("sound strut named", "sound_named", _count),
        Column("alarm, ms", "alarm_ms", _levels),
        Column("named, ms", "named_ms", _levels),
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
        quantiles = summary["delay_ms"][kind][what]
        return "" if quantiles is None else _levels(quantiles)

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
