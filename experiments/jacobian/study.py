"""Eq. (39) and eq. (40) on this machine: values, certificates, and what else they may mean."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod import paper
from experiments.jacobian.certificate import Certificate, certify
from experiments.jacobian.norms import NORMS, Norm
from experiments.jacobian.readings import READINGS
from experiments.jacobian.tried import Trial, trials
from experiments.jacobian.variation import Variation, variation
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
class JacobianStudy:
    """What is known of J over the box of strut lengths.

    Attributes:
        J_0: Nominal Jacobian from the closed-form geometry, shape (6, 6).
        J_0_mjcf: The same from the MJCF by eq. (14).
        variations: Eq. (40) by reading of (38) and norm.
        certificates: Upper bounds on ||J - J_0||, by norm, for the twist in base axes.
        tried: Where the paper's two numbers were looked for.
        newton_error_m: Longest strut error after each Newton step from the nominal pose to the
            strut lengths where the Frobenius norm is largest.
    """

    J_0: Array
    J_0_mjcf: Array
    variations: dict[str, dict[Norm, Variation]]
    certificates: dict[Norm, Certificate]
    tried: list[Trial]
    newton_error_m: list[float]


def run_jacobian(
    *,
    seed: int = 0,
    quick: bool = False,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> JacobianStudy:
    """Everything about J that needs no dynamics.

    Args:
        seed: Of the searches.
        quick: Only a few local searches on the way to the paper's numbers.
        on_progress: Called with finished and total number of steps.
    """
    model = load_model()
    geometry, stroke_m = hexapod(model), paper.STROKE_M
    steps = len(READINGS) + 2
    variations = {}
    for done, (name, reading) in enumerate(READINGS.items()):
        on_progress(done, steps)
        variations[name] = {n: variation(geometry, stroke_m, n, reading, seed) for n in NORMS}
    on_progress(steps - 2, steps)
    certificates: dict[Norm, Certificate] = {n: certify(geometry, stroke_m, n) for n in NORMS}
    on_progress(steps - 1, steps)
    starts = QUICK_LOCAL_STARTS if quick else LOCAL_STARTS
    base = next(iter(variations.values()))
    study = JacobianStudy(
        J_0=np.linalg.inv(geometry.inverse_jacobian(NOMINAL)),
        J_0_mjcf=_from_mjcf(model),
        variations=variations,
        certificates=certificates,
        tried=[
            *(Trial(name, {n: one[n].value for n in NORMS}) for name, one in variations.items()),
            *trials(geometry, stroke_m, RANDOM_POINTS, starts, seed),
        ],
        newton_error_m=_newton_errors_m(geometry, base["frobenius"].at_strut_m),
    )
    on_progress(steps, steps)
    return study


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
