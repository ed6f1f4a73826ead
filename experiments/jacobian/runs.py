"""Eq. (39) and eq. (40) on this machine: values, certificates, and what else they may mean."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import minimize

from experiments.jacobian.certificate import Certificate, certify
from experiments.jacobian.loop import LoopRun, Tracked, run_loop
from experiments.jacobian.variation import (
    NORMS,
    READINGS,
    VERTICES,
    ByNorm,
    Norm,
    Reading,
    Variation,
    at_height,
    in_millimetres,
    inverse,
    jacobian,
    relative_change,
    size,
    twist_in_base_axes,
    variation,
)
from experiments.rig.hexapod import paper
from prioritized import ConstrainedSystem
from sim import (
    NOMINAL,
    Array,
    Hexapod,
    UnreachableLengths,
    forward_kinematics,
    hexapod,
    jacobians,
    load_model,
)

RANDOM_POINTS = 1000
"""As many as the paper's fmincon had starts."""
LOCAL_STARTS, QUICK_LOCAL_STARTS = 100, 4


@dataclass(frozen=True)
class Constancy:
    """What is known of J over the box of strut lengths, and in the loop.

    `newton_error_m` is the longest strut error after each Newton step from the nominal pose to the
    strut lengths where the Frobenius norm is largest.
    """

    seed: int
    J_0: Array  # from the closed-form geometry, (6, 6)
    J_0_mjcf: Array  # by eq. (14)
    variations: dict[str, dict[Norm, Variation]]  # by reading of (38)
    certificates: dict[Norm, Certificate]  # bounds on ||J - J_0||, twist in base axes
    tried: dict[str, ByNorm]  # e by reading of (40)
    newton_error_m: list[float]
    loop: dict[LoopRun, Tracked]  # empty without --loop


def run_jacobian(
    *,
    seed: int = 0,
    quick: bool = False,
    loop: bool = False,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Constancy:
    """Examine J over the stroke, then in the loop; progress is of steps, then of runs.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    model = load_model()
    geometry, stroke_m = hexapod(model), paper.STROKE_M
    steps = len(READINGS) + 2
    variations: dict[str, dict[Norm, Variation]] = {}
    tried: dict[str, ByNorm] = {}
    for done, (name, reading) in enumerate(READINGS.items()):
        on_progress(done, steps)
        variations[name] = {n: variation(geometry, stroke_m, n, reading, seed) for n in NORMS}
        tried[name] = {n: variations[name][n].value for n in NORMS}
    on_progress(steps - 2, steps)
    certificates: dict[Norm, Certificate] = {n: certify(geometry, stroke_m, n) for n in NORMS}
    on_progress(steps - 1, steps)
    starts = QUICK_LOCAL_STARTS if quick else LOCAL_STARTS
    tried |= other_readings(geometry, stroke_m, RANDOM_POINTS, starts, seed)
    base, *_ = variations.values()
    newton_error_m = _newton_errors_m(geometry, base["frobenius"].at_strut_m)
    on_progress(steps, steps)
    return Constancy(
        seed=seed,
        J_0=np.linalg.inv(geometry.inverse_jacobian(NOMINAL)),
        J_0_mjcf=_from_mjcf(model),
        variations=variations,
        certificates=certificates,
        tried=tried,
        newton_error_m=newton_error_m,
        loop=run_loop(seed=seed, quick=quick, on_progress=on_progress) if loop else {},
    )


def _newton_errors_m(geometry: Hexapod, strut_m: Array) -> list[float]:
    """Longest strut error after 0, 1, 2, ... Newton steps, until round-off."""
    errors_m: list[float] = []
    while True:
        try:
            pose = forward_kinematics(geometry, strut_m, most_steps=len(errors_m))
        except UnreachableLengths as not_yet:
            errors_m.append(float(not_yet.residual_m))
        else:
            return [*errors_m, float(np.abs(geometry.displacements(pose) - strut_m).max())]


def _from_mjcf(model: mujoco.MjModel) -> Array:
    """Eq. (14) on the compiled model."""
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics().J


def other_readings(
    geometry: Hexapod, stroke_m: float, points: int, local_starts: int, seed: int
) -> dict[str, ByNorm]:
    """Values of e by norm for what was tried beyond the readings of (38) itself.

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
    found: dict[str, ByNorm] = {
        name: {n: variation(geometry, stroke_m, n, reading, seed).value for n in NORMS}
        for name, reading in over_the_box.items()
    }
    points_m = np.random.default_rng(seed).uniform(-stroke_m, stroke_m, (points, 6))
    starts_m = points_m[:local_starts]
    readings: dict[str, Reading] = {"twist": twist_in_base_axes, "inverse": inverse}
    for what, reading in readings.items():
        by_norm = {n: _elsewhere(geometry, stroke_m, points_m, starts_m, n, reading) for n in NORMS}
        for how in by_norm["two"]:
            found[f"{what}; {how}"] = {n: by_norm[n][how] for n in NORMS}
    return found


def _elsewhere(
    geometry: Hexapod,
    stroke_m: float,
    points_m: Array,
    starts_m: Array,
    norm: Norm,
    reading: Reading,
) -> dict[str, float]:
    """What e could be other than the supremum over the box.

    The local searches are what fmincon did: sequential quadratic programming with differenced
    gradients, SLSQP (Kraft 1988), on lengths in metres, with its own default tolerances.
    """

    def e(struts_m: Array) -> Array:
        return relative_change(geometry, struts_m, norm, reading)

    def on_the_ball(x: Array) -> float:
        """-e over the largest at random points, of strut displacements as long as the stroke."""
        return -float(e(stroke_m * x / np.linalg.norm(x))) / random.max()

    nominal = jacobian(geometry, np.zeros(6), reading)
    # Each entry is nearly linear in the strut lengths: its change is largest at a corner.
    entry = np.abs(jacobian(geometry, stroke_m * VERTICES, reading) - nominal).max()
    alone, random = e(stroke_m * np.vstack([np.eye(6), -np.eye(6)])), e(points_m)
    ball = -random.max() * min(minimize(on_the_ball, x / stroke_m).fun for x in starts_m[:8])
    box = [(-stroke_m, stroke_m)] * 6
    maxima = [
        -minimize(lambda x: -float(e(x)), x, method="SLSQP", bounds=box).fun for x in starts_m
    ]
    found = {
        "largest entry of the change": entry / size(nominal, norm),
        "one strut at a time": alone.max(),
        "struts within a ball": ball,
        "largest of random points": random.max(),
        "mean of random points": random.mean(),
        "median of random points": np.median(random),
        "highest local maximum": max(maxima),
        "lowest local maximum": min(maxima),
    }
    return {how: float(value) for how, value in found.items()}
