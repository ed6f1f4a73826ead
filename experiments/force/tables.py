"""Tables and checks of the force experiment, from `force.json`."""

from collections.abc import Callable
from typing import Any

from experiments.rig.checks import closure_check
from experiments.study.results import Check
from experiments.study.tables import Column, Table, tabulate

LIMIT_PERCENT = 1.0
"""Largest difference between a simulated force or motion and its prediction."""
COST_LIMIT = 1e-9
"""Largest relative excess over the minimum cost, which an independent solver computes."""
ROUND_OFF_N = 1e-9


def checks(summary: dict[str, Any]) -> list[Check]:
    """Checks: forces and motions against the prediction, and the cost against other torques."""
    trade = summary["tradeoff"]
    advantage = 1 / trade["others"]["cheapest_over_mapping"]
    what = "weighted torque divided by the least of other torques with this major force"
    found = [check for one in summary["conditions"] for check in _condition_checks(one)]
    found.append(Check(what, "the mapping", advantage, 1.0))
    for how, where in (("mapping", "the mapping"), ("others", "other torques")):
        found.append(_off("the major force", where, trade[how]["major_off_percent"]))
    what = "weighted torque with internal force minus that without [N]"
    for use in summary["internal_force"]:
        where = f"platform, {use['name']}"
        found.append(Check(what, where, -use["saved_at_least_n"], ROUND_OFF_N))
        for how in ("without", "used"):
            exerted = f"{where}, internal force {how}"
            found.append(_off("the wrench on the fixture", exerted, use[how]["wrench_off_percent"]))
            found.append(_off("the leg forces", exerted, use[how]["legs_off_percent"]))
    return found


def _condition_checks(one: dict[str, Any]) -> list[Check]:
    found = [closure_check(one["condition"], one["closure_residual_max_m"])]
    for trial in one["theorems"]:
        where = f"{one['condition']}, theorem {trial['theorem']}"
        found += [
            Check("status other than exact", where, float(not trial["exact"]), 0.5),
            Check("relative excess over the minimum cost", where, trial["cost_excess"], COST_LIMIT),
            _off("the wrench on the fixture", where, trial["pressed_off_percent"]),
            _off("the strut forces", where, trial["held_off_percent"]),
            _off("the payload's position", where, trial["moved_percent"]),
        ]
        # Clamped, a lock and the fixture share what no torque sees: no major force is claimed.
        if one["kind"] != "locked":
            found.append(_off("the major force", where, trial["pressed_major_off_percent"]))
    for held in one["prescribed"]:
        where = f"{one['condition']}, prescribed wrench, {held['mapping']} mapping"
        found.append(_off("the payload's position", where, held["off_percent"]))
    return found


def _off(what: str, where: str, percent: float) -> Check:
    return Check(f"difference between {what} and the prediction [%]", where, percent, LIMIT_PERCENT)


def tables(summary: dict[str, Any]) -> list[Table]:
    """All tables, in the order in which they are printed."""
    return [
        _exactness(summary["conditions"]),
        _prescribed(summary["conditions"]),
        _tradeoff(summary["tradeoff"]),
        _internal(summary["internal_force"]),
    ]


def _exactness(conditions: list[dict[str, Any]]) -> Table:
    def worst(key: str) -> Callable[[dict[str, Any]], str]:
        return lambda one: _percent(max(trial[key] for trial in one["theorems"]))

    def major(one: dict[str, Any]) -> str:
        return "-" if one["kind"] == "locked" else worst("pressed_major_off_percent")(one)

    def pressed(k: int) -> Callable[[dict[str, Any]], str]:
        return lambda one: _percent(one["theorems"][k]["pressed_off_percent"])

    return tabulate(
        "Theorems 7, 8, 9: error of the simulation, %",
        [
            Column("", "condition"),
            Column("major", major),
            *(Column(f"thm {7 + k}", pressed(k)) for k in range(3)),
            Column("struts", worst("held_off_percent")),
            Column("moves", worst("moved_percent")),
        ],
        conditions,
        "major: major force on a fixture. thm 7 to 9: whole wrench on a fixture, by theorem. "
        "struts, moves: strut forces and payload displacement when holding a wrench.",
    )


def _prescribed(conditions: list[dict[str, Any]]) -> Table:
    shown = [one for one in conditions if one["strut"] in (None, 1)]

    def label(held: dict[str, Any]) -> str:
        return (held["kind"] or "sound") + ", elastic" * (held["mapping"] == "elastic")

    def lock(held: dict[str, Any]) -> str:
        bears = held["reaction"]
        return _both(bears["simulated_n"][0], bears["predicted_n"][0]) if bears else "-"

    def first(key: str) -> Callable[[dict[str, Any]], str]:
        return lambda held: _both(held["simulated"][key][0], held["predicted"][key][0])

    return tabulate(
        "First prescribed wrench, strut 1 failed; simulated/predicted",
        [
            Column("", label),
            Column("lacking, N", lambda held: held["lacking_force_n"][0], ".2f"),
            Column("lock, N", lock),
            Column("moves, um", first("translation_um")),
            Column("tilts, urad", first("pointing_urad")),
        ],
        [one | held for one in shown for held in one["prescribed"]],
        "lacking: prescribed force that is not exerted. lock: reaction of the lock. moves, tilts: "
        "displacement of the payload.",
    )


def _tradeoff(trade: dict[str, Any]) -> Table:
    others = trade["others"]
    between = f"{others['cheapest_over_mapping']:.3f} to {others['dearest_over_mapping']:.2f}"
    rows = [
        ("the mapping", "1", trade["mapping"]),
        (f"{others['count']} other torques", between, others),
    ]
    for one in trade["pseudo_inverse"]:
        name = f"pseudo-inverse, w = {one['major_weight_per_n_m']:g}"
        rows.append((name, f"{one['weighed_over_mapping']:.3f}", one))
    return Table(
        "One major force, hexapod without failure",
        ("", "torque", "major error, %"),
        [(name, torque, _percent(one["major_off_percent"])) for name, torque, one in rows],
        "torque: weighted norm relative to the mapping's. major error: of the simulated force.",
    )


def _internal(uses: list[dict[str, Any]]) -> Table:
    def both(key: str) -> Callable[[dict[str, Any]], str]:
        return lambda use: (
            f"{use['without'][key]:.1f}, {use['used'][key]:.1f}" if key in use["used"] else "-"
        )

    def internal(use: dict[str, Any]) -> str:
        return _both(use["used"]["internal_simulated_rms_n"], use["used"]["internal_rms_n"])

    def off(use: dict[str, Any]) -> str:
        keys = ("wrench_off_percent", "legs_off_percent")
        return _percent(max(use[how][key] for how in ("without", "used") for key in keys))

    return tabulate(
        "Over-actuated platform, without and with internal force; RMS, N",
        [
            Column("", "name"),
            Column("torque", both("weighed_rms_n")),
            Column("hot", both("hot_motor_rms_n")),
            Column("squeeze", both("least_squeeze_n")),
            Column("internal", internal),
            Column("error, %", off),
        ],
        uses,
        "torque: weighted norm. hot: force of the motor with three times the weight. squeeze: "
        "least compression of a leg. internal: internal force, simulated/predicted. error: of the "
        "simulation.",
    )


def _both(simulated: float, predicted: float) -> str:
    return f"{simulated:.2f}/{predicted:.2f}"


def _percent(value: float) -> str:
    return f"{value:.1e}" if value < 0.01 else f"{value:.2f}"
