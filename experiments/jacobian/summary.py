"""The study of the Jacobian as data: `jacobian.json`, and one paragraph to cite."""

from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.hexapod import paper
from experiments.hexapod.provenance import plant_constants
from experiments.hexapod.testbed import Bench
from experiments.jacobian.norms import NORMS, Norm, size
from experiments.jacobian.study import JacobianStudy
from experiments.jacobian.tried import Trial
from experiments.jacobian.variation import Variation
from experiments.output.provenance import versions
from sim import load_model, model_sha256

CERTIFICATE_LIMIT = 1.02
"""Largest ratio of the certified bound to the value found."""
SAME_JACOBIAN = 1e-9
"""Largest difference of eq. (39) from geometry and from the MJCF."""


def summarize(study: JacobianStudy, seed: int) -> dict[str, Any]:
    """All numbers that need no dynamics, ready for JSON."""
    base, *_ = study.variations.values()
    summary: dict[str, Any] = {
        "experiment": "jacobian",
        "seed": seed,
        "versions": versions(),
        "model_sha256": model_sha256(),
        "bench": asdict(Bench()) | plant_constants(load_model()),
        "stroke_m": paper.STROKE_M,
        "J0": study.J_0.tolist(),
        "J0_from_mjcf_largest_difference": float(np.abs(study.J_0_mjcf - study.J_0).max()),
        "J0_printed_largest_difference": float(np.abs(paper.JACOBIAN - study.J_0).max()),
        "condition_number": float(np.linalg.cond(study.J_0)),
        "paper_condition_number": paper.CONDITION_NUMBER,
        "variation": {norm: _certified(study, base[norm], norm) for norm in NORMS},
        "readings": {
            name: {norm: _found(by_norm[norm]) for norm in NORMS}
            for name, by_norm in study.variations.items()
        },
        "tried": [_trial(one) for one in study.tried],
        "newton_error_m": study.newton_error_m,
    }
    return summary | {"paragraph": _paragraph(summary)}


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what makes the study unsound; None when nothing does."""
    if not summary["J0_from_mjcf_largest_difference"] < SAME_JACOBIAN:
        off = summary["J0_from_mjcf_largest_difference"]
        return f"eq. (39) from geometry and from the MJCF differ by {off:.1e}"
    for norm, one in summary["variation"].items():
        value, bound = one["value"], one["certified_upper_bound"]
        if bound is None or not value <= bound < CERTIFICATE_LIMIT * value:
            return f"in the {norm} norm e is {value:.6f}, certified to be at most {bound}"
    return None


def _certified(study: JacobianStudy, found: Variation, norm: Norm) -> dict[str, Any]:
    nominal, certificate = float(size(study.J_0, norm)), study.certificates[norm]
    linear, quadratic, cubic = (term / nominal for term in certificate.terms)
    holds = bool(np.isfinite(certificate.upper_bound))
    return _found(found) | {
        "certified_upper_bound": certificate.upper_bound / nominal if holds else None,
        "paper": paper.JACOBIAN_VARIATION[norm],
        "certificate": {
            "linear": linear,
            "quadratic": quadratic,
            "cubic": cubic,
            "remainder": certificate.remainder / nominal if holds else None,
        },
    }


def _found(variation: Variation) -> dict[str, Any]:
    return {"value": variation.value, "at_strut_m": variation.at_strut_m.tolist()}


def _trial(trial: Trial) -> dict[str, Any]:
    return {
        "reading": trial.name,
        **trial.e,
        "is_the_papers": trial.is_the_papers,
        "stroke_fraction": trial.stroke_fraction,
    }


def _paragraph(summary: dict[str, Any]) -> str:
    """What a reader could cite."""
    frobenius, two = (summary["variation"][norm] for norm in ("frobenius", "two"))
    ours = [one for one in summary["tried"] if one["is_the_papers"]]
    if ours:
        names = " and ".join(f'"{one["reading"]}"' for one in ours)
        where = f"Of {len(summary['tried'])} readings of (40) that were tried, {names} gives both"
    else:
        where = f"None of the {len(summary['tried'])} readings of (40) that were tried gives both"
    return (
        f"Over the stroke of +-{1e3 * summary['stroke_m']:g} mm (searches with seed "
        f"{summary['seed']}) the Jacobian of the University of Wyoming hexapod departs from its "
        f"nominal value by e = {frobenius['value']:.5f} in the Frobenius norm and "
        f"{two['value']:.5f} in the 2-norm (eq. 40), and provably by no more than "
        f"{frobenius['certified_upper_bound']:.5f} and {two['certified_upper_bound']:.5f}. "
        f"Chen, McInroy and Yi print {frobenius['paper']:.4f} and {two['paper']:.4f}, which their "
        f"own geometry exceeds {frobenius['value'] / frobenius['paper']:.1f} and "
        f"{two['value'] / two['paper']:.1f} times. {where}. That J hardly changes stands: e is at "
        f"most {100 * max(one['certified_upper_bound'] for one in (frobenius, two)):.2f} % "
        f"(condition number of J: {summary['condition_number']:.2f})."
    )
