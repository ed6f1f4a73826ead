"""The figure of `fjh recover`: how fast, what recovery is worth, and how wrong the model may be."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from experiments.study.campaign import Row
from experiments.study.plotting import (
    BLUE,
    GREEN,
    ORANGE,
    PAGE_IN,
    PURPLE,
    SKY,
    VERMILION,
    new_figure,
)
from experiments.study.results import Picture
from ftc.fdi.fault_model import KINDS
from sim import Array

_KINDS = {"locked": BLUE, "free": VERMILION, "weak": GREEN}
_AFTER = {
    "supervised": ("supervised", BLUE),
    "unaware": ("fault-unaware", ORANGE),
    "other": ("the other controller", PURPLE),
}
"""Controllers whose error after recovery is compared with that of an informed one."""
GROUPS = {
    "coils: gain, hysteresis": ("gain", "hysteresis"),
    "springs, dampers, masses": ("stiffness", "damping", "inertia"),
    "delay, integrator step": ("delay_ticks", "timestep_s"),
    "floor vibration": ("floor_um_per_s",),
    "drifts of coils and detector": ("gain_drift_per_s", "drift_urad_per_s"),
    "all at once": ("all",),
}
"""Mismatches of plant and model, by where they are."""
_ALL, _NOT_ALL = SKY, ORANGE


def pictures(summary: dict[str, Any], rows: Sequence[Row]) -> list[Picture]:
    """The study's figure and its caption."""
    picture = Picture(
        "recover",
        f"{headline(summary)} Above, with all mismatches of plant and model: time until the first "
        "diagnosis names the failed strut, and RMS pointing error after recovery over that of a "
        "controller informed at once, a step for each flight. Below: how often the first strut "
        "named was the failed one, by the size of the mismatch; 1 is that of the other panels.",
        "Above left: three rising steps, the share of failures whose strut is named, against the "
        "time since the failure. Above right: the supervised controller's error is that of an "
        "informed one, the unaware controller's is larger. Below: a table of groups of "
        "mismatches against their size, with the count of failures whose strut was rightly named.",
        partial(figure_recover, summary, rows),
    )
    return [picture]


def headline(summary: dict[str, Any]) -> str:
    """How many struts were identified, and how fast, in one sentence."""
    entry = next(one for one in summary["failures"] if one["mismatch"] == "all")
    strut, named = entry["strut"], entry["named_ms"]
    found = f"The failed strut was identified in {strut['right']} of {strut['cases']} failures"
    return f"{found}, {named['median']:.0f} ms after onset (median)." if named else f"{found}."


def figure_recover(summary: dict[str, Any], rows: Sequence[Row]) -> Figure:
    """How fast, what recovery is worth, and what a wrong model costs."""
    cases = [row for row in rows if (row["sort"], row["mismatch"]) == ("failure", "all")]
    cases = [row for row in cases if row["status"] == "flown"]
    figure = new_figure(PAGE_IN, 5.4)
    figure.suptitle(headline(summary))
    panels = figure.subplot_mosaic("da;ss", height_ratios=[1.25, 1])
    draw_delays(panels["d"], cases)
    draw_after(panels["a"], cases)
    draw_sizes(panels["s"], summary["sizes"])
    cells = {"rightly named in all failures": _ALL, "wrong or not named in some": _NOT_ALL}
    handles = [Patch(color=color, label=label) for label, color in cells.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def draw_delays(axes: Axes, cases: Sequence[Row]) -> None:
    """Share of failures whose strut is named, over the time since then."""
    named = {
        kind: sorted(c["named_ms"] for c in cases if c["kind"] == kind and c["strut_right"])
        for kind in KINDS
    }
    latest_ms = max((ms for delays in named.values() for ms in delays), default=10)
    for kind, delays in named.items():
        if count := sum(case["kind"] == kind for case in cases):
            label = f"{kind}: {len(delays)} of {count}"
            _steps(axes, [*delays, latest_ms], len(delays), count, label, _KINDS[kind])
    axes.set_title(f"Naming the strut takes at most {latest_ms:.0f} ms")
    axes.set(xlabel="time since the failure, ms", ylabel="share of failures named, %")
    axes.set(xlim=(0, 1.08 * latest_ms))
    _legend_above(axes)


def draw_after(axes: Axes, cases: Sequence[Row]) -> None:
    """Share of flights whose error after recovery is at most so many times the informed one's."""
    for name, (label, color) in _AFTER.items():
        if compared := [case for case in cases if f"rms_{name}_after_urad" in case]:
            over = sorted(_over_informed(compared, name))
            _steps(axes, over, len(over), len(over), f"{label}: up to {over[-1]:.2f}", color)
    worst = _over_informed(cases, "supervised").max()
    axes.set_title(
        f"After recovery the error is at most {worst:.2f} times\n"
        "that of a controller informed at once"
    )
    axes.set(xlabel="RMS error / RMS error if informed", ylabel="share of flights, %")
    axes.set(ylim=(-4, 104))
    _legend_above(axes)


def _legend_above(axes: Axes) -> None:
    """Over shares of up to 100 %, where no curve is, whatever the flights."""
    axes.set(ylim=(-4, 150), yticks=range(0, 101, 20))
    axes.legend(loc="upper center")


def _over_informed(cases: Sequence[Row], name: str) -> Array:
    ours, theirs = (
        np.array([case[f"rms_{controller}_after_urad"] for case in cases])
        for controller in (name, "informed")
    )
    return ours / theirs


def _steps(
    axes: Axes, at: Sequence[float], reached: int, count: int, label: str, color: str
) -> None:
    """A step of 1 / count at each of the first values `at`, in ascending order."""
    shares = 100 * np.minimum(np.arange(len(at) + 1), reached) / count
    axes.step([at[0], *at], shares, where="post", color=color, label=label)


def draw_sizes(axes: Axes, sizes: Sequence[dict[str, Any]]) -> None:
    """A cell for each group and size: in how many failures the strut is rightly named.

    An exact plant, size zero, has no mismatch of any group.
    """
    factors = sorted({entry["factor"] for entry in sizes} - {0.0})
    flown = {entry["mismatch"] for entry in sizes}
    groups = {group: names for group, names in GROUPS.items() if flown.intersection(names)}
    for row, names in enumerate(groups.values()):
        for column, factor in enumerate(factors):
            own = [e["strut"] for e in sizes if e["mismatch"] in names and e["factor"] == factor]
            if own:
                right, count = (sum(strut[key] for strut in own) for key in ("right", "cases"))
                color = _ALL if right == count else _NOT_ALL
                corner = column - 0.5, row - 0.5
                axes.add_patch(Rectangle(corner, 1, 1, fc=color, ec="white"))
                axes.text(column, row, f"{right} of {count}", ha="center", va="center")
    axes.set_title(
        f"The strut is always rightly named up to {tolerated(sizes):g} times the mismatch"
    )
    axes.set_xticks(range(len(factors)), [f"{factor:g}" for factor in factors])
    axes.set_yticks(range(len(groups)), list(groups))
    axes.set(xlabel="size of the mismatch", xlim=(-0.5, len(factors) - 0.5))
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.grid(visible=False)


def tolerated(sizes: Sequence[dict[str, Any]]) -> float:
    """The largest size up to which the first strut named was the failed one in every flight."""
    wrong = [e["factor"] for e in sizes if e["strut"]["right"] < e["strut"]["cases"]]
    return max((e["factor"] for e in sizes if e["factor"] < min(wrong, default=np.inf)), default=0)
