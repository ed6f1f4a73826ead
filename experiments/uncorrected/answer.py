"""The answer in one paragraph, composed from the numbers of the run."""

from typing import Any

import numpy as np


def paragraph(summary: dict[str, Any]) -> str:
    """What a reader could cite; `summary` is all but the paragraph itself."""
    paper, by_name = summary["paper"], {one["name"]: one for one in summary["candidates"]}
    lost, best = by_name["lost_strut"], by_name[summary["best"]]
    tolerance = f"{100 * paper['ratio_tolerance']:.0f} %"
    met = [one for one in summary["candidates"] if one["meets_ratios"]]
    count = len(summary["candidates"]) - 1
    sentences = [
        f"Chen, McInroy and Yi's uncorrected lock multiplies the RMS pointing errors by "
        f"{paper['alpha_ratio']:.2f} (alpha) and {paper['beta_ratio']:.2f} (beta); a lost strut "
        f"alone gives {_pair(lost['ratio'])} on this bench, {_pair(lost['predicted_ratio'])} in "
        f"its linear model ({summary['duration_s']:g} s of spiral, seed {summary['seed']}).",
        f"Of {count} candidate explanations simulated, {_met(met, tolerance)}.",
        _nearest(best, paper),
        f"The paper's excess over a lost strut points {_excess(summary):.1f} : 1 along "
        f"alpha : beta, strut 1 itself {paper['strut_1_alpha_over_beta']:.1f} : 1.",
        _map_sentence(summary["map"]),
        _conclusion(summary),
    ]
    if summary["duration_s"] < summary["bench"]["duration_s"]:
        sentences.insert(0, "Part of the spiral only, not to be compared with Table I.")
    return " ".join(sentences)


def _met(met: list[dict[str, Any]], tolerance: str) -> str:
    if not met:
        return f"none comes within {tolerance} of both ratios"
    names = " and ".join(_words(one) for one in met)
    return f"{names} {'comes' if len(met) == 1 else 'come'} within {tolerance} of both ratios"


def _nearest(best: dict[str, Any], paper: dict[str, Any]) -> str:
    what = ", ".join(f"{key} = {value:g}" for key, value in best["differs"].items()) or "as it is"
    columns = {column["name"]: column["rms_urad"] for column in best["columns"]}
    told = ", ".join(
        f"{name} {_pair(columns[name])} (paper {_pair(paper['columns_urad'][name])})"
        for name in ("W_a", "W_d", "W_e")
        if columns[name] is not None
    )
    return (
        f"Nearest is {_name(best)} with {_pair(best['ratio'])} ({what}); the other columns then "
        f"are, in urad, {told}."
    )


def _excess(summary: dict[str, Any]) -> float:
    """Direction alpha : beta of what the paper's last column has beyond a lost strut's cost."""
    paper = summary["paper"]["columns_urad"]
    lost = next(one for one in summary["candidates"] if one["name"] == "lost_strut")
    expected = np.array(lost["ratio"]) * paper["W_a"]
    beyond = np.sqrt(np.square(paper["W_a_uncorrected"]) - expected**2)
    return float(beyond[0] / beyond[1])


def _map_sentence(numbers: dict[str, Any]) -> str:
    alpha, beta = numbers["alpha_ratio_range"], numbers["beta_ratio_range"]
    return (
        f"Over damping and crossover the ratios stay within {alpha[0]:.2f} to {alpha[1]:.2f} and "
        f"{beta[0]:.2f} to {beta[1]:.2f} wherever W_a's and the uncorrected loop are stable "
        f"({numbers['points_stable']} of {numbers['points']} points, "
        f"{numbers['points_within_tolerance']} within tolerance); the uncorrected loop alone "
        f"is unstable at {numbers['points_uncorrected_alone_unstable']} points, a corrected loop "
        f"alone at {numbers['points_corrected_alone_unstable']}."
    )


def _conclusion(summary: dict[str, Any]) -> str:
    if summary["explained_by"]:
        return f"W_a, W_d and W_e agree as well: it is explained by {summary['explained_by'][0]}."
    none = (
        "With all columns started alike, none meets both ratios and leaves W_a within 15 % and W_d "
        "and W_e within 25 % of Table I."
    )
    spared = [one for one in summary["candidates"] if one["explains_if_corrected_settled"]]
    if not spared:
        return none
    one = spared[0]
    settled = one["settled_corrected_urad"]
    return (
        f"{none} If the uncorrected run alone began off centre, and W_d and W_e with the loop "
        f"settled, these would be {_pair(settled['W_d'])}, and {_pair(settled['W_e'])} in the "
        f"linear model: then {_name(one)} meets the whole table, at a gain margin of "
        f"{min(filter(None, one['gain_margin_db'])):.1f} dB."
    )


def _pair(values: list[float]) -> str:
    return f"{values[0]:.2f} and {values[1]:.2f}"


def _name(candidate: dict[str, Any]) -> str:
    return f'"{candidate["name"].replace("_", " ")}"'


def _words(candidate: dict[str, Any]) -> str:
    return f"{_name(candidate)} ({candidate['what']})"
