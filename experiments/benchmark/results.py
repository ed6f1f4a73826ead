"""The timings as frames: ratios, growth, checks, printed tables and the figure."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.benchmark.measurement import power_law
from experiments.benchmark.ratios import RATIOS
from experiments.benchmark.solvers import GROWING, OURS, batch_names
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.palette import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from experiments.study.plotting import PAGE_IN, logarithmic, name_rows, new_figure
from experiments.study.result import Check, Picture, Shown

if TYPE_CHECKING:
    from experiments.benchmark.runs import Timed

WORDS = {ratio.name: ratio.words for ratio in RATIOS if ratio.words is not None}
"""Of the ratios that compare with others."""


def tables_of(timed: "Timed") -> dict[str, pd.DataFrame]:
    """All numbers; times are in microseconds per call, control tick or mapping."""
    timings = timing_frame(timed)
    return {
        "ratios": pd.DataFrame([ratio.row(timed.samples_us) for ratio in RATIOS]),
        "timings": timings,
        "growth": growth_frame(timings),
        "latency": pd.DataFrame(timed.latency),
        "slowest": pd.DataFrame(timed.slowest),
        "out_of_reach": pd.DataFrame(timed.out_of_reach),
        "active_limits": pd.DataFrame(
            [
                {"question": question, "rates_at_a_limit": rates, "problems": problems}
                for question, counts in timed.active_limits.items()
                for rates, problems in enumerate(counts)
            ]
        ),
        "agreement": pd.DataFrame(
            [
                {"question": one.question, "contender": name, "distance": distance}
                | {"tolerance": one.tolerance}
                for one in timed.agreements
                for name, distance in one.distances.items()
            ]
        ),
    }


def timing_frame(timed: "Timed") -> pd.DataFrame:
    """Median and range of all samples of everything that is timed, and the size of its problem."""
    percentiles = {name: np.percentile(us, [50, 5, 95]) for name, us in timed.samples_us.items()}
    columns = ["median_us", "p5_us", "p95_us"]
    frame = pd.DataFrame.from_dict(percentiles, orient="index", columns=columns)
    frame.insert(0, "contender", frame.index)
    frame[["actuators", "batch"]] = np.nan
    for n in timed.effort.actuators:
        for each in GROWING:
            frame.loc[f"{each.name}_n{n}", ["contender", "actuators"]] = each.name, n
    for name, size in zip(batch_names(timed.effort.batches), timed.effort.batches, strict=True):
        frame.loc[name, ["contender", "batch"]] = OURS.name, size
    return frame.rename_axis("name").reset_index()


def growth_frame(timings: pd.DataFrame) -> pd.DataFrame:
    """Exponents of the time by number of actuators, and of a whole batch by its size.

    `least` and `most` are those of the flattest and the steepest piece between two sizes.
    """
    rows = [
        {"contender": name, "by": "actuators"} | power_law(group.actuators, group.median_us)
        for name, group in timings.dropna(subset="actuators").groupby("contender", sort=False)
    ]
    batch = timings.dropna(subset="batch")
    of_call = power_law(batch.batch, batch.median_us * batch.batch)
    return pd.DataFrame([*rows, {"contender": OURS.name, "by": "batch"} | of_call])


def checks(ratios: pd.DataFrame) -> list[Check]:
    """Stable ratios stay below their bounds, with a margin."""
    return [
        Check("ratio of medians", one.name, one.ratio, one.check_bound)
        for one in ratios.dropna(subset="check_bound").itertuples(index=False)
    ]


def shown(tables: Mapping[str, pd.DataFrame], seconds: float) -> list[Shown]:
    """The printed tables: ratios, and the times that they are made of."""
    timings, growth = tables["timings"], tables["growth"].set_index("contender")
    is_sized = timings.actuators.notna() | timings.batch.notna()
    growing = timings.dropna(subset="actuators")
    by_actuators = growing.pivot(index="contender", columns="actuators", values="median_us")
    by_actuators.columns = [f"{size:.0f}" for size in by_actuators]
    exponents = growth[growth.by == "actuators"].drop(columns="by")
    sizes = " ".join(f"{size}:.4g" for size in by_actuators)
    part = f", {seconds:g} s of the spiral" if seconds < TestbedConfig().duration_s else ""
    numbers = "median_us:.1f p5_us:.1f p95_us:.1f"
    return [
        Shown(
            f"Ratios of medians{part}",
            tables["ratios"],
            "name ratio:.3g p5:.3g p95:.3g bound:g goal:g met",
            "p5, p95: over the rounds. mink's update of the kinematics counts where this library's "
            "does. built: with the time that the other's users need for its problem.",
        ),
        Shown("Times", timings[~is_sized], f"name {numbers}", "Of a call, tick or mapping."),
        Shown(
            "One Problem 1 by number of actuators, us",
            by_actuators.join(exponents).reset_index(),
            f"contender {sizes} exponent:.2f least:.1f most:.1f",
            "exponent: of the best-fitting power; least, most: between neighbouring sizes.",
        ),
        Shown(
            "One mapping by size of the batch",
            timings.dropna(subset="batch"),
            "batch:,.0f median_us:.3g p5_us:.3g p95_us:.3g",
        ),
        Shown(
            "Single ticks in wall time",
            tables["latency"],
            "tick collector median_us:.1f p999_us:.1f worst_us:.0f worst_processor_us:.0f",
            "collector: of Python's garbage: on; frozen by gc.freeze(); off besides. "
            "worst_processor: without the time in which other processes had the processor.",
        ),
        Shown(
            "Ticks of a supervisor while an actuator locks",
            tables["slowest"],
            "robot mean_us:.0f slowest_us:.0f",
        ),
        Shown(
            "Major residual where limits hold the major task back",
            tables["out_of_reach"],
            "solver problems infeasible:.0f change_median:.1e change_largest:.1e "
            "excess_median:.1e excess_largest:.1e",
            "change: by other secondary weights, as a part of it. excess: over the least within "
            "the limits.",
        ),
    ]


def notes(
    tables: Mapping[str, pd.DataFrame], settings: Mapping[str, Any], packages: tuple[str, ...]
) -> list[str]:
    """Real-time factor, agreement, machine and versions."""
    us, agreed = tables["timings"].set_index("name").median_us, tables["agreement"]
    factor = 1e6 * TestbedConfig().control_period_s / us["closed_loop"]
    furthest = (agreed.distance / agreed.tolerance).max()
    names = ("mujoco", "numpy", "scipy", *packages)
    installed = ", ".join(f"{name} {settings['versions'][name]}" for name in names)
    return [
        f"The closed loop runs {factor:.1f} times as fast as real time.",
        f"All results agreed on {agreed.question.nunique()} sets of problems before the timing, to "
        f"{100 * furthest:.2g} % of the tolerance.",
        f"One process, one thread, {settings['rounds']} rounds in turn, on "
        f"{settings['machine']['processor']}; {installed}.",
    ]


# The figure.

_STYLES: dict[str, dict[str, Any]] = {
    "prioritized": {"label": "velocity_mapping", "color": BLACK, "marker": "o", "lw": 2.0},
    "daqp": {"label": "daqp", "color": GREEN, "marker": "s"},
    "placo": {"label": "PlaCo", "color": ORANGE, "marker": "D"},
    "pinv_formula": {"label": "eq. (25), pinv", "color": PURPLE, "marker": "^"},
    "dgglse": {"label": "LAPACK dgglse", "color": SKY, "marker": "v"},
}
_COLORS = {"less time": BLUE, "about as much": "0.5", "more time": VERMILION}


def picture(ratios: pd.DataFrame, timings: pd.DataFrame) -> Picture:
    """The study's figure and its caption."""
    return Picture(
        "bench",
        f"{headline(ratios)} Points: ratios of medians; lines: 5 to 95 % of the rounds.",
        "Above: a point for each ratio of times on a logarithmic axis, left of 1 where this "
        "library is faster. Below: time of one Problem 1 against the number of actuators; beyond "
        "20 actuators that of velocity_mapping grows least.",
        partial(figure_bench, ratios, timings),
    )


