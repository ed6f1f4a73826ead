"""The figure of `fjh release`: statics over stiffness, and spirals in which the strut is lost."""

from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.release.runs import Release
from experiments.study.palette import BLACK, GREEN
from experiments.study.plotting import DESIRED, MEASURED, PAGE_IN, START, new_figure
from experiments.study.results import Picture
from sim import Array

_COMMANDED_URAD = 100.0
_RATIO = "strut 1: stiffness of suspension / of flexures"


def pictures(release: Release, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = (
        "Strut 1 without its coil force: the payload at rest over six decades of the strut's "
        "suspension stiffness, and two spirals during which strut 1 fails."
    )
    alt = (
        "Above: the elastic mapping agrees with the simulation at all stiffnesses; a strut that is "
        "taken as locked disagrees where the suspension is soft. Below: t_x when the coil, or coil "
        "and spring, are lost during the spiral; simulation and linear model coincide."
    )
    return [Picture("release", caption, alt, partial(figure_release, release, summary))]


def figure_release(release: Release, summary: dict[str, Any]) -> Figure:
    """The sweep over stiffness, and strut 1 losing coil and spring in flight."""
    figure = new_figure(PAGE_IN, 5.2)
    figure.suptitle("Strut 1 without its coil force: springs determine where the payload goes")
    (reached, off), (free, spring_lost) = figure.subplots(2, 2)
    _reached(reached, summary["sweep"])
    _off(off, summary["sweep"])
    _spiral(free, release, "free_in_flight_corrected", "coil force")
    _spiral(spring_lost, release, "loose_in_flight_corrected", "coil force and spring")
    return figure


def _reached(axes: Axes, sweep: list[dict[str, Any]]) -> None:
    ratio = [point["suspension_over_swing"] for point in sweep]
    axes.axhline(_COMMANDED_URAD, color=GREEN, lw=0.8, ls="--", label="commanded")
    curves: tuple[tuple[str, str, dict[str, Any]], ...] = (
        (
            "alpha_corrected_urad",
            "simulated, failure known to the mapping",
            {"color": GREEN, "marker": "s", "ls": ""},
        ),
        (
            "alpha_as_if_locked_urad",
            "predicted as if strut 1 were locked",
            {"color": START, "ls": ":"},
        ),
        ("alpha_elastic_urad", "predicted by the elastic mapping", {"color": DESIRED}),
        (
            "alpha_simulated_urad",
            "simulated, failure unknown",
            {"color": MEASURED, "marker": "o", "ls": ""},
        ),
    )
    for key, label, style in curves:
        axes.semilogx(ratio, [point[key] for point in sweep], label=label, **style)
    axes.set(title="Payload at rest after a command of 100 µrad", xlabel=_RATIO)
    axes.set(ylabel="$\\alpha$, µrad", ylim=(0, 110))
    axes.legend(loc="lower right")


def _off(axes: Axes, sweep: list[dict[str, Any]]) -> None:
    ratio = [point["suspension_over_swing"] for point in sweep]
    for key, label, color, marker in (
        ("mismatch_as_if_locked_percent", "as if strut 1 were locked", START, "s"),
        ("mismatch_elastic_percent", "elastic mapping", DESIRED, "o"),
        ("mismatch_linear_model_percent", "linear model, coils as forces", MEASURED, "^"),
    ):
        mismatch = [point[key] for point in sweep]
        axes.loglog(ratio, mismatch, marker=marker, color=color, label=label)
    axes.set(title="Error of three predictions of the payload at rest", xlabel=_RATIO)
    axes.set_ylabel("difference from the simulation, %")
    axes.legend(loc="center left", bbox_to_anchor=(0, 0.29))


def _spiral(axes: Axes, release: Release, name: str, lost: str) -> None:
    spiral = release.spirals[name]
    failed_s = spiral.case.time_s
    lines: tuple[tuple[Array, str, dict[str, Any]], ...] = (
        (spiral.twist, "simulated", {"color": MEASURED, "lw": 2, "alpha": 0.5}),
        (spiral.linear, "linear model", {"color": DESIRED, "lw": 0.6}),
        (
            spiral.quasi_static,
            "elastic mapping (static)",
            {"color": START, "lw": 0.8, "ls": "--"},
        ),
    )
    for motion, label, style in lines:
        axes.plot(spiral.run.time_s, 1e6 * motion[:, 3], label=label, **style)
    axes.axvline(failed_s, color=BLACK, lw=0.8, ls=":", label="strut 1 fails")
    axes.set(title=f"Spiral with {lost} lost at {failed_s:g} s")
    axes.set(xlabel="time, s", ylabel="$t_x$, µm")
    axes.legend(loc="upper left")
