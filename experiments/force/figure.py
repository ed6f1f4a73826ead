"""The figure of the force experiment."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.force.answers import InternalForce
from experiments.force.runs import Examination, Force
from experiments.force.tables import LIMIT_PERCENT
from experiments.study.plotting import BLACK, BLUE, GREEN, ORANGE, PAGE_IN, VERMILION, new_figure
from experiments.study.results import Picture

_SIZES = slice(3, 6), slice(0, 2)
"""Translation and pointing of a payload displacement."""


def pictures(force: Force, summary: dict[str, Any]) -> list[Picture]:
    """The study's figure and its caption."""
    caption = (
        "Theorems 7 to 9 in simulation, with all struts sound and with one locked, free, or loose "
        "(without its spring, too), and the platform's internal force. Pressing: the payload is "
        "clamped to a fixture that measures the wrench. Holding: the world pushes with the "
        "opposite wrench. Elastic mapping: it makes use of the free strut's spring."
    )
    alt = (
        "Six panels: distances from the theorems far below the limit of one percent; torques of "
        "the mapping beside others of the same major force; lock reactions on the line of "
        "prediction; displacement of the payload where predicted; torque of a hot motor reduced; "
        "leg forces that keep their sign."
    )
    return [Picture("force", caption, alt, partial(figure_force, force, summary))]


def figure_force(force: Force, summary: dict[str, Any]) -> Figure:
    """Agreement; what the optimum is worth; lock; free strut; internal force, twice."""
    figure = new_figure(PAGE_IN, 8.2)
    figure.suptitle("Static force mappings in simulation")
    panels = figure.subplots(3, 2)
    _agreement(panels[0, 0], summary)
    _tradeoff(panels[0, 1], force)
    _reactions(panels[1, 0], force.examinations)
    _prescribed(panels[1, 1], force.examinations)
    _hot_motors(panels[2, 0], summary["internal_force"])
    _squeeze(panels[2, 1], force.internal[-1])
    return figure


def _agreement(axes: Axes, summary: dict[str, Any]) -> None:
    conditions = summary["conditions"]
    for key, label, color, marker in (
        ("pressed_off_percent", "pressing on the fixture: wrench", BLUE, "o"),
        ("held_off_percent", "holding: strut forces", VERMILION, "s"),
        ("moved_percent", "holding: payload displacement", GREEN, "^"),
    ):
        off = [(at, trial[key]) for at, one in enumerate(conditions) for trial in one["theorems"]]
        axes.semilogy(*zip(*off, strict=True), marker, color=color, ms=3, alpha=0.7, label=label)
    axes.axhline(LIMIT_PERCENT, color=BLACK, lw=1, ls="--", label="limit of the check")
    axes.set_xticks(range(len(conditions)), [one["condition"] for one in conditions], rotation=90)
    axes.set_title("Theorems 7, 8, 9: simulation against theory")
    axes.set(ylabel="difference, %", ylim=(1e-7, None))
    axes.legend(loc="lower left", bbox_to_anchor=(0, 0.02))


def _tradeoff(axes: Axes, force: Force) -> None:
    trade = force.tradeoff
    least = trade.mapping.weighed[0]
    for tried, style, label in (
        (trade.others, {"color": BLUE, "marker": ".", "ls": ""}, "other torques, same major force"),
        (trade.pseudo_inverse, {"color": VERMILION, "marker": "s"}, "weighted pseudo-inverse"),
        (trade.mapping, {"color": BLACK, "marker": "*", "ms": 9, "ls": ""}, "force mapping"),
    ):
        axes.semilogy(tried.weighed / least, 100 * tried.major_off, label=label, **style)
    axes.axhline(LIMIT_PERCENT, color=BLACK, lw=1, ls="--", label="limit of the check")
    axes.set_title("Sound hexapod: one major force, several torques")
    axes.set(xlabel="weighted torque / that of the mapping", ylabel="error of the major force, %")
    axes.set_ylim(bottom=1e-6)
    axes.legend(loc="lower right")


