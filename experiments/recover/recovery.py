"""One case predicted, then flown three ways; and flights told late or wrongly."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.testbed import Bench
from experiments.recover.ambiguity import EVIDENCE_S
from experiments.recover.cases import AFTER_S, BEFORE_S, DITHER, GOAL, Case
from experiments.recover.flights import (
    STRUCK,
    Errors,
    Found,
    errors,
    find,
    informed,
    uncorrected,
)
from ftc.fdi.fault_model import KINDS, Fault
from ftc.fdi.hypotheses import bank
from ftc.fdi.isolability import separations
from ftc.fdi.sensing import sensing
from ftc.linear_loop import linear_loop

LATE_S = (0.03, 0.1, 0.3, 1.0)
"""How late a diagnosis may come."""

_STANDING = (0.0,) * 6
TOLD = (
    Case(0, "locked", 8.25, _STANDING, seed=0),
    Case(0, "free", 8.25, _STANDING, seed=0),
    Case(0, "weak", 8.25, _STANDING, seed=0, strength=1.0),
)
"""What happens in the flights that are told late or wrongly; the last is nothing at all."""


@dataclass(frozen=True)
class Recovery:
    """One case.

    Attributes:
        found: What the supervisor made of it.
        from_others: Predicted separation from other struts and from soundness.
        from_kinds: Predicted separation from other kinds of the same strut.
        supervised: Errors with the supervisor.
        informed: Errors with an oracle that knows at once.
        uncorrected: Errors of a controller that goes on.
    """

    found: Found
    from_others: float
    from_kinds: float
    supervised: Errors
    informed: Errors
    uncorrected: Errors


def recover_case(
    model: mujoco.MjModel, bench: Bench, loops: tuple[Loop, Loop], case: Case
) -> Recovery:
    """Predict one case from the linear model, detector and dither alone; then fly it."""
    from_others, from_kinds = _predicted(model, bench, loops, case)
    run, found = find(model, bench, loops, case, DITHER, strut_sensors=False)
    deaf = uncorrected(model, bench, loops, case, DITHER)
    displacement_m = float(deaf.strut_displacement_m[STRUCK, case.strut])
    told = informed(model, bench, loops, case, DITHER, displacement_m)
    return Recovery(found, from_others, from_kinds, errors(run), errors(told), errors(deaf))


def _predicted(
    model: mujoco.MjModel, bench: Bench, loops: tuple[Loop, Loop], case: Case
) -> tuple[float, float]:
    loop = linear_loop(
        model,
        bench,
        loops,
        GOAL,
        case.dither(DITHER),
        begin_s=case.begin_s,
        duration_s=BEFORE_S + AFTER_S,
    )
    seen = sensing(loop.sound, bench, strut_sensors=False)
    hypotheses = bank(loop.sound, (), seen.C)
    until = STRUCK + round(EVIDENCE_S / loop.sound.period_s)
    separation, from_sound = separations(loop, hypotheses, case.fault, STRUCK, until)
    from_others = min(float(np.delete(separation, case.strut, axis=0).min()), from_sound)
    own = KINDS.index(case.kind)
    return from_others, float(np.delete(separation[case.strut], own).min())


@dataclass(frozen=True)
class Told:
    """One flight whose controller was told late, or wrongly.

    Attributes:
        case: What happened.
        told: What it was told.
        late_s: How late.
        flown: Errors.
        uncorrected: Errors, had it been told nothing.
    """

    case: Case
    told: Fault
    late_s: float
    flown: Errors
    uncorrected: Errors


def told_late_or_wrongly(
    model: mujoco.MjModel, bench: Bench, loops: tuple[Loop, Loop], case: Case
) -> list[Told]:
    """The truth, later and later; then, at once, that each other strut has locked."""
    deaf = uncorrected(model, bench, loops, case, DITHER)
    stand_m = deaf.strut_displacement_m[STRUCK]
    news = [(case.fault, late_s) for late_s in LATE_S]
    news += [(Fault(k, "locked"), 0.0) for k in range(6) if k != case.strut]
    return [
        Told(
            case,
            fault,
            late_s,
            errors(
                informed(
                    model,
                    bench,
                    loops,
                    case,
                    DITHER,
                    float(stand_m[fault.strut]),
                    told=fault,
                    late_s=late_s,
                )
            ),
            errors(deaf),
        )
        for fault, late_s in news
    ]
