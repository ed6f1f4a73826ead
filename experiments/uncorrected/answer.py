"""The answer as a table and in one paragraph, from `uncorrected.json`."""

from typing import Any

import numpy as np

from experiments.rig.hexapod.metrics import is_cut
from experiments.study.tables import Column, Table, tabulate

_SHOWN = ("W_a", "W_d", "W_e")


def table(summary: dict[str, Any]) -> Table:
    """One row for each candidate, and one for the paper where the whole spiral was run."""
    paper = summary["paper"]
    printed = {"name": "the paper", "ratio": [paper["alpha_ratio"], paper["beta_ratio"]]}
    printed["columns"] = [
        {"name": name, "rms_urad": urad, "simulated_urad": urad}
        for name, urad in paper["columns_urad"].items()
    ]
    columns = [
        Column("", lambda one: one["name"].replace("_", " ")),
        Column("ratios", lambda one: _numbers(one["ratio"], ".2f") if one["ratio"] else "-"),
        *(Column(name, lambda one, name=name: _rms(one["columns"], name)) for name in _SHOWN),
    ]
    return tabulate(
        "Strut 1 locked, uncorrected: RMS errors of alpha, beta divided by those of W_a",
        columns,
        [*summary["candidates"], *([] if is_cut(summary) else [printed])],
        "W_a, W_d, W_e: RMS errors of alpha, beta [urad]; *: from the linear model, not simulated.",
    )


def _rms(columns: list[dict[str, Any]], name: str) -> str:
    """A star: by the linear model, not simulated."""
    column = next(column for column in columns if column["name"] == name)
    if column["rms_urad"] is None:
        return "unstable"
    return _numbers(column["rms_urad"], ".1f") + ("" if column["simulated_urad"] else " *")


def _numbers(values: list[float], digits: str) -> str:
    return ", ".join(format(value, digits) for value in values)


def paragraph(summary: dict[str, Any]) -> str:
    """The answer in one paragraph, to be cited; `summary` is everything but this paragraph."""
    paper, by_name = summary["paper"], {one["name"]: one for one in summary["candidates"]}
    lost, best = by_name["lost_strut"], by_name[summary["best"]]
    cost = (
        f"a lost strut alone gives {_pair(lost['ratio'])} in this simulation, "
        f"{_pair(lost['predicted_ratio'])} in its linear model ({summary['duration_s']:g} s of "
        f"spiral, seed {summary['seed']}), and {_pair(paper['fast_loop_ratio'])} in any linear "
        "loop much faster than the spiral, whatever its compensators."
    )
    if is_cut(summary):
        return f"Part of the spiral only, not to be compared with Table I: {cost}"
    tolerance = f"{100 * paper['ratio_tolerance']:.0f} %"
    met = [one for one in summary["candidates"] if one["meets_ratios"]]
    return " ".join(
        [
            f"Chen, McInroy and Yi's uncorrected lock multiplies the RMS pointing errors by "
            f"{paper['alpha_ratio']:.2f} (alpha) and {paper['beta_ratio']:.2f} (beta); {cost}",
            f"Of {len(summary['candidates']) - 1} candidate explanations simulated, "
            f"{_met(met, tolerance)}.",
            _nearest(best, paper),
            _walk_sentence(summary["beam_walk"]),
            f"The paper's error in excess of a lost strut's has alpha : beta = "
            f"{_excess(summary):.1f} : 1; strut 1 moves them "
            f"{paper['strut_1_alpha_over_beta']:.1f} : 1.",
            _map_sentence(summary["map"]),
            *_conclusion(summary),
        ]
    )


def _met(met: list[dict[str, Any]], tolerance: str) -> str:
    if not met:
        return f"none is within {tolerance} of both ratios"
    names = "; ".join(f"{_name(one)} ({one['what']})" for one in met)
    return f"{names} {'is' if len(met) == 1 else 'are'} within {tolerance} of both ratios"


