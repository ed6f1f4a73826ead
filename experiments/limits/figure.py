"""The figure of `fjh limits`: spirals that leave the attainable pointing, and the arm."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.limits.allocation import UNLIMITED, Strategy
from experiments.limits.arm import RANGE_RAD
from experiments.limits.runs import Case, LimitsRuns, attainable
from experiments.study.plotting import (
    BLACK,
    BLUE,
    GREEN,
    PAGE_IN,
    PURPLE,
    SKY,
    VERMILION,
    new_figure,
    one_legend,
)
from experiments.study.results import Picture

_STRICT, _WINDING_UP = Strategy("strict"), Strategy("strict", anti_windup=False)
_LOOKS: dict[Strategy, dict[str, Any]] = {
    UNLIMITED: {"color": SKY, "lw": 2.5, "label": "without limits"},
    _WINDING_UP: {"color": PURPLE, "lw": 0.8, "label": "strict priority, no anti-windup"},
    Strategy("clipping"): {"color": VERMILION, "label": "clipping"},
    _STRICT: {"color": BLUE, "label": "strict priority"},
}
_CONDITIONS = {
    "sound_heave": "No failure, payload to be raised",
    "stuck_heave": "Strut 1 stuck at half stroke, payload to be raised",
}


def pictures(ran: LimitsRuns, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = (
        "Limits in the loop. Above: the hexapod on a spiral beyond what stroke and coil current "
        "allow, without failure and with strut 1 stuck. Below: the arm with limited joints, whose "
        f"joint {summary['arm']['locked_joint']} locks halfway."
    )
    alt = (
        "Left, above: with strict priority the pointing follows the outline of what is attainable; "
        "with clipping it leaves the spiral much earlier. Right: errors over time; without "
        "anti-windup the error persists after the target has become attainable. Below: with "
        "clipping the arm loses its line of sight while joints rest at their limits."
    )
    return [Picture("limits", caption, alt, partial(figure_limits, ran))]


def figure_limits(ran: LimitsRuns) -> Figure:
    """Two conditions of the hexapod and the arm, a row each."""
    figure = new_figure(PAGE_IN, 7.6)
    figure.suptitle("Actuators at their limits: strict priority of pointing, and clipping")
    grid = figure.subplots(3, 2, width_ratios=[0.8, 1])
    for row, (condition, title) in zip(grid, _CONDITIONS.items(), strict=False):
        cases = {case.strategy: case for case in ran.spirals if case.condition == condition}
        _plane(row[0], ran, cases, title)
        _errors(row[1], ran, cases)
    _joints(grid[2, 0], ran)
    _arm(grid[2, 1], ran)
    one_legend(figure, 4)
    return figure


def _plane(axes: Axes, ran: LimitsRuns, cases: dict[Strategy, Case], title: str) -> None:
    corners = 1e3 * attainable(ran.testbed, cases[_STRICT])
    axes.fill(*corners.T, color=GREEN, alpha=0.2, lw=0, label="attainable")
    desired = 1e3 * ran.spirals[cases[_STRICT]].desired_rad
    axes.plot(*desired.T, color=BLACK, ls="--", lw=0.8, label="desired")
    for strategy in (Strategy("clipping"), _STRICT):
        axes.plot(*1e3 * ran.spirals[cases[strategy]].true_rad.T, **_LOOKS[strategy])
    axes.set(title=title, xlabel="$\\alpha$, mrad", ylabel="$\\beta$, mrad", aspect="equal")


def _errors(axes: Axes, ran: LimitsRuns, cases: dict[Strategy, Case]) -> None:
    for strategy, look in _LOOKS.items():
        run = ran.spirals[cases[strategy]]
        error = np.linalg.norm(run.desired_rad - run.true_rad, axis=1)
        axes.plot(run.time_s, 1e3 * error, **look)
    axes.set(title="Pointing error", xlabel="time, s", ylabel="desired to true, mrad")


def _joints(axes: Axes, ran: LimitsRuns) -> None:
    for strategy in (UNLIMITED, Strategy("clipping"), _STRICT):
        run = ran.arm[strategy]
        axes.plot(run.time_s, np.abs(run.joint_rad).max(axis=1), **_LOOKS[strategy])
    axes.axhline(RANGE_RAD, color=BLACK, lw=0.8, ls="-.", label="limit of the joints")
    axes.set(title="Arm: joint farthest from its centre", xlabel="time, s", ylabel="angle, rad")


def _arm(axes: Axes, ran: LimitsRuns) -> None:
    for strategy in (UNLIMITED, Strategy("clipping"), _STRICT):
        run = ran.arm[strategy]
        axes.semilogy(run.time_s, 1e3 * run.error_rad.clip(1e-6), **_LOOKS[strategy])
    axes.axvline(ran.arm[_STRICT].time_s.mean(), color=BLACK, lw=0.8, ls=":", label="joint 4 locks")
    axes.set(title="Arm: error of the line of sight", xlabel="time, s", ylabel="angle, mrad")
    axes.set_ylim(bottom=1e-2)
