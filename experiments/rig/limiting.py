"""What most of a flight's error comes from, in a sentence."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from argument_checks.ties import greatest
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from sim import Array, Failure

_OFTEN = 0.01
"""Part of the time in which an actuator that gives its largest force is said to saturate."""


def limiting(rig: Rig, run: Run, failures: Sequence[Failure] = ()) -> str | None:
    """What most of the error of a flight comes from; None: nothing that is known here.

    Forces at their limits are seen in the run; noise, dry friction and the time in which loops make
    up for a failure by comparison with the linear model without them.

    Args:
        rig: The robot.
        run: Its flight, from time 0.
        failures: What happened, as of :meth:`Rig.fly`.
    """
    struck = [rig.number(failure.actuator) for failure in failures]
    often = run.saturated.mean(axis=0)
    often[struck] = 0.0
    if often.max() > _OFTEN:
        return (
            f"The servo of {rig.actuators[greatest(often)]} saturates: it gives its largest force "
            f"for {100 * often.max():.0f} % of the time."
        )
    noise, error = run.measured - run.true, run.desired - run.true
    cut = len(error)
    if failures:
        first_s = min(failure.time_s for failure in failures)
        cut = int(np.searchsorted(run.time_s, first_s - 1e-9))
    still = rig.predict(run.desired, failures=failures, noise=0 * noise)
    # An actuator that keeps all of its force has not failed: paths may cost more as they go on.
    none = [replace(failure, kind="weak", effectiveness=1.0) for failure in failures]
    sound = rig.predict(run.desired, failures=none, noise=noise)
    before, after = _square(rig, error[:cut]), _square(rig, error[cut:])
    if failures and after > 2 * _of(rig, sound.rms_after):
        return _after(rig, run, _of(rig, still.rms_after) > after / 2)
    if _of(rig, still.rms_before) < before / 2 < _of(rig, sound.rms_before):
        return "Most of the error is noise of the sensors, which the loops pass on."
    if rig.nominal.friction is not None:
        control = replace(rig.control, nominal=replace(rig.nominal, friction=None))
        without = replace(rig, control=control).predict(run.desired, failures=none, noise=noise)
        if _of(rig, without.rms_before) < before / 2:
            return "Most of the error is from dry friction in the joints."
    return None


def _after(rig: Rig, run: Run, told_too: bool) -> str:
    """Of the error after a failure, which a controller that is told at once has too, or not."""
    cause = "that of a controller that does not know of it"
    if told_too:
        slowest_hz = min(each.crossover_hz for each in rig.margins)
        cause = f"what the loops, whose crossover is at {slowest_hz:.2g} Hz, take to make up for it"
    elif run.diagnoses:
        cause = f"from the time until {run.diagnoses[0]}"
    return f"After the failure most of the error is {cause}."


def _square(rig: Rig, error: Array) -> float:
    """Mean square of an error (N, m1), rows together, in units of their noise."""
    return float(((error / rig.nominal.noise) ** 2).sum(axis=1).mean()) if len(error) else 0.0


def _of(rig: Rig, rms: Array) -> float:
    """The same of RMS errors (m1,)."""
    return float(((rms / rig.nominal.noise) ** 2).sum())