def _nearest(best: dict[str, Any], paper: dict[str, Any]) -> str:
    what = (
        ", ".join(f"{key} = {value:g}" for key, value in best["differs"].items())
        or "nothing changed"
    )
    columns = {column["name"]: column["rms_urad"] for column in best["columns"]}
    others = ", ".join(
        f"{name} {_pair(columns[name])} (paper {_pair(paper['columns_urad'][name])})"
        for name in _SHOWN
        if columns[name] is not None
    )
    return (
        f"The nearest is {_name(best)} with {_pair(best['ratio'])} ({what}); its other columns, "
        f"in urad, are {others}."
    )


def _excess(summary: dict[str, Any]) -> float:
    """Ratio alpha : beta of the paper's last column in excess of the error of a lost strut."""
    paper = summary["paper"]["columns_urad"]
    lost = next(one for one in summary["candidates"] if one["name"] == "lost_strut")
    expected = np.array(lost["ratio"]) * paper["W_a"]
    beyond = np.sqrt(np.square(paper["W_a_uncorrected"]) - expected**2)
    return float(beyond[0] / beyond[1])


def _map_sentence(numbers: dict[str, Any]) -> str:
    alpha, beta = numbers["alpha_ratio_range"], numbers["beta_ratio_range"]
    return (
        f"Over damping and crossover the ratios are {alpha[0]:.2f} to {alpha[1]:.2f} and "
        f"{beta[0]:.2f} to {beta[1]:.2f} where the loops of W_a and of the uncorrected column are "
        f"stable "
        f"({numbers['points_stable']} of {numbers['points']} points, "
        f"{numbers['points_within_tolerance']} within tolerance); the uncorrected loop alone "
        f"is unstable at {numbers['points_uncorrected_alone_unstable']} points, a corrected loop "
        f"alone at {numbers['points_corrected_alone_unstable']}."
    )


def _walk_sentence(numbers: dict[str, Any]) -> str:
    low, high = numbers["offset_m"]
    return (
        f"With a detector {low:g} to {high:g} m off the focus both ratios are met at "
        f"{numbers['offsets_met']} of {numbers['offsets']} offsets (at most "
        f"{_pair(numbers['largest_ratio_true'])} for the true angles, "
        f"{_pair(numbers['largest_ratio_detector'])} for the detector's)."
    )


def _conclusion(summary: dict[str, Any]) -> list[str]:
    explained = [one for one in summary["candidates"] if one["explains"]]
    spared = [one for one in summary["candidates"] if one["explains_if_corrected_settled"]]
    if explained:
        fewest = min(explained, key=lambda one: (one["numbers_changed"], one["choices_changed"]))
        said = [
            f"With all runs started alike, {', '.join(map(_name, explained))} also leave W_a "
            f"within 15 % and W_d and W_e within 25 % of Table I; {_name(fewest)} changes least, "
            f"{_changed(fewest)}."
        ]
    else:
        said = [
            "With all runs started alike, none meets both ratios and leaves W_a within 15 % and "
            "W_d and W_e within 25 % of Table I."
        ]
    for one in spared:
        if one["explains"]:
            continue
        settled = one["settled_corrected_urad"]
        said.append(
            f"If the uncorrected run alone started off centre, and W_d and W_e with settled loops, "
            f"W_d and W_e would be {_pair(settled['W_d'])}, and {_pair(settled['W_e'])} in the "
            f"linear model; {_name(one)} ({_changed(one)}) then also meets the whole table, with "
            f"a gain margin of {min(filter(None, one['gain_margin_db'])):.1f} dB."
        )
    return said


def _changed(candidate: dict[str, Any]) -> str:
    numbers, choices = candidate["numbers_changed"], candidate["choices_changed"]
    words = [f"{numbers} number{'s' * (numbers != 1)}"]
    if choices:
        words.append(f"{choices} binary choice{'s' * (choices != 1)}")
    return " and ".join(words)


def _pair(values: list[float]) -> str:
    return f"{values[0]:.2f} and {values[1]:.2f}"


def _name(candidate: dict[str, Any]) -> str:
    return f'"{candidate["name"].replace("_", " ")}"'
