"""The figure of `fjh release`: statics over stiffness, and spirals in which the strut is lost."""

from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.output.plotting import DESIRED, MEASURED, PAGE_IN, START, new_figure
from experiments.output.results import Picture
from experiments.release.runs import Release, twist
from sim import Array


def pictures(release: Release, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = "Strut 1 without its coil: statics over six decades of stiffness, and two spirals."
    alt = (
        "Above: the elastic mapping follows the simulation over all stiffnesses, taking the strut "
        "as locked fails for soft suspensions. Below: t_x when coil, or coil and spring, are lost "
        "during the spiral; simulation and linear model lie on top of each other."
    )
    return [Picture("release", caption, alt, partial(figure_release, release, summary))]


def figure_release(release: Release, summary: dict[str, Any]) -> Figure:
    """The sweep over stiffness, and strut 1 losing coil and spring in flight."""
    figure = new_figure(PAGE_IN, 4.9)
    figure.suptitle("Strut 1 without its coil: the springs decide where the payload goes")
    (reached, off), (free, spring_lost) = figure.subplots(2, 2)
    _reached(reached, summary["sweep"])
    _off(off, summary["sweep"])
    _spiral(free, release, "free_in_flight_corrected")
    _spiral(spring_lost, release, "loose_in_flight_corrected")
    return figure


def _reached(axes: Axes, sweep: list[dict[str, Any]]) -> None:
    ratio = [point["suspension_over_swing"] for point in sweep]
    curves: tuple[tuple[str, str, dict[str, Any]], ...] = (
        ("alpha_as_if_locked_urad", "as if locked at its centre", {"color": START, "ls": ":"}),
        ("alpha_elastic_urad", "elastic mapping", {"color": DESIRED}),
        ("alpha_simulated_urad", "simulated", {"color": MEASURED, "marker": "o", "ls": ""}),
        ("alpha_corrected_urad", "simulated, corrected", {"color": START, "marker": "s", "ls": ""}),
    )
    for key, label, style in curves:
        axes.semilogx(ratio, [point[key] for point in sweep], label=label, **style)
    axes.set(title="100 µrad asked for, at rest", ylabel="$\\alpha$, µrad", ylim=(0, 110))
    axes.set_xlabel("suspension / own swing stiffness")
    axes.legend()


def _off(axes: Axes, sweep: list[dict[str, Any]]) -> None:
    ratio = [point["suspension_over_swing"] for point in sweep]
    for key, label, color in (
        ("mismatch_as_if_locked_percent", "as if locked", START),
        ("mismatch_elastic_percent", "elastic mapping", DESIRED),
        ("mismatch_linear_model_percent", "linear model, coils as forces", MEASURED),
    ):
        axes.loglog(ratio, [point[key] for point in sweep], "o-", color=color, label=label)
    axes.set(title="distance from the simulation", ylabel="payload motion, %")
    axes.set_xlabel("suspension / own swing stiffness")
    axes.legend(loc="center left", bbox_to_anchor=(0, 0.29))


def _spiral(axes: Axes, release: Release, name: str) -> None:
    run = release.trajectories[name]
    lines: tuple[tuple[Array, str, dict[str, Any]], ...] = (
        (twist(run), "simulated", {"color": MEASURED, "lw": 2, "alpha": 0.5}),
        (release.linear[name], "linear model", {"color": DESIRED, "lw": 0.6}),
        (release.quasi_static[name], "quasi-static", {"color": START, "lw": 0.6, "ls": "--"}),
    )
    for motion, label, style in lines:
        axes.plot(run.time_s, 1e6 * motion[:, 3], label=label, **style)
    axes.set(title=name.replace("_", " "), xlabel="time, s", ylabel="$t_x$, µm")
    axes.legend(loc="upper left")
