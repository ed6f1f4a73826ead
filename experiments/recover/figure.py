"""The figure of `fjh recover`."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, ScalarFormatter

from experiments.recover.recordings import marks
from experiments.recover.recovery import Identification, pointing_error_urad
from experiments.recover.runs import Recover
from experiments.recover.tables import WORDS
from experiments.rig.hexapod.simulation import Trajectory
from experiments.study.campaign import Row
from experiments.study.plotting import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PAGE_IN,
    PURPLE,
    VERMILION,
    new_figure,
)
from experiments.study.results import Picture
from ftc.fdi.fault_model import KINDS

_LINES = (BLACK, BLUE, VERMILION, GREEN, ORANGE, PURPLE)
_STYLES = ("-", "--")
_COLORS = {"locked": BLUE, "free": VERMILION, "weak": GREEN}


def pictures(outcome: Recover, summary: dict[str, Any], rows: Sequence[Row]) -> list[Picture]:
    """The study's figure and its caption."""
    picture = Picture(
        "recover",
        "Unannounced actuator failures. Above and left: failures whose strut was rightly named, "
        "false alarms before the failure, and median time until the strut is named, against the "
        "size of each mismatch of plant and model, 1 being that of the other panels. Then, with "
        "all mismatches: time until the first diagnosis names the failed strut (not named: there "
        "is none, or it names another); pointing error after recovery, a point for each failure; "
        "and a run in which one or several struts fail.",
        "Panels with the share of struts rightly named, false alarms and delays against the size "
        "of each mismatch; the time until the failed strut is named, by kind of failure; pointing "
        "errors with and without recovery; and a run in which one or several struts fail.",
        partial(figure_recover, outcome, summary, rows),
    )
    return [picture]


def figure_recover(outcome: Recover, summary: dict[str, Any], rows: Sequence[Row]) -> Figure:
    """What a wrong model costs, how fast, what recovery is worth, and failure after failure."""
    cases = [r for r in rows if (r["sort"], r["mismatch"]) == ("failure", "all")]
    cases = [row for row in cases if row["status"] == "flown"]
    figure = new_figure(PAGE_IN, 9.6)
    figure.suptitle("Unannounced failures, diagnosed from pointing angles, commands and a dither")
    (right, alarms), (named, delays), (after, shown) = figure.subplots(3, 2)
    draw_curves((right, alarms, named), summary["sizes"])
    draw_delays(delays, cases)
    draw_after(after, cases)
    # The last of the runs that are kept: the cascade, unless --quick.
    draw_shown(shown, *list(outcome.shown.values())[-1])
    return figure


def draw_curves(panels: tuple[Axes, Axes, Axes], sizes: Sequence[dict[str, Any]]) -> None:
    """Isolation, false alarms and delay of each mismatch, over the factors of its size."""
    right, alarms, named = panels
    factors = sorted({entry["factor"] for entry in sizes})
    names = list(dict.fromkeys(entry["mismatch"] for entry in sizes))
    for k, name in enumerate(names):
        own = [entry for entry in sizes if entry["mismatch"] == name]
        at = [factors.index(entry["factor"]) for entry in own]
        style: dict[str, Any] = {
            "ls": _STYLES[k // len(_LINES)],
            "color": _LINES[k % len(_LINES)],
            "marker": ".",
        }
        style |= {"label": WORDS[name], "lw": 2.0 if name == "all" else 1.0}
        right.plot(at, [100 * entry["strut"]["rate"] for entry in own], **style)
        alarms.plot(at, [100 * entry["alarm_before"]["rate"] for entry in own], **style)
        medians = [np.nan if e["named_ms"] is None else e["named_ms"]["median"] for e in own]
        named.plot(at, medians, **style)
    for axes in panels:
        axes.set_xticks(range(len(factors)), [f"{factor:g}" for factor in factors])
        axes.set(xlabel="size of the mismatch", xlim=(-0.3, len(factors) - 0.7))
    right.set(title="Failures whose strut is rightly named", ylabel="share, %", ylim=(-4, 104))
    alarms.set(title="False alarms before the failure", ylabel="share, %", ylim=(-4, 104))
    named.set(title="Time until the strut is named", ylabel="median, ms", yscale="log")
    named.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    named.yaxis.set_major_formatter(ScalarFormatter())
    named.minorticks_off()
    right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), ncols=2)


