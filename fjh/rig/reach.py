"""Check of reachability of a path, and comparison of a run with the linear model."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from argument_checks.ties import greatest
from fjh.rig.prediction import Prediction, predicted
from fjh.rig.rig import Rig
from fjh.rig.run import Run, diagnosed_since
from fjh.study.errors import WrongInput
from ftc.fdi import Dither
from sim import Array, Failure

_POINTS = 100
"""Largest number of points of the path that are checked."""
_STEPS = 4
"""Gauss-Newton steps to each point."""
_SHORT = 0.02
"""Tolerance of the reachability check, as a fraction of the path size."""
AGREES = 0.2
"""Largest accepted relative error of the predicted RMS error over all major rows."""
_OFTEN = 0.01
"""Fraction of the time at its largest force above which an actuator counts as saturated."""


def check_reachable(rig: Rig, path: Array) -> None:
    """Raise `WrongInput` unless the healthy robot can follow a path within its limits.

    Raises:
        WrongInput: The path is out of reach; the message states time and active limits.
    """
    mapping = rig.mapping(rig.goal)
    pose, commanded = mapping.nominal, np.zeros(mapping.actuators)
    for tick in np.unique(np.linspace(0, len(path) - 1, _POINTS).astype(int)):
        for _ in range(_STEPS):
            commanded, _ = mapping.tick(path[tick], pose, commanded)
            pose = mapping.estimate(commanded, pose)
        error = path[tick] - mapping.reached(pose)
        if np.abs(error).max() > _SHORT * rig.size:
            row = greatest(np.abs(error))
            raise WrongInput(
                f"the path is out of reach at {tick * rig.period_s:.3g} s: row {rig.major[row]} "
                f"stays {np.abs(error[row]):.3g} {rig.row_units[row]} short"
                f"{_at_limits(rig, commanded)}; choose a smaller size, or another start"
            )


def beyond_linear_range(rig: Rig, run: Run, ratio: float) -> str | None:
    """Return a sentence if a path is beyond the range of the linear model at the start, else None.

    The curved geometry makes the task deviate from the linear model. If this deviation explains an
    error of `ratio` times the predicted one, the path is too large.
    """
    path, noise = run.desired, np.nan_to_num(run.measured - run.true)
    mapping = rig.mapping(rig.goal)
    pose, gain, deviation = mapping.nominal, mapping.major_gain(), []
    points = np.unique(np.linspace(0, len(path) - 1, _POINTS).astype(int))
    for tick in points:
        for _ in range(2):
            pose = mapping.estimate(gain @ path[tick], pose)
        deviation.append(mapping.reached(pose) - path[tick])
    ticks = np.arange(len(path))
    along = np.column_stack([np.interp(ticks, points, row) for row in np.transpose(deviation)])
    model = partial(predicted, rig, path, (), goal=rig.goal, noise=noise)
    predictions = model(deviation=0.0), model(deviation=along)
    linear, curved = (float(np.linalg.norm(one.rms_before)) for one in predictions)
    if not (1 + AGREES) * linear < curved > ratio * linear:
        return None
    unit = "m" if "m" in rig.row_units else "rad"
    sentence = (
        f"a path of {1e3 * rig.size:.3g} m{unit} is beyond the range of the linear model, which is "
        f"that of the start: its geometry alone may make the error {curved / linear:.2g} times the "
        "predicted one, so that measured and predicted errors are not compared"
    )
    if ratio < 1 + AGREES:
        return sentence
    holds = rig.size * np.sqrt(((1 + AGREES) ** 2 - 1) / (ratio**2 - 1))  # an error of second order
    return f"{sentence}; it holds up to a size of about {1e3 * holds:.1g} m{unit}"


def diagnosed_at_s(rig: Rig, run: Run, failures: Sequence[Failure]) -> list[float | None]:
    """Return the time [s] of the first diagnosis of each failed actuator; None is never."""
    return [next((d.time_s for d in diagnosed_since(rig, run, each)), None) for each in failures]


def uncompared(rig: Rig, run: Run, model: Prediction) -> str | None:
    """Return the reason why a run is not compared with its prediction, None if it is."""
    failures = run.failures
    if model.leaves is not None:
        return f"in the linear model {model.leaves} leaves its range"
    if run.events:
        names = ", ".join(dict.fromkeys(event.name for event in run.events))
        return f"the linear model does not include {names}"
    if run.task_lost:
        return "the controller's diagnosis leaves the major task not fully reachable"
    if run.lost is not None:
        return "the task is lost"
    for failure in failures:
        if failure.kind == "locked" and failure.number in rig.soft_locks:
            return f"the lock of {rig.actuators[failure.number]} is compliant"
    correct = {d for failure in failures for d in diagnosed_since(rig, run, failure)}
    for diagnosis in run.diagnoses:
        if diagnosis not in correct or diagnosis.withdrawn_s is not None:
            name, kind = diagnosis.actuator, diagnosis.kind
            return f"{name} was incorrectly identified as {kind}, or cleared again"
    for failure in failures:
        for last in diagnosed_since(rig, run, failure)[-1:]:
            if last.kind != failure.kind:
                return f"{last.actuator} was identified as {last.kind}, not as {failure.kind}"
    return None


def first_s(run: Run) -> float:
    """Return the time [s] of the first failure or event; infinite without any."""
    return min((occurrence.time_s for occurrence in (*run.failures, *run.events)), default=np.inf)


def first_tick(run: Run) -> int:
    """Return the tick of the first failure or event; the number of ticks without any."""
    return int(np.searchsorted(run.time_s, first_s(run) - 1e-9))


def predictor(rig: Rig, run: Run, dither: Dither | None) -> Callable[..., Prediction]:
    """Return a predictor of a run with its actual sensor noise, zero for missing samples.

    For a run with events only the prediction before the first event is valid; a failure without
    effect marks its time.
    """
    failures: Sequence[Failure] = run.failures
    if run.events:
        failures = [Failure(0, "weak", first_s(run), effectiveness=1.0)]
    noise = np.nan_to_num(run.measured - run.true)
    return partial(rig.predict, run.desired, failures=failures, noise=noise, dither=dither)


def limited_by(rig: Rig, run: Run, predicted: Prediction) -> str | None:
    """Return a sentence that names the largest source of squared error; None if it is unknown.

    Saturation is determined from the run, other sources by leaving each out of the linear model.
    """
    cut, often = first_tick(run), run.saturated.mean(axis=0)
    often[[failure.number for failure in run.failures]] = 0.0
    if often.max() > _OFTEN:
        servo, percent = rig.actuators[greatest(often)], f"{100 * often.max():.0f} % of the time"
        return f"The servo of {servo} saturates: it gives its largest force for {percent}."

    def squared(error: Array) -> float:
        return float(((error / rig.nominal.noise) ** 2).sum(axis=-1).mean()) if len(error) else 0.0

    if run.failures and squared(predicted.rms_after) < squared(run.error[cut:]) / 2:
        return "After the failure most of the error is from the time until it was diagnosed."
    alternatives = {"noise of the sensors, which the loops pass on": (rig, 0.0)}
    if rig.nominal.friction is not None:
        smooth = replace(rig.control, nominal=replace(rig.nominal, friction=None))
        alternatives["dry friction in the joints"] = replace(rig, control=smooth), 1.0
    most = "Before the failure most" if run.failures else "Most"
    half, noise = squared(run.error[:cut]) / 2, run.measured - run.true
    for cause, (other, scale) in alternatives.items():
        rms = other.predict(run.desired, failures=run.failures, noise=scale * noise).rms_before
        if squared(rms) < half < squared(predicted.rms_before):
            return f"{most} of the error is from {cause}."
    return None


def _at_limits(rig: Rig, commanded: Array) -> str:
    """Return a clause that names the actuators at a limit; empty without any."""
    if rig.limits is None:
        return ""
    lower, upper = rig.limits
    close = (commanded <= lower + 1e-9) | (commanded >= upper - 1e-9)
    names = [rig.actuators[k] for k in np.flatnonzero(close)]
    return f", with {', '.join(names)} at a limit" if names else ""
