"""The figure of `fjh recover`."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.hexapod.simulation import Trajectory
from experiments.output.plotting import BLACK, BLUE, GREEN, ORANGE, PAGE_IN, VERMILION, new_figure
from experiments.output.results import Picture
from experiments.recover.recovery import Identification, pointing_error_urad
from experiments.recover.runs import Recover, marks
from ftc.fdi.fault_model import KINDS

_COLORS = {"locked": BLUE, "free": VERMILION, "weak": GREEN}


def pictures(outcome: Recover, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = "Unannounced actuator failures: delays, isolability, recovery, and one run."
    alt = (
        "Delays until the failed strut is named, by kind of failure; distances of the failures "
        "from one another; pointing errors with and without recovery; a run with failures."
    )
    return [Picture("recover", caption, alt, partial(figure_recover, outcome, summary))]


def figure_recover(outcome: Recover, summary: dict[str, Any]) -> Figure:
    """How fast, what looks alike, what recovery is worth, and failure after failure."""
    figure = new_figure(PAGE_IN, 5.4)
    figure.suptitle("Unannounced failures, diagnosed from pointing angles, commands and a dither")
    grid = figure.add_gridspec(2, 2)
    _delays(figure.add_subplot(grid[0, 0]), summary["cases"])
    _distances(figure.add_subplot(grid[0, 1]), summary["ambiguity"])
    _after(figure.add_subplot(grid[1, 0]), summary["cases"])
    # The last of the runs that are kept: the cascade, unless --quick.
    name, (run, found) = list(outcome.shown.items())[-1]
    draw_shown(figure.add_subplot(grid[1, 1]), name, run, found)
    return figure


def _delays(axes: Axes, cases: list[dict[str, Any]]) -> None:
    """Share of failures named, over the time since they happened."""
    for kind in KINDS:
        named = [c["named_ms"] for c in cases if c["truth"]["kind"] == kind]
        delays = np.sort([np.inf if delay is None else delay for delay in named])
        if delays.size:
            share = np.arange(1, len(delays) + 1) / len(delays)
            axes.step(delays, 100 * share, where="post", color=_COLORS[kind], label=kind)
    axes.set(title="strut named", xlabel="time since the failure, ms", ylabel="of the failures, %")
    axes.set(xscale="log", ylim=(0, 102))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.legend(loc="lower right")


def _distances(axes: Axes, ambiguity: dict[str, Any]) -> None:
    """From the nearest other strut, and from the nearest other kind, setting by setting."""
    settings = list(dict.fromkeys(each["setting"] for each in ambiguity["failures"]))
    for column, setting in enumerate(settings):
        seen = [each for each in ambiguity["failures"] if each["setting"] == setting]
        for key, shift, color, label in (
            ("from_other_struts", -0.12, BLUE, "nearest other strut"),
            ("from_other_kinds", 0.12, ORANGE, "nearest other kind"),
        ):
            values = [each[key] for each in seen]
            x = np.full(len(values), column + shift)
            axes.semilogy(x, values, "o", color=color, ms=3, alpha=0.6, label=label)
    axes.axhline(ambiguity["alike_below"], color=BLACK, lw=0.8, ls=":")
    axes.set_xticks(range(len(settings)), [name.replace(", ", ",\n") for name in settings])
    axes.set(title="isolability: below the dotted line, alike", ylabel="distance $d$")
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[:2], labels[:2])


def _after(axes: Axes, cases: list[dict[str, Any]]) -> None:
    """Each case after recovery, against the informed controller's."""
    oracle = [case["rms_after_oracle_urad"] for case in cases]
    for key, marker, color, label in (
        ("rms_after_uncorrected_urad", "s", ORANGE, "fault-unaware"),
        ("rms_after_urad", "o", BLUE, "supervised"),
    ):
        errors = [case[key] for case in cases]
        axes.plot(oracle, errors, marker, color=color, ms=3, alpha=0.6, label=label)
    ends = [0, max(oracle)]
    axes.plot(ends, ends, color=BLACK, lw=0.8, label="informed")
    axes.set(title="pointing error after recovery, RMS", xlabel="informed at once, µrad")
    axes.set(ylabel="µrad")
    axes.legend()


def draw_shown(axes: Axes, name: str, run: Trajectory, found: Identification) -> None:
    """The pointing error of one run; each failure, labelled by what was found or what happened."""
    axes.semilogy(run.time_s, pointing_error_urad(run), color=BLACK, lw=0.6)
    for mark in marks(run, found):
        axes.axvline(mark.failed_s, color=VERMILION, lw=1)
        label = mark.diagnosis if mark.is_found else mark.failure
        axes.text(mark.failed_s + 0.1, 0.02, label, rotation=90)
        if mark.is_found:
            axes.axvline(mark.diagnosed_s, color=GREEN, lw=1)
    lost = ": in the end the task is lost" if found.task_lost else ""
    axes.set(
        title=f"{name}{lost}", xlabel="time, s", ylabel="pointing error, µrad", ylim=(1e-2, 3e2)
    )
