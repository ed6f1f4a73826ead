"""The figure of `fjh limits`: what each strategy errs, and what has to be chosen for it."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.limits.allocation import STRICT, WINDING_UP, Strategy
from experiments.limits.runs import LimitsRuns, attainable
from experiments.study.palette import BLACK, BLUE, GREEN, VERMILION
from experiments.study.plotting import PAGE_IN, logarithmic, new_figure, one_legend
from experiments.study.results import Picture

_CLIPPING = Strategy("clipping")
_ROWS = {
    "strict": "strict priority",
    "weighted": "weighted problem, best weight",
    "redistributed": "redistributed pseudo-inverse",
    "scaled": "scaled",
    "clipping": "clipping, best tracking time",
    "clipping_untuned": "clipping, shortest tracking time",
    "strict_winding_up": "strict priority, no anti-windup",
}
"""By the key of :func:`_ratios`, from above."""
_LOOKS: dict[str, dict[str, Any]] = {
    "hexapod, no failure": {"color": BLUE, "marker": "o"},
    "hexapod, strut 1 stuck": {"color": VERMILION, "marker": "s"},
    "arm, a joint locks": {"color": GREEN, "marker": "D"},
}

_ONE: dict[str, Any] = {"color": BLACK, "lw": 0.8, "label": "strict priority: 1"}


def pictures(ran: LimitsRuns, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = (
        "Limits in the loop. Left, above: the hexapod with strut 1 stuck on a spiral that leaves "
        "what stroke and coil current allow. Right, above: the error of each strategy over that of "
        "strict priority, without and with a secondary goal. Below: what clipping and one "
        "weighted problem err by the number that has to be chosen for them."
    )
    alt = (
        "Strict priority follows the outline of what is attainable. The best weight and the "
        "redistributed pseudo-inverse have the same error, clipping has more with any tracking "
        "time, and a weight that is too small many times the error."
    )
    return [Picture("limits", caption, alt, partial(figure_limits, ran, summary))]


def headline(summary: dict[str, Any]) -> str:
    """The result in a sentence."""
    clipping = [each["tuned"]["clipping"]["rms_over_strict"] for each in summary["conditions"]]
    return (
        "Actuators at their limits: strict priority needs no tuning, and the best tuned clipping "
        f"errs {min(clipping):.2f} to {max(clipping):.2f} times as much"
    )


def figure_limits(ran: LimitsRuns, summary: dict[str, Any]) -> Figure:
    """What happens, the errors, and the two numbers that have to be chosen."""
    figure = new_figure(PAGE_IN, 5.2)
    figure.suptitle(headline(summary))
    grid = figure.subplots(2, 2, width_ratios=[0.8, 1], height_ratios=[1.15, 1])
    _plane(grid[0, 0], ran)
    _errors(grid[0, 1], summary)
    _tracking(grid[1, 0], summary)
    _weights(grid[1, 1], summary)
    one_legend(figure, 4)
    return figure


def _plane(axes: Axes, ran: LimitsRuns) -> None:
    case = next(each for each in ran.spirals if each.stuck and each.strategy == STRICT)
    run, corners = ran.spirals[case], 1e3 * attainable(ran.testbed, case)
    axes.fill(*corners.T, color=GREEN, alpha=0.2, lw=0, label="attainable")
    axes.plot(*1e3 * run.desired.T, color=BLACK, ls="--", lw=0.8, label="desired")
    axes.plot(*1e3 * run.true.T, color=VERMILION, label="strict priority, strut 1 stuck")
    axes.set(xlabel="$\\alpha$, mrad", ylabel="$\\beta$, mrad", aspect="equal")
    axes.set_title("Strict priority stays as near as limits allow")


def _errors(axes: Axes, summary: dict[str, Any]) -> None:
    ratios = list(_ratios(summary))
    names = [name for name in _ROWS if any(row == name for _, row, _ in ratios)]
    for beside, (kind, look) in zip((-0.2, 0.0, 0.2), _LOOKS.items(), strict=True):
        found = [(ratio, names.index(row) + beside) for of, row, ratio in ratios if of == kind]
        axes.plot(*zip(*found, strict=True), ls="", label=kind, **look)
    axes.axvline(1.0, **_ONE)
    logarithmic(axes, "x")
    axes.set(ylim=(len(names) - 0.5, -0.5))
    axes.set_yticks(range(len(names)), [_ROWS[name] for name in names])
    axes.set(title="Left is better", xlabel="RMS error over that of strict priority")


def _ratios(summary: dict[str, Any]) -> Iterator[tuple[str, str, float]]:
    """The machine, the row, and the RMS error over that of strict priority."""
    sound, stuck, arm = _LOOKS
    for condition in summary["conditions"]:
        kind = stuck if condition["stuck"] else sound
        over = _over_strict(summary, condition["name"])
        yield from ((kind, row, one["rms_over_strict"]) for row, one in condition["tuned"].items())
        yield from ((kind, each.name, over[each.name]) for each in (STRICT, WINDING_UP))
        yield kind, "clipping_untuned", over[_CLIPPING.name]
    yield arm, "strict", 1.0
    for row, one in summary["arm"]["tuned"].items():
        # The arm's controller has no integrator, and clipping there nothing to tune.
        yield arm, "clipping_untuned" if row == "clipping" else row, one["rms_over_strict"]


def _over_strict(summary: dict[str, Any], condition: str) -> dict[str, float]:
    rms = {
        run["strategy"]: run["rms_urad"]
        for run in summary["spirals"]
        if run["condition"] == condition
    }
    return {name: each / rms[STRICT.name] for name, each in rms.items()}


def _tracking(axes: Axes, summary: dict[str, Any]) -> None:
    _points(axes, summary, "clipping", lambda run: 1e3 * np.mean(run["tracking_time_s"]))
    axes.set(title="Clipping: a time to choose", xlabel="tracking time, ms")


def _weights(axes: Axes, summary: dict[str, Any]) -> None:
    _points(axes, summary, "weighted", lambda run: run["major_weight"])
    rms = {run["major_weight"]: run["rms_mrad"] for run in summary["arm"]["runs"]}
    strict = next(run for run in summary["arm"]["runs"] if run["strategy"] == STRICT.name)
    weights = [weight for weight in rms if weight is not None]
    over = [rms[weight] / strict["rms_mrad"] for weight in weights]
    axes.plot(weights, over, ls="", **_LOOKS["arm, a joint locks"])
    axes.set_yticks([1, 3, 10, 30, 100, 300, 1000])
    axes.set_ylim(top=2000)
    axes.set_xticks([0.1, 1, 10, 100, 1000])
    axes.set(title="One weighted problem: a weight to choose", xlabel="weight of the pointing")


def _points(axes: Axes, summary: dict[str, Any], kind: str, chosen: Any) -> None:
    for condition in summary["conditions"]:
        over = _over_strict(summary, condition["name"])
        ran = [
            run
            for run in summary["spirals"]
            if run["condition"] == condition["name"] and run["allocation"] == kind
        ]
        points = [(chosen(run), over[run["strategy"]]) for run in ran if run["anti_windup"]]
        look = _LOOKS["hexapod, strut 1 stuck" if condition["stuck"] else "hexapod, no failure"]
        axes.plot(*zip(*points, strict=True), ls="", **look)
    axes.axhline(1.0, **_ONE)
    axes.set_ylabel("RMS error over strict priority's")
    logarithmic(axes, "xy")
    axes.set_ylim(bottom=0.9)
