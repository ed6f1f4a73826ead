"""Failures in flight in words and tables, from `recover.json`."""

from typing import Any

from experiments.output.findings import Findings, Picture, Table
from experiments.recover.soundness import complaint

PICTURES = [
    Picture(
        "recover.png",
        "A strut fails in flight: delays, separations, recovery, and failure after failure.",
        "Panels with the delays until a strut is named, by kind of failure; how far apart the "
        "failures look; pointing errors with and without recovery; and a flight on which struts "
        "fail until the task is lost.",
    )
]


def findings(summary: dict[str, Any]) -> Findings:
    """Delays and errors, what looks alike, and all rates in sentences."""
    tables = [recovery(summary), ambiguity(summary)]
    return Findings(summary, tables, notes(summary), PICTURES, complaint(summary))


def recovery(summary: dict[str, Any]) -> Table:
    """Delays and pointing errors by kind of failure."""
    kinds = ("locked", "free", "weak")

    def delay(kind: str, what: str) -> str:
        counted = summary["delay_ms"][kind][what]
        return "" if counted is None else "/".join(f"{ms:.0f}" for ms in counted.values())

    def errors(kind: str, flown: str, when: str) -> str:
        pooled = summary["errors_urad"][kind]
        return "" if pooled is None else "{rms:.2f}/{peak:.1f}".format(**pooled[flown][when])

    rows = [
        (f"{label}, ms: median/95 %/largest", *(delay(kind, what) for kind in kinds))
        for label, what in (("alarm", "alarm"), ("named", "named"))
    ]
    before = [errors(kind, "supervised", "before") for kind in kinds]
    rows.append(("before, urad: RMS/peak", *before))
    for when in ("during", "after"):
        for label, flown in (
            ("found and flown around", "supervised"),
            ("told at once", "informed"),
            ("no correction", "uncorrected"),
        ):
            rows.append((f"{when}: {label}", *(errors(kind, flown, when) for kind in kinds)))
    return Table(
        "A strut fails in flight",
        ("", *kinds),
        rows,
        "The controller's model is the simulated plant itself, which no real one is. Delays after "
        "the failure; pointing errors before it, until recovery, and after. weak: a coil that has "
        "lost part of its force.",
    )


def ambiguity(summary: dict[str, Any]) -> Table:
    """Of the struts compared the least separation, and all that is alike."""
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for seen in summary["ambiguity"]["failures"]:
        key = (seen["failure"]["kind"], seen["where"], seen["setting"])
        groups.setdefault(key, []).append(seen)
    rows = []
    for (kind, where, setting), seen in sorted(groups.items()):
        strut = min(each["from_other_struts"] for each in seen)
        other = min(seen, key=lambda each: each["from_other_kinds"])
        pairs = [
            f"{each['failure']['strut']}={twin['strut']}{'' if twin['kind'] == kind else ' ?'}"
            for each in seen
            for twin in each["alike"]
        ]
        nearest = f"{other['from_other_kinds']:.1f} ({other['nearest_other_kind']})"
        rows.append((kind, where, setting, f"{strut:.1f}", nearest, " ".join(pairs)))
    alike, evidence = summary["ambiguity"]["alike_below"], summary["ambiguity"]["evidence_s"]
    return Table(
        "Which failures look alike",
        ("failure", "where", "setting", "other strut", "other kind", "alike"),
        rows,
        f"Separation of {evidence:g} s of outputs from the nearest other strut and other kind of "
        f"failure, the least of six struts; alike: pairs below {alike:g}, ?: of another kind.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """What was asked, and what came out, a sentence each."""
    isolation, alarms = summary["isolation"], summary["false_alarms"]
    beliefs, second = summary["beliefs"], summary["second_failure"]
    over, cost = summary["after_over_oracle"], summary["dither_cost"]
    change = max(abs(value) for value in cost["change_urad"])
    reseeded = max(abs(value) for value in cost["reseeded_urad"])
    lines = [
        f"Of the failures that the linear model separates by {isolation['separation_required']:g}: "
        f"strut right as first named, {_rate(isolation['strut_as_first_named'])}; strut and kind "
        f"right in the end, {_rate(isolation['strut_and_kind_in_the_end'])}.",
        *(
            f"Seen by {each['name']}: strut {_rate(each['strut'])}, strut and kind "
            f"{_rate(each['strut_and_kind'])}."
            for each in summary["settings"]
        ),
        f"After recovery the RMS is {over['pooled']:.4f} times that of a controller told at once; "
        f"{over['worst_case']:.4f} in the worst case.",
        f"False alarms: {_alarms(alarms['flown'])} flown, "
        f"{_alarms(alarms['with_fresh_noise'])} of the same flights with fresh noise.",
        f"The dither changes the RMS of a sound machine by {change:.1e} urad, another seed by "
        f"{reseeded:.1e}.",
        f"Of {beliefs['pairs_of_truth_and_belief']} pairs of truth and belief "
        f"{beliefs['unstable']} are unstable; the sensitivity peaks at "
        f"{beliefs['sensitivity_peak_worst']:.2f} at worst, at "
        f"{beliefs['sensitivity_peak_nothing_failed']:.2f} when nothing has failed.",
        f"Two failures in a flight: all right in {_rate(second['all_right'])}.",
    ]
    if cascade := summary["shown"].get("cascade"):
        ends = "declared lost" if cascade["task_lost"] else "not declared lost"
        lines.append(f"After {len(cascade['happened'])} failures the task is {ends}.")
    lines += [_mismatch(each) for each in summary["mismatch"]]
    return lines


def _mismatch(mismatch: dict[str, Any]) -> str:
    how = "after a commissioning flight" if mismatch["calibrated"] else "uncalibrated"
    alarm = "alarm" if mismatch["healthy_alarm"] else "no alarm"
    right = mismatch["strut_and_kind"]
    return (
        f"Coil gains off by {100 * mismatch['coil_gain_error']:g} %, {how}: {alarm} on a sound "
        f"flight, {right['right']} of {right['cases']} failures right."
    )


def _rate(rate: dict[str, Any]) -> str:
    if rate["rate"] is None:
        return "none tried"
    low, high = 100 * rate["low"], 100 * rate["high"]
    return f"{rate['right']} of {rate['cases']} ({low:.1f} to {high:.1f} %)"


def _alarms(counted: dict[str, Any]) -> str:
    return (
        f"{counted['alarms']} in {counted['hours']:.3g} h (below "
        f"{counted['high_per_hour_95']:.2g} per hour at 95 %)"
    )
