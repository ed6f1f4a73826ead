"""Which further sensor separates the failures that a dither leaves alike."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks.ties import ascending
from ftc.fdi.design.signatures import FaultResponses, driven, fault_responses
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import NominalModel
from ftc.fdi.separation import ACCURACY, ALIKE, Conditions, Separations, separations_at


@dataclass(frozen=True)
class AddedSensor:
    """What is separated with one more sensor.

    Attributes:
        name: Of the sensor.
        separations: With it.
        alike: Number of pairs of actuators that stay alike, and of actuators with a failure that
            stays undetected, below :data:`ftc.fdi.separation.ALIKE`.
    """

    name: str
    separations: Separations
    alike: int


def ranked_sensors(
    nominal: NominalModel,
    candidates: Mapping[str, tuple[ArrayLike, float]],
    dither: Dither,
    conditions: Conditions,
) -> tuple[AddedSensor, ...]:
    """The candidates by what each leaves alike, then by the least separation; the best first.

    Those that are equally good, as by symmetry, stay in their order.

    Args:
        nominal: The plant without failures, and what is measured of it already.
        candidates: By name: what a sensor measures, a row per state (s,), and the standard
            deviation of one sample. A disturbance in `conditions` does not reach it.
        dither: As of :func:`ftc.fdi.separations`.
        conditions: As there.

    Raises:
        ValueError, TypeError: An argument of the wrong shape or size.
    """
    check.instance("nominal", nominal, NominalModel)
    check.instance("candidates", candidates, Mapping)
    check.instance("conditions", conditions, Conditions)
    commanded, at_hz = driven(nominal, dither)
    own, every = len(nominal.noise), _with_sensors(nominal, candidates)
    noise = _undisturbed_besides(conditions, len(candidates)).noise(every, "frequency_hz", at_hz)[0]
    # What a sensor shows depends on no other: of all of them at once.
    responses = fault_responses(every, at_hz, conditions.uncertainty)
    found = []
    for k, name in enumerate(candidates):
        seen = [*range(own), own + k]
        apart = separations_at(
            _of_outputs(responses, seen), 0, commanded, noise[np.ix_(seen, seen)]
        )
        between = apart.between_actuators
        found.append(AddedSensor(name, apart, int(np.triu(between < ALIKE).sum())))
    alike, least = [each.alike for each in found], [-each.separations.least for each in found]
    return tuple(found[k] for k in ascending(alike, least, accuracy=ACCURACY))


def _with_sensors(
    nominal: NominalModel, candidates: Mapping[str, tuple[ArrayLike, float]]
) -> NominalModel:
    rows, sigmas = [nominal.plant.C], [*nominal.noise]
    for candidate in candidates.values():
        try:
            row, noise = candidate
        except (TypeError, ValueError):
            raise ValueError(
                "candidates must be pairs of a row and its noise, got " + check.shown(candidate)
            ) from None
        rows.append(check.exactly("candidates", row, nominal.plant.nstates))
        sigmas.append(check.positive("candidates", noise))
    return nominal.measured(np.vstack(rows), sigmas)


def _undisturbed_besides(conditions: Conditions, more: int) -> Conditions:
    """With so many outputs more, which the disturbance does not reach."""
    if conditions.disturbance is None:
        return conditions
    lead = [(0, 0)] * (conditions.disturbance.ndim - 2)
    padded = np.pad(conditions.disturbance, [*lead, (0, more), (0, more)])
    return replace(conditions, disturbance=padded)


def _of_outputs(responses: FaultResponses, seen: list[int]) -> FaultResponses:
    return replace(
        responses, change=responses.change[..., seen, :], errors=responses.errors[..., seen, :]
    )
