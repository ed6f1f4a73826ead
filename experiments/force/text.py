"""The force experiment in print, from `force.json`."""

from typing import Any

from experiments.force.soundness import complaint
from experiments.output.findings import Findings, Picture, Table

PICTURES = [
    Picture(
        "force.png",
        "Theorems 7 to 9 in simulation, sound, locked and free; the platform's internal force.",
        "Six panels: distances from the theorems far below the limit of one percent; the mapping "
        "as the cheapest exact torque; lock reactions on the line of prediction; a payload that "
        "settles where predicted; a hot motor relieved; and a grip that is kept.",
    )
]


def findings(summary: dict[str, Any]) -> Findings:
    """The tables; they need no further words."""
    return Findings(summary, tables(summary), [], PICTURES, complaint(summary))


def tables(summary: dict[str, Any]) -> list[Table]:
    """All of them, in print's order."""
    return [
        _exactness(summary["conditions"]),
        _prescribed(summary["conditions"]),
        _tradeoff(summary["tradeoff"]),
        _internal(summary["internal_force"]),
    ]


def _exactness(conditions: list[dict[str, Any]]) -> Table:
    def row(one: dict[str, Any]) -> tuple[str, ...]:
        trials = one["theorems"]

        def worst(key: str) -> str:
            return _percent(max(trial[key] for trial in trials))

        return (
            one["condition"],
            "-" if one["kind"] == "locked" else worst("pressed_major_off_percent"),
            *(_percent(trial["pressed_off_percent"]) for trial in trials),
            worst("held_off_percent"),
            worst("moved_percent"),
        )

    return Table(
        "Theorems 7, 8, 9: simulation off by, in percent",
        ("", "major", "thm 7", "thm 8", "thm 9", "struts", "moves"),
        [row(one) for one in conditions],
        "Pressing on a fixture: major force, and whole wrench by theorem. Holding: strut forces, "
        "and the motion of the payload.",
    )


def _prescribed(conditions: list[dict[str, Any]]) -> Table:
    rows = []
    for one in conditions:
        if one["strut"] not in (None, 1):
            continue
        bears = one["reaction"]
        lock = _both(bears["simulated_n"][0], bears["predicted_n"][0]) if bears else "-"
        for held in one["prescribed"]:
            label = one["kind"] or "sound"
            if held["mapping"] == "elastic":
                label += ", elastic"
            motion = [
                _both(held["simulated"][key][0], held["predicted"][key][0])
                for key in ("translation_um", "pointing_urad")
            ]
            rows.append((label, f"{held['lacking_force_n'][0]:.2f}", lock, *motion))
    return Table(
        "The first prescribed wrench, strut 1 failing; simulated/predicted",
        ("", "lacking, N", "lock, N", "moves, um", "tilts, urad"),
        rows,
        "Force not exerted, the lock's reaction, and how far the payload moves and tilts.",
    )


def _tradeoff(trade: dict[str, Any]) -> Table:
    others = trade["others"]
    between = f"{others['cheapest_over_mapping']:.3f} to {others['dearest_over_mapping']:.2f}"
    rows = [
        ("the mapping", "1", _percent(trade["mapping"]["major_off_percent"])),
        (f"{others['count']} other torques", between, _percent(others["major_off_percent"])),
    ]
    rows += [
        (
            f"pseudo-inverse, w = {one['major_weight_per_n_m']:g}",
            f"{one['weighed_over_mapping']:.3f}",
            _percent(one["major_off_percent"]),
        )
        for one in trade["pseudo_inverse"]
    ]
    return Table(
        "One major force on the sound hexapod",
        ("", "torque", "major off, %"),
        rows,
        "Weighted torque over the mapping's; simulated major force off by.",
    )


def _internal(uses: list[dict[str, Any]]) -> Table:
    def row(use: dict[str, Any]) -> tuple[str, ...]:
        without, used = use["without"], use["used"]

        def both(key: str) -> str:
            return f"{without[key]:.1f}, {used[key]:.1f}" if key in used else "-"

        off = [how[key] for how in (without, used) for key in how if key.endswith("percent")]
        return (
            use["name"],
            both("weighed_rms_n"),
            both("hot_motor_rms_n"),
            both("least_squeeze_n"),
            _both(used["internal_simulated_rms_n"], used["internal_rms_n"]),
            _percent(max(off)),
        )

    return Table(
        "Over-actuated platform, without and with its internal force; RMS, N",
        ("", "torque", "hot", "squeeze", "internal", "off, %"),
        [row(use) for use in uses],
        "Weighted torque; the hot motor; the least squeeze; internal force simulated/predicted; "
        "simulation off by.",
    )


def _both(simulated: float, predicted: float) -> str:
    return f"{simulated:.2f}/{predicted:.2f}"


def _percent(value: float) -> str:
    return f"{value:.1e}" if value < 0.01 else f"{value:.2f}"