def comparisons(ratios: pd.DataFrame) -> pd.DataFrame:
    """Those with others, and whether each is below or above 1 in 95 % of the rounds."""
    others = ratios[ratios.name.isin(list(WORDS))]
    said = np.select([others.p95 < 1, others.p5 > 1], ["less time", "more time"], "about as much")
    return others.assign(comparison=said)


def headline(ratios: pd.DataFrame) -> str:
    """How many comparisons are won and lost, in one sentence."""
    found = comparisons(ratios).comparison
    less, alike, more = (int((found == name).sum()) for name in _COLORS)
    return (
        f"This library needs less time in {less} of {len(found)} comparisons, about as much in "
        f"{alike}, more in {more}."
    )


def figure_bench(ratios: pd.DataFrame, timings: pd.DataFrame) -> Figure:
    """Ratios above, growth below."""
    figure = new_figure(PAGE_IN, 5.8)
    figure.suptitle(headline(ratios))
    # Twelfths of the width: the names of the ratios stand on the left.
    panels = figure.subplot_mosaic("....rrrrrrr.;nnnnnnnnnnnn", height_ratios=[1.6, 1])
    _ratios(panels["r"], comparisons(ratios))
    _actuators(panels["n"], timings.dropna(subset="actuators"))
    return figure


def _ratios(axes: Axes, ratios: pd.DataFrame) -> None:
    """Each ratio with its range over the rounds, its value beside it."""
    axes.axvline(1, color=BLACK, lw=0.8, label="equal")
    is_new = ~ratios.comparison.duplicated()
    for row, (one, new) in enumerate(zip(ratios.itertuples(), is_new, strict=True)):
        style = {"color": _COLORS[one.comparison], "marker": "o", "ms": 5, "lw": 1.5}
        label = one.comparison if new else None
        axes.plot([one.p5, one.ratio, one.p95], [row] * 3, **style, markevery=[1], label=label)
    axes.set_yticks(range(len(ratios)), [""] * len(ratios))
    name_rows(axes, [WORDS[name] for name in ratios.name])
    name_rows(axes, [f"{ratio:#.2g}" for ratio in ratios.ratio], right=True)
    axes.set(xlabel="time / time: left is better", ylim=(len(ratios) - 0.5, -0.5))
    logarithmic(axes, "x")
    axes.legend(loc="best")


def _actuators(axes: Axes, timings: pd.DataFrame) -> None:
    """Time over the number of actuators, for each solver."""
    for name, group in timings.groupby("contender", sort=False):
        axes.plot(group.actuators, group.median_us, **_STYLES[str(name)])
    largest = timings[timings.actuators == timings.actuators.max()].set_index("contender")
    ours, daqp = (largest.median_us[name] for name in ("prioritized", "daqp"))
    axes.set_title(
        f"One Problem 1 of {largest.actuators.iloc[0]:.0f} actuators takes {ours:.0f} µs, "
        f"with daqp {daqp:.0f} µs"
    )
    axes.set(xlabel="actuators", ylabel="time, µs: lower is better", xscale="log", yscale="log")
    axes.set_xticks(sizes := timings.actuators.unique(), [f"{size:.0f}" for size in sizes])
    axes.minorticks_off()
    axes.legend(loc="upper left", ncols=2)