def draw_delays(axes: Axes, cases: Sequence[Row]) -> None:
    """Share of failures whose strut is named, over the time since then; beside it the others'."""
    latest_ms = max([case["named_ms"] for case in cases if _is_named(case)], default=10)
    unnamed_at = 3.0 * latest_ms  # on the axis
    for kind, beside in zip(KINDS, (0.85, 1.0, 1.18), strict=True):
        ours = [case for case in cases if case["kind"] == kind]
        if not ours:
            continue
        delays_ms = sorted(case["named_ms"] for case in ours if _is_named(case))
        times_ms = [*(delays_ms or [latest_ms])[:1], *delays_ms, latest_ms]
        shares, color = 100 * np.arange(len(delays_ms) + 1) / len(ours), _COLORS[kind]
        label = f"{kind}: {len(delays_ms)} of {len(ours)}"
        axes.step(times_ms, [*shares, shares[-1]], where="post", color=color, label=label)
        missed = f"{kind}: {len(ours) - len(delays_ms)} not named"
        axes.plot(beside * unnamed_at, 100 - shares[-1], "X", color=color, ms=5, label=missed)
    ticks_ms = np.outer(10.0 ** np.arange(5), (1, 2, 5)).ravel()
    ticks_ms = [tick for tick in ticks_ms if tick <= latest_ms]
    axes.set(xscale="log", xlim=(1, 1.6 * unnamed_at), ylim=(-4, 104))
    axes.set_xticks([*ticks_ms, unnamed_at], [*(f"{tick:g}" for tick in ticks_ms), "not named"])
    axes.minorticks_off()
    axes.set(title="Failures whose strut is named", ylabel="share of its kind, %")
    axes.set_xlabel("time since the failure, ms")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), ncols=2)


def _is_named(case: Row) -> bool:
    """Whether the first diagnosis is of the strut that has failed."""
    return case["strut_right"]


def draw_after(axes: Axes, cases: Sequence[Row]) -> None:
    """Each case after recovery, against the informed controller's; those not named stand out."""
    named = [case for case in cases if _is_named(case)]
    unnamed = [case for case in cases if not _is_named(case)]
    compared = [case for case in cases if "rms_other_after_urad" in case]
    for those, key, marker, color, label in (
        (compared, "rms_other_after_urad", "^", PURPLE, "the other controller"),
        (cases, "rms_unaware_after_urad", "s", ORANGE, "fault-unaware"),
        (named, "rms_supervised_after_urad", "o", BLUE, "supervised"),
        (unnamed, "rms_supervised_after_urad", "X", BLACK, "supervised, strut not named"),
    ):
        if those:
            oracle = [case["rms_informed_after_urad"] for case in those]
            axes.plot(oracle, [case[key] for case in those], marker, color=color, label=label)
    ends = [0, max(case["rms_informed_after_urad"] for case in cases)]
    axes.plot(ends, ends, color=BLACK, lw=0.8, label="equal to the informed")
    axes.set(title="Pointing error after recovery", xlabel="informed at once, RMS, µrad")
    axes.set(ylabel="RMS, µrad", ylim=(0, 1.4 * axes.get_ylim()[1]))
    axes.legend(loc="upper left")


def draw_shown(axes: Axes, run: Trajectory, found: Identification) -> None:
    """The pointing error of one run; each failure, labelled by what was found or what happened."""
    error_urad = pointing_error_urad(run.desired_rad, run.true_rad)
    axes.semilogy(run.time_s, error_urad, color=BLACK, lw=0.6, label="error")
    for mark in marks(run, found):
        axes.axvline(mark.failed_s, color=VERMILION, lw=1.5, label="failure")
        label = mark.diagnosis if mark.is_found else f"not found: {mark.failure}"
        color = BLACK if mark.is_found else VERMILION
        axes.text(mark.failed_s + 0.15, 2e-3, label, rotation=90, color=color)
        if mark.is_found:
            axes.axvline(mark.diagnosed_s, color=GREEN, ls="--", label="found")
    count = len(found.failures)
    title = "A failure on the spiral" if count == 1 else f"{count} failures in succession"
    lost = "; in the end the task is lost" if found.task_lost else ""
    axes.set(title=title + lost, xlabel="time, s", ylabel="pointing error, µrad", ylim=(1e-3, 1e3))
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    axes.legend(once.values(), once, loc="upper left")