def _reactions(axes: Axes, examinations: list[Examination]) -> None:
    locked = [
        (trial, one.condition.strut)
        for one in examinations
        if one.condition.kind == "locked"
        for trial in one.trials
    ]
    predicted = np.concatenate([trial.answer.strut[:, strut] for trial, strut in locked])
    held = np.concatenate([trial.held.lock_n[:, -1, strut] for trial, strut in locked])
    pressed = np.concatenate([trial.pressed.lock_n[:, -1, strut] for trial, strut in locked])
    ends = [predicted.min(), predicted.max()]
    axes.plot(ends, ends, color=BLACK, lw=1, label="equal to the prediction")
    axes.plot(predicted, held, "s", color=VERMILION, ms=3, label="holding")
    axes.plot(predicted, pressed, "o", color=BLUE, ms=3, label="pressing: shared with the fixture")
    axes.set_title("Locked strut: reaction force of the lock")
    axes.set(xlabel="predicted by eq. (11), N", ylabel="simulated, N", ylim=(None, 28))
    axes.legend(loc="upper left")


def _prescribed(axes: Axes, examinations: list[Examination]) -> None:
    freed = [one for one in examinations if one.condition.kind == "free"]
    for mapping, label, color in (
        ("rigid", "rigid mapping", BLUE),
        ("elastic", "elastic mapping", ORANGE),
    ):
        ways = [held for one in freed for held in one.prescribed if held.mapping == mapping]
        for source, style in (
            ("predicted", {"marker": "o", "mfc": "none", "ms": 8}),
            ("simulated", {"marker": "x", "ms": 5}),
        ):
            moved = 1e6 * np.vstack([getattr(way, source) for way in ways])
            translation, tilt = (np.linalg.norm(moved[:, part], axis=1) for part in _SIZES)
            style |= {"label": f"{label}, {source}", "color": color, "ls": ""}
            axes.plot(translation, tilt, **style)
    axes.set_title("Free strut with its spring, prescribed wrench")
    axes.set(xlabel="payload translation, µm", ylabel="change of pointing, µrad")
    axes.legend(loc="center right", bbox_to_anchor=(1, 0.4))


def _hot_motors(axes: Axes, uses: list[dict[str, Any]]) -> None:
    hot = [use for use in uses if use["motor"]]
    ways = (("without", "without internal force", ORANGE), ("used", "with internal force", BLUE))
    for k, (how, label, color) in enumerate(ways):
        place = np.arange(len(hot)) + 0.4 * k - 0.2
        motor_n, weighed_n = (
            [use[how][key] for use in hot] for key in ("hot_motor_rms_n", "weighed_rms_n")
        )
        axes.bar(place, motor_n, 0.38, color=color, label=f"hot motor, {label}")
        label = None if k else "all motors, weighted: $|W_3 \\tau|$"
        axes.plot(place, weighed_n, "D", color=BLACK, ms=3.5, label=label)
    axes.set_xticks(range(len(hot)), [use["name"] for use in hot])
    axes.set_title("Platform: less torque of a hot motor, same wrench")
    axes.set_ylabel("motor force, RMS of all wrenches, N")
    axes.margins(y=0.5)
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper center")


def _squeeze(axes: Axes, use: InternalForce) -> None:
    ways = (
        (use.without, "without internal force", ORANGE),
        (use.used, "with internal force", BLUE),
    )
    for k, (how, label, color) in enumerate(ways):
        for leg in range(4):
            force = how.pressed.strut_n[:, -1, leg]
            place = np.full(len(force), leg + 1 + 0.2 * k - 0.1)
            axes.plot(place, force, "o", color=color, ms=3.5, label=None if leg else label)
    axes.axhline(0, color=BLACK, lw=1, label="zero")
    axes.set_xticks(range(1, 5), [f"leg {leg}" for leg in range(1, 5)])
    axes.set(title="Platform squeezed: leg forces keep their sign", ylabel="force on the pin, N")
    axes.margins(y=0.35)
    axes.legend(loc="upper center", ncols=2)
