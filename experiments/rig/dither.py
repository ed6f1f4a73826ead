"""A dither for a rig, by which its diagnosis tells failures apart, and what it costs."""

from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.rig.options import DITHER_SIZE
from experiments.study.study import WrongInput
from ftc.fdi.diagnosis import DEFAULT_CONFIG
from ftc.fdi.dither import Dither
from ftc.fdi.dither_design import Cost, DitherDesign, designed_dither
from ftc.fdi.separation import Conditions

if TYPE_CHECKING:
    from experiments.rig.rig import Rig

FREQUENCIES_HZ = (2.0, 5.0, 10.0, 20.0)
"""To choose from, above the crossovers of the loops: these would suppress what a failure leaves."""

CONDITIONS = Conditions(0.5, DEFAULT_CONFIG.uncertainty)
"""Under which it is designed: failures are to be told apart in half a second."""

_SAMPLES = 4
"""Of the diagnosis in a period of the dither, at the least."""

_NOTHING = 1e-9
"""Part of a reference that is no motion but round-off."""


def rig_dither(rig: "Rig", asked: str) -> DitherDesign | None:
    """The dither that is asked for: "none", "designed", or a frequency in Hz.

    The least separation of two failures is the largest found, by the linear model with the
    uncertainty that the diagnosis assumes, of a size that :data:`DITHER_SIZE` says. None is none,
    or that the major task leaves no motion.

    Raises:
        WrongInput: Something else is asked for, or a frequency that the diagnosis does not see.
    """
    if asked == "none":
        return None
    frequencies = _frequencies(rig, asked)
    mapping = rig.mapping(rig.goal)
    freedom = mapping.secondary_gain()
    freedom = np.where(np.abs(freedom) < _NOTHING, 0.0, freedom)
    if not freedom.any():
        return None
    size = DITHER_SIZE * rig.size
    cost = Cost(size * np.abs(mapping.major_gain()).max(), rig.nominal.plant.C, size)
    try:
        return designed_dither(rig.watched, freedom, frequencies, CONDITIONS, cost)
    except ValueError as error:  # an undamped mode at that frequency
        raise WrongInput(f"dither {asked}: {error}") from None


def option_dither(rig: "Rig", asked: str) -> DitherDesign | None:
    """The same of the option `--dither` of a command, by whose name it is refused.

    Raises:
        WrongInput: As :func:`rig_dither`.
    """
    try:
        return rig_dither(rig, asked)
    except WrongInput as error:
        raise WrongInput(f"--{error}") from None


def dither_of(rig: "Rig", asked: str | Dither | None, default: str | Dither) -> Dither | None:
    """The dither of :meth:`experiments.rig.Rig.supervisor`; `default` is that of the robot.

    Raises:
        WrongInput: As :func:`rig_dither`.
    """
    chosen = default if asked == "default" else asked
    if chosen is None or isinstance(chosen, Dither):
        return chosen
    design = rig_dither(rig, chosen)
    return None if design is None else design.dither


def _frequencies(rig: "Rig", asked: str) -> list[float]:
    """Those asked for that the diagnosis sees; of the designed ones those that no loop follows."""
    slowest = 1 / CONDITIONS.time_s
    fastest = 1 / _SAMPLES / max(rig.period_s, DEFAULT_CONFIG.sample_s)
    try:
        tried = FREQUENCIES_HZ if asked == "designed" else (float(asked),)
    except ValueError:
        tried = ()
    if asked == "designed":
        tried = [hz for hz in tried if hz >= max(each.crossover_hz for each in rig.margins)]
    seen = [hz for hz in tried if slowest <= hz <= fastest]
    if not seen:
        raise WrongInput(
            f"dither must be none, designed, or a frequency from {slowest:g} to {fastest:g} Hz, "
            f"got {asked}"
        )
    return seen


def dither_entry(design: DitherDesign | None, rig: "Rig") -> dict[str, Any] | None:
    """A dither, what it costs and what it separates, ready for JSON."""
    if design is None:
        return None
    return {
        "frequency_hz": design.dither.frequency_hz,
        "amplitude": design.dither.amplitude,
        "direction": list(design.dither.direction),
        "displacement": design.displacement.tolist(),
        "task_motion": design.task_motion.tolist(),
        "isolable": [
            {"actuator": rig.actuators[fault.actuator], "kind": fault.kind}
            for fault in design.separations.isolable()
        ],
    }
