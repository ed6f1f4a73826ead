"""A dither for a rig, by which its diagnosis tells failures apart, and what it costs."""

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

import argument_checks as check
from argument_checks.ties import greatest
from fjh.rig.options import COST_PART, DITHER_SIZE
from fjh.rig.units import by_unit
from fjh.study.errors import WrongInput
from fjh.study.input_checks import nearest
from ftc.fdi import (
    DEFAULT_CONFIG,
    Cost,
    Dither,
    DitherDesign,
    Separations,
    designed_dither,
    fault_responses,
    separations_at,
)
from sim import Array, Failure

if TYPE_CHECKING:
    from fjh.rig.rig import Rig

FREQUENCIES_HZ = {"designed": (2.0, 5.0, 10.0, 20.0), "default": (10.0, 20.0)}
"""To choose from, above the crossovers of the loops: these would suppress what a failure leaves. No
actuator is named before a period has passed; by default it is a tenth of a second at most."""

MEASURED_S = 0.5
"""So long failures are measured: they are to be told apart in half a second."""

_WORDS = ("none", "default", "designed")

_SAMPLES = 4
"""Of the diagnosis in a period of the dither, at the least."""

_NOTHING = 1e-9
"""Part of a reference that is no motion but round-off."""


def rig_dither(rig: "Rig", asked: str) -> DitherDesign | None:
    """The dither that is asked for: "none", "default", "designed", or a frequency in Hz.

    The least separation of two failures is the largest found, by the linear model with the
    uncertainty that the diagnosis assumes, of a size that :data:`DITHER_SIZE` says; "default" is
    designed at 10 or 20 Hz, of a size that :data:`COST_PART` says. None is none, or that the major
    task leaves no motion; by default also that no frequency serves, or separates any failure.

    Raises:
        WrongInput: Something else is asked for, or a frequency that the diagnosis does not see.
    """
    if asked == "none":
        return None
    try:
        frequencies, size = _frequencies(rig, asked), DITHER_SIZE * rig.size
        if asked != "default":
            return _designed(rig, frequencies, size)
        design = _designed(rig, frequencies, min(size, COST_PART * rig.noise))
    except ValueError as error:  # an undamped mode at that frequency
        raise WrongInput(f"dither {asked}: {error}") from None
    return design if design is not None and design.separations.isolable() else None


def _designed(rig: "Rig", frequencies: list[float], task_motion: float) -> DitherDesign | None:
    """The best of these frequencies that moves no major row further; None: there is no motion."""
    mapping = rig.mapping(rig.goal)
    freedom = mapping.secondary_gain()
    freedom = np.where(np.abs(freedom) < _NOTHING, 0.0, freedom)
    if not frequencies or not freedom.any():
        return None
    displacement = DITHER_SIZE * rig.size * np.abs(mapping.major_gain()).max()
    cost = Cost(displacement, rig.nominal.plant.C, task_motion)
    return designed_dither(
        rig.watched, freedom, frequencies, cost, MEASURED_S, DEFAULT_CONFIG.uncertainty
    )


def dither_of(rig: "Rig", asked: str | Dither | None, default: str | Dither) -> Dither | None:
    """The dither of :meth:`fjh.rig.Rig.supervisor`; `default` is that of the robot.

    Raises:
        WrongInput: As :func:`rig_dither`.
    """
    chosen = default if isinstance(asked, str) and asked == "default" else asked
    if chosen is None or isinstance(chosen, Dither):
        return chosen
    check.instance("dither", chosen, str, int, float, Dither)
    design = rig_dither(rig, chosen)
    return None if design is None else design.dither


def _frequencies(rig: "Rig", asked: str) -> list[float]:
    """Those asked for that the diagnosis sees; of the designed ones those that no loop follows."""
    slowest = 1 / MEASURED_S
    fastest = 1 / _SAMPLES / max(rig.period_s, DEFAULT_CONFIG.sample_s)
    tried = FREQUENCIES_HZ.get(asked, ())
    if tried:
        tried = [hz for hz in tried if hz >= max(each.crossover_hz for each in rig.margins)]
    else:
        with suppress(ValueError, OverflowError):
            tried = (float(asked),)
    seen = [hz for hz in tried if slowest <= hz <= fastest]
    if not seen and asked != "default":
        raise WrongInput(
            "dither must be none, default, designed, or a frequency from "
            f"{slowest:g} to {fastest:g} Hz, got {asked!s:.80}{nearest(str(asked), _WORDS)}"
        )
    return seen


def dither_entry(design: DitherDesign | None, rig: "Rig") -> dict[str, Any] | None:
    """A dither, what it costs and what it separates, ready for JSON."""
    if design is None:
        return None
    displacement, task_motion = design.displacement.tolist(), design.task_motion.tolist()
    return {
        "frequency_hz": design.dither.frequency_hz,
        "amplitude": design.dither.amplitude,
        "direction": list(design.dither.direction),
        "displacement": displacement,
        "task_motion": task_motion,
        **by_unit("displacement", displacement, rig.units),
        **by_unit("task_motion", task_motion, rig.row_units),
        "isolable": [
            {"actuator": rig.actuators[fault.actuator], "kind": fault.kind}
            for fault in design.separations.isolable()
        ],
    }


def not_isolable(
    rig: "Rig", design: DitherDesign | None, path: Array, failures: Sequence[Failure]
) -> list[Failure]:
    """Failures that neither the dither nor the path tells from others, by the linear model.

    From no failure and from those of other actuators, with the uncertainty that the diagnosis
    assumes; by the dither in half a second, by the path in a period of its strongest sinusoid.
    """
    left = [
        each
        for each in failures
        if design is None or not design.separations.isolates(each.number, each.kind)
    ]
    if not left:
        return []
    by_path = _path_separations(rig, path)
    return [each for each in left if not by_path.isolates(each.number, each.kind)]


def _path_separations(rig: "Rig", path: Array) -> Separations:
    """Separations by the path's strongest sinusoid in a period of it; the actuators follow it."""
    phasors = np.fft.rfft(path, axis=0)[1:] * 2 / len(path)
    strongest = greatest((np.abs(phasors) ** 2).sum(axis=1))
    frequency_hz = np.array([(1 + strongest) / (len(path) * rig.period_s)])
    measured_s = max(MEASURED_S, 1 / float(frequency_hz[0]))
    commanded = rig.mapping(rig.goal).major_gain() @ phasors[strongest]
    known = measured_s, DEFAULT_CONFIG.uncertainty
    return separations_at(fault_responses(rig.watched, frequency_hz, *known), 0, commanded)
