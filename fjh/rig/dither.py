"""Dithers with which a rig's diagnosis isolates failures, and their cost."""

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
"""Candidate frequencies [Hz]. Only those above the loops' crossovers are used, because loops
suppress the response below. Identification takes at least one period: by default at most 0.1 s."""

MEASURED_S = 0.5
"""Duration [s] of the measurements by which a designed dither separates failures."""

_CHOICES = ("none", "default", "designed")

_SAMPLES = 4
"""Smallest number of samples of the diagnosis in a period of the dither."""

_ROUND_OFF = 1e-9
"""Fraction of a reference below which a component counts as round-off."""


def rig_dither(rig: "Rig", requested: str) -> DitherDesign | None:
    """Return the dither for "none", "default", "designed", or a frequency in Hz.

    A designed dither maximizes the least separation of two failures in the linear model, with the
    uncertainty that the diagnosis assumes; :data:`DITHER_SIZE` limits its amplitude. "default" is
    designed at 10 or 20 Hz, and :data:`COST_PART` limits it further. The result is None for "none",
    if the major task leaves no motion, or if no default dither isolates a failure.

    Raises:
        WrongInput: The request is invalid, or a frequency that the diagnosis cannot use.
    """
    if requested == "none":
        return None
    try:
        frequencies, size = _frequencies(rig, requested), DITHER_SIZE * rig.size
        if requested != "default":
            return _designed(rig, frequencies, size)
        design = _designed(rig, frequencies, min(size, COST_PART * rig.noise))
    except ValueError as error:  # for example an undamped mode at this frequency
        raise WrongInput(f"dither {requested}: {error}") from None
    return design if design is not None and design.separations.isolable() else None


def _designed(rig: "Rig", frequencies: list[float], task_motion: float) -> DitherDesign | None:
    """Return the best dither that moves no major row further than `task_motion`, if any."""
    mapping = rig.mapping(rig.goal)
    freedom = mapping.secondary_gain()
    freedom = np.where(np.abs(freedom) < _ROUND_OFF, 0.0, freedom)
    if not frequencies or not freedom.any():
        return None
    displacement = DITHER_SIZE * rig.size * np.abs(mapping.major_gain()).max()
    cost = Cost(displacement, rig.nominal.plant.C, task_motion)
    return designed_dither(
        rig.diagnosis_model, freedom, frequencies, cost, MEASURED_S, DEFAULT_CONFIG.uncertainty
    )


def dither_of(rig: "Rig", requested: str | Dither | None, default: str | Dither) -> Dither | None:
    """Return a dither as :meth:`fjh.rig.Rig.supervisor` takes it; `default` replaces "default".

    Raises:
        WrongInput: The request is invalid, as for :func:`rig_dither`.
    """
    chosen = default if isinstance(requested, str) and requested == "default" else requested
    if chosen is None or isinstance(chosen, Dither):
        return chosen
    check.instance("dither", chosen, str, int, float, Dither)
    design = rig_dither(rig, chosen)
    return None if design is None else design.dither


def _frequencies(rig: "Rig", requested: str) -> list[float]:
    """Return frequencies [Hz] in the band of the diagnosis, designed ones above crossovers."""
    slowest = 1 / MEASURED_S
    fastest = 1 / _SAMPLES / max(rig.period_s, DEFAULT_CONFIG.sample_s)
    candidates = FREQUENCIES_HZ.get(requested, ())
    if candidates:
        candidates = [hz for hz in candidates if hz >= max(m.crossover_hz for m in rig.margins)]
    else:
        with suppress(ValueError, OverflowError):
            candidates = (float(requested),)
    in_band = [hz for hz in candidates if slowest <= hz <= fastest]
    if not in_band and requested != "default":
        raise WrongInput(
            "dither must be none, default, designed, or a frequency from "
            f"{slowest:g} to {fastest:g} Hz, got {requested!s:.80}"
            f"{nearest(str(requested), _CHOICES)}"
        )
    return in_band


def dither_entry(design: DitherDesign | None, rig: "Rig") -> dict[str, Any] | None:
    """Return a dither, its cost and the failures that it isolates, ready for JSON."""
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
    """Return the failures that neither the dither nor the path isolates, by the linear model.

    Such a failure is not separated from health or from another actuator's failure, with the
    uncertainty that the diagnosis assumes. The dither acts for half a second, the path for one
    period of its strongest sinusoid.
    """
    remaining = [
        failure
        for failure in failures
        if design is None or not design.separations.isolates(failure.number, failure.kind)
    ]
    if not remaining:
        return []
    by_path = _path_separations(rig, path)
    return [failure for failure in remaining if not by_path.isolates(failure.number, failure.kind)]


def _path_separations(rig: "Rig", path: Array) -> Separations:
    """Return the separations by the path's strongest sinusoid, over one period of it."""
    phasors = np.fft.rfft(path, axis=0)[1:] * 2 / len(path)
    strongest = greatest((np.abs(phasors) ** 2).sum(axis=1))
    frequency_hz = np.array([(1 + strongest) / (len(path) * rig.period_s)])
    measured_s = max(MEASURED_S, 1 / float(frequency_hz[0]))
    commanded = rig.mapping(rig.goal).major_gain() @ phasors[strongest]
    arguments = measured_s, DEFAULT_CONFIG.uncertainty
    responses = fault_responses(rig.diagnosis_model, frequency_hz, *arguments)
    return separations_at(responses, 0, commanded)
