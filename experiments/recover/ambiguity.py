"""Which failures look alike to which sensors, with and without the dither: before any noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import DITHER, GOAL
from ftc.fdi.dither import STILL, Dither
from ftc.fdi.fault_model import KINDS, Fault
from ftc.fdi.hypotheses import bank
from ftc.fdi.isolability import separations
from ftc.fdi.sensing import sensing
from ftc.linear_loop import LinearLoop, linear_loop
from sim import Array

ALIKE = 6.18
"""Separation below which one of a thousand pairs is mistaken: Phi(-d / 2) = 1e-3."""

EVIDENCE_S = 0.5
"""How long it is collected."""

Where = Literal["centre", "off centre"]

_BEGIN_S, _EARLIEST_S = 6.0, 1.5


@dataclass(frozen=True)
class Setting:
    """What there is to see a failure with.

    Attributes:
        name: For people.
        dither: Of the struts.
        strut_sensors: Whether there are any.
    """

    name: str
    dither: Dither
    strut_sensors: bool


SETTINGS = (
    Setting("angles", STILL, strut_sensors=False),
    Setting("angles, dither", DITHER, strut_sensors=False),
    Setting("angles and struts", STILL, strut_sensors=True),
    Setting("angles and struts, dither", DITHER, strut_sensors=True),
)


@dataclass(frozen=True)
class Lookalikes:
    """One failure as one setting sees it.

    Attributes:
        setting: Its name.
        fault: What happens.
        where: Where the strut stands when it happens.
        separation: From every strut and kind, (6, 3), itself 0.
        from_sound: From soundness.
    """

    setting: str
    fault: Fault
    where: Where
    separation: Array
    from_sound: float

    @property
    def alike(self) -> list[tuple[Fault, float]]:
        """What it is mistaken for, and the separation; a weak coil by any loss."""
        found = [
            (Fault(strut, kind), float(self.separation[strut, column]))
            for strut in range(6)
            for column, kind in enumerate(KINDS)
            if (strut, kind) != (self.fault.strut, self.fault.kind)
        ]
        return sorted((each for each in found if each[1] < ALIKE), key=lambda each: each[1])


def lookalikes(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    setting: Setting,
    struts: Sequence[int],
) -> list[Lookalikes]:
    """These struts and every kind, at the centre and off it, within half a turn from 7.5 s on."""
    duration_s = _EARLIEST_S + bench.spiral_period_s / 2 + EVIDENCE_S + bench.control_period_s
    loop = linear_loop(
        model, bench, loops, GOAL, setting.dither, begin_s=_BEGIN_S, duration_s=duration_s
    )
    seen = sensing(loop.sound, bench, setting.strut_sensors)
    hypotheses = bank(loop.sound, (), seen.C)
    found = []
    for fault in [Fault(k, kind, 0.5 * (kind == "weak")) for k in struts for kind in KINDS]:
        for where, choose in _PLACES.items():
            onset = _onset(loop, bench, fault.strut, choose)
            until = onset + round(EVIDENCE_S / loop.sound.period_s)
            separation, from_sound = separations(loop, hypotheses, fault, onset, until)
            found.append(Lookalikes(setting.name, fault, where, separation, from_sound))
    return found


_PLACES: dict[Where, Callable[[Array], int]] = {
    "centre": lambda strut_m: int(np.abs(strut_m).argmin()),
    "off centre": lambda strut_m: int(np.abs(strut_m).argmax()),
}


def _onset(loop: LinearLoop, bench: Bench, strut: int, choose: Callable[[Array], int]) -> int:
    """Tick within half a turn at which the sound strut is nearest to its centre, or farthest."""
    first = round(_EARLIEST_S / loop.sound.period_s)
    half_turn = round(bench.spiral_period_s / 2 / loop.sound.period_s)
    strut_m = (loop.desired_rad @ loop.gain.T)[first : first + half_turn, strut]
    return first + choose(strut_m)
