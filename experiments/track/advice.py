"""What the diagnosis cannot tell apart, and which sensors or dither would."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from argument_checks.ties import greatest
from experiments.rig.choices import Sensing
from experiments.rig.dither import CONDITIONS, rig_dither
from experiments.rig.rig import Rig
from experiments.study.study import WrongInput
from ftc.fdi.design.signatures import fault_responses
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.separation import Conditions, Separations, separations_at
from sim import Array, Failure


class Means(NamedTuple):
    """With what failures are looked for: sensors, dither, and a rig that has them."""

    sense: Sensing | None
    dither: str
    rig: Callable[[], Rig]


def not_isolable(
    rig: Rig, design: DitherDesign | None, path: Array, failures: Sequence[Failure]
) -> list[Failure]:
    """Those failures that neither the dither nor the path tells from others, by the linear model.

    From no failure and from those of other actuators, with the uncertainty that the diagnosis
    assumes; by the dither in half a second, by the path in a period of its strongest sinusoid.
    """
    left = [each for each in failures if not (design and is_isolable(design.separations, each))]
    if not left:
        return []
    by_path = _path_separations(rig, path)
    return [each for each in left if not is_isolable(by_path, each)]


def is_isolable(separations: Separations, failure: Failure) -> bool:
    """Whether a failure is told apart; a loose actuator is taken for one without force."""
    kind = "free" if failure.kind == "loose" else failure.kind
    found = {(each.actuator, each.kind) for each in separations.isolable()}
    return (failure.number, kind) in found


def advice(failure: Failure, now: Means, others: Sequence[Means]) -> str:
    """The first of some means whose dither tells a failure apart, as options of the command."""
    for means in others:
        try:
            design = rig_dither(means.rig(), means.dither)
        except WrongInput:
            continue
        if design is not None and is_isolable(design.separations, failure):
            sense = f"--sense {means.sense} " if means.sense != now.sense else ""
            return f"by the linear model {sense}--dither {means.dither} tells it apart"
    return "by the linear model no --sense and no designed --dither tells it apart"


def _path_separations(rig: Rig, path: Array) -> Separations:
    """Of the strongest sinusoid of the path, which the actuators follow, in a period of it."""
    phasors = np.fft.rfft(path, axis=0)[1:] * 2 / len(path)
    strongest = greatest((np.abs(phasors) ** 2).sum(axis=1))
    frequency_hz = np.array([(1 + strongest) / (len(path) * rig.period_s)])
    measured = max(CONDITIONS.time_s, 1 / float(frequency_hz[0]))
    noise = Conditions(measured, CONDITIONS.uncertainty).noise(rig.watched, "path", frequency_hz)
    commanded = rig.mapping(rig.goal).major_gain() @ phasors[strongest]
    responses = fault_responses(rig.watched, frequency_hz, CONDITIONS.uncertainty)
    return separations_at(responses, 0, commanded, noise[0])
