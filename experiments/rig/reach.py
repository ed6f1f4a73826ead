"""Whether a path is within reach, and whether the linear model holds for a run of it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from argument_checks.ties import greatest
from experiments.rig.prediction import predicted
from experiments.rig.rig import Rig
from experiments.rig.run import Run, diagnosed_since
from experiments.study.study import WrongInput
from sim import Array, Failure

_POINTS = 100
"""Of the path that are tried, in its order."""
_STEPS = 4
"""Gauss-Newton steps to each."""
_SHORT = 0.02
"""Of the path's size: as much may be lacking."""
AGREES = 0.2
"""Relative error of the linear model's prediction of an RMS error, all major rows together."""


def check_reach(rig: Rig, path: Array) -> None:
    """Refuse a path that the sound robot cannot follow within its limits.

    Raises:
        WrongInput: Where it leaves the reach, and what holds it back.
    """
    mapping = rig.mapping(rig.goal)
    pose, commanded = mapping.nominal, np.zeros(mapping.actuators)
    for tick in np.unique(np.linspace(0, len(path) - 1, _POINTS).astype(int)):
        for _ in range(_STEPS):
            commanded = _nearer(mapping, path[tick], pose, commanded)
            pose = mapping.estimate(commanded, pose)
        lacking = path[tick] - mapping.reached(pose)
        if np.abs(lacking).max() > _SHORT * rig.size:
            row = greatest(np.abs(lacking))
            raise WrongInput(
                f"the path is out of reach at {tick * rig.period_s:.3g} s: row {rig.major[row]} "
                f"stays {np.abs(lacking[row]):.3g} {rig.row_units[row]} short"
                f"{_at_limits(rig, commanded)}; choose a smaller size, or another start"
            )


def beyond_linear_range(rig: Rig, path: Array, noise: Array, ratio: float) -> str | None:
    """Why the linear model, which is that of the start, is not held to a path; None: it is.

    The task deviates from the linear model where its geometry is curved. An error that is `ratio`
    times the predicted one is the path's, and not the machine's, if this deviation explains it.
    """
    mapping = rig.mapping(rig.goal)
    pose, gain, bent = mapping.nominal, mapping.major_gain(), []
    points = np.unique(np.linspace(0, len(path) - 1, _POINTS).astype(int))
    for tick in points:
        for _ in range(2):
            pose = mapping.estimate(gain @ path[tick], pose)
        bent.append(mapping.reached(pose) - path[tick])
    ticks = np.arange(len(path))
    along = np.column_stack([np.interp(ticks, points, row) for row in np.transpose(bent)])
    errors = (predicted(rig, path, (), goal=rig.goal, noise=noise, bent=by) for by in (0.0, along))
    linear, whole = (float(np.linalg.norm(each.rms_before)) for each in errors)
    if not (1 + AGREES) * linear < whole > ratio * linear:
        return None
    unit = "m" if "m" in rig.row_units else "rad"
    said = (
        f"a path of {1e3 * rig.size:.3g} m{unit} is beyond the range of the linear model, which is "
        f"that of the start: its geometry alone may make the error {whole / linear:.2g} times the "
        "predicted one, so that the two are not compared"
    )
    if ratio < 1 + AGREES:
        return said
    holds = rig.size * np.sqrt(((1 + AGREES) ** 2 - 1) / (ratio**2 - 1))  # an error of second order
    return f"{said}; it holds up to a size of about {1e3 * holds:.1g} m{unit}"


def learnt_s(rig: Rig, run: Run, failures: Sequence[Failure]) -> list[float | None]:
    """When the controller first diagnosed each failed actuator; None is never."""
    return [
        next((each.time_s for each in diagnosed_since(rig, run, one)), None) for one in failures
    ]


def uncompared(rig: Rig, run: Run, failures: Sequence[Failure]) -> str | None:
    """Why no linear model with these failures is held to what the controller did; None: one is."""
    if run.events:
        return f"it does not have {', '.join(dict.fromkeys(each.name for each in run.events))}"
    if run.task_lost:
        return "the controller gave the task up"
    if run.lost is not None:
        return "the task is lost"
    for each in failures:
        if each.kind == "locked" and each.number in rig.soft_locks:
            return f"the lock of {rig.actuators[each.number]} gives way"
    right = {each for failure in failures for each in diagnosed_since(rig, run, failure)}
    for each in run.diagnoses:
        if each not in right or each.withdrawn_s is not None:
            return f"{each.actuator} was diagnosed {each.kind} wrongly, or was cleared again"
    for failure in failures:
        for last in diagnosed_since(rig, run, failure)[-1:]:
            if last.kind != failure.kind:
                return f"{last.actuator} was taken for {last.kind}"
    return None


def _nearer(mapping: Any, target: Array, pose: Any, commanded: Array) -> Array:
    """Displacements one step nearer to the target."""
    if mapping.limits is None:
        return mapping.displacements(target, pose, commanded)
    return mapping.within_limits(target, pose, commanded=commanded).displacements


def _at_limits(rig: Rig, commanded: Array) -> str:
    """Which actuators are at a limit, in words."""
    if rig.limits is None:
        return ""
    lower, upper = rig.limits
    close = (commanded <= lower + 1e-9) | (commanded >= upper - 1e-9)
    names = [rig.actuators[k] for k in np.flatnonzero(close)]
    return f", with {', '.join(names)} at a limit" if names else ""
