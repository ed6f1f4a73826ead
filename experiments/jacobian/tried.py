"""Looking for the reading of eq. (40) that gives the paper's 0.0012 and 0.0018."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from experiments.hexapod import paper
from experiments.jacobian.norms import NORMS, Norm, size
from experiments.jacobian.readings import at_height, in_millimetres, inverse
from experiments.jacobian.variation import (
    VERTICES,
    Reading,
    jacobian,
    relative_change,
    twist_in_base_axes,
    variation,
)
from sim import Array, Hexapod


@dataclass(frozen=True)
class Trial:
    """One way to read eq. (40), and what comes out.

    Attributes:
        name: What is varied, and how e is taken from it.
        e: By norm.
    """

    name: str
    e: dict[Norm, float]

    @property
    def is_the_papers(self) -> bool:
        """Both numbers are the printed ones, rounding allowed for."""
        return all(
            abs(self.e[norm] - paper.JACOBIAN_VARIATION[norm]) < paper.JACOBIAN_VARIATION_TOLERANCE
            for norm in NORMS
        )

    @property
    def stroke_fraction(self) -> tuple[float, float] | None:
        """Parts of the stroke that would give both printed numbers; None if no part does.

        e grows in proportion to the stroke, to 1 % here.
        """
        half = paper.JACOBIAN_VARIATION_TOLERANCE
        low = max((paper.JACOBIAN_VARIATION[n] - half) / self.e[n] for n in NORMS)
        high = min((paper.JACOBIAN_VARIATION[n] + half) / self.e[n] for n in NORMS)
        return (low, high) if low < high else None


def trials(
    geometry: Hexapod, stroke_m: float, points: int, local_starts: int, seed: int
) -> list[Trial]:
    """What was tried beyond the readings of (38) itself.

    The supremum of other matrices; e at random points, and local searches from the first of them.
    """
    top_m = float(geometry.top_m[:, 2].mean())
    over_the_box: dict[str, Reading] = {
        "inverse of J": inverse,
        "lengths in mm": in_millimetres,
        "inverse, lengths in mm": lambda pose, J: inverse(pose, in_millimetres(pose, J)),
        "origin between the top nodes": at_height(top_m),
        "origin between the bottom nodes": at_height(-top_m),
    }
    rng = np.random.default_rng(seed)
    points_m = rng.uniform(-stroke_m, stroke_m, (points, 6))

    def supremum(norm: Norm, reading: Reading) -> float:
        return variation(geometry, stroke_m, norm, reading, seed).value

    found = [
        Trial(name, _by_norm(lambda norm, it=reading: supremum(norm, it)))
        for name, reading in over_the_box.items()
    ]
    for what, reading in (("twist", twist_in_base_axes), ("inverse", inverse)):
        found += [
            Trial(f"{what}; {how}", e)
            for how, e in _elsewhere(geometry, stroke_m, points_m, local_starts, reading).items()
        ]
    return found


def _elsewhere(
    geometry: Hexapod, stroke_m: float, points_m: Array, local_starts: int, reading: Reading
) -> dict[str, dict[Norm, float]]:
    """E where it is not the supremum over the box."""
    one_strut_m = stroke_m * np.vstack([np.eye(6), -np.eye(6)])

    def at(places_m: Array) -> dict[Norm, Array]:
        return {norm: relative_change(geometry, places_m, norm, reading) for norm in NORMS}

    alone, random = at(one_strut_m), at(points_m)
    entry, nominal = _largest_entry(geometry, stroke_m, reading)
    starts_m = points_m[:local_starts]
    ball = {n: _on_the_ball(geometry, stroke_m, starts_m[:8], n, reading) for n in NORMS}
    maxima = {n: _local_maxima(geometry, stroke_m, starts_m, n, reading) for n in NORMS}
    return {
        "largest entry of the change": _by_norm(lambda n: entry / size(nominal, n)),
        "one strut at a time": _by_norm(lambda n: alone[n].max()),
        "struts within a ball": _by_norm(lambda n: ball[n]),
        "largest of random points": _by_norm(lambda n: random[n].max()),
        "mean of random points": _by_norm(lambda n: random[n].mean()),
        "median of random points": _by_norm(lambda n: np.median(random[n])),
        "highest local maximum": _by_norm(lambda n: maxima[n].max()),
        "lowest local maximum": _by_norm(lambda n: maxima[n].min()),
    }


def _largest_entry(geometry: Hexapod, stroke_m: float, reading: Reading) -> tuple[float, Array]:
    """Sup max_ij |J_ij - J_0ij| over the box, and J_0: a change of entries, a norm only below.

    At a corner, as each entry is all but linear in the strut lengths.
    """
    nominal = jacobian(geometry, np.zeros(6), reading)
    change = jacobian(geometry, stroke_m * VERTICES, reading) - nominal
    return float(np.abs(change).max()), nominal


def _by_norm(e: Callable[[Norm], Any]) -> dict[Norm, float]:
    return {norm: float(e(norm)) for norm in NORMS}


def _on_the_ball(
    geometry: Hexapod, stroke_m: float, starts_m: Array, norm: Norm, reading: Reading
) -> float:
    """Largest e where the strut displacements, as a vector, are as long as the stroke."""

    def found(x: Array) -> float:
        on_it = stroke_m * x / np.linalg.norm(x)
        return -float(relative_change(geometry, on_it, norm, reading))

    return -min(minimize(found, x / stroke_m).fun for x in starts_m)


def _local_maxima(
    geometry: Hexapod, stroke_m: float, starts_m: Array, norm: Norm, reading: Reading
) -> Array:
    """Where sequential quadratic programming with differenced gradients ends: as fmincon did.

    SLSQP (Kraft 1988) on lengths in metres, with its own default tolerances.
    """

    def found(struts_m: Array) -> float:
        return -float(relative_change(geometry, struts_m, norm, reading))

    box = [(-stroke_m, stroke_m)] * 6
    return np.array([-minimize(found, x, method="SLSQP", bounds=box).fun for x in starts_m])
