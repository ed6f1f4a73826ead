"""`fjh recover`: failures that nobody announces, found, isolated and flown around."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from experiments.hexapod.provenance import plant_constants
from experiments.hexapod.simulation import Trajectory, nominal_loops
from experiments.hexapod.testbed import Bench
from experiments.output.parallel import in_parallel
from experiments.recover.ambiguity import SETTINGS, Lookalikes, lookalikes
from experiments.recover.cases import draw
from experiments.recover.design import FREQUENCIES_HZ, DesignPoint, dither_design
from experiments.recover.false_alarms import DitherCost, Healthy, dither_cost, healthy, together
from experiments.recover.flights import Found, find
from experiments.recover.mismatch import ERRORS, Mismatch, mismatched
from experiments.recover.recovery import TOLD, Recovery, Told, recover_case, told_late_or_wrongly
from experiments.recover.second import CASCADE, Succession, fly_sequence, pairs
from experiments.recover.wrong import Belief, beliefs
from sim import Failure, load_model

MAIN = SETTINGS[1]
"""The detector alone, and the dither: what the large set is flown with."""

SHOWN = {
    "locked": (Failure(0, "locked", 8.25),),
    "free": (Failure(0, "free", 8.25),),
    "cascade": CASCADE,
}
"""Flights that are kept whole, by name."""


@dataclass(frozen=True)
class Size:
    """How much of everything.

    Attributes:
        cases: In the main set.
        other_cases: In each of the other settings.
        pairs: Flights with two failures.
        healthy: Spirals of a sound machine.
        healthy_s: Length of each.
        draws: Of fresh noise for each of these.
        settings: Searched for lookalikes.
        struts: Whose failures are compared in the linear model.
        told: Failures of which the controller is told late and wrongly.
        shown: Flights that are kept whole.
        frequencies: Of the dithers compared.
        mismatches: Of a machine that differs from the model.
        mismatch_cases: Failures of each.
    """

    cases: int
    other_cases: int
    pairs: int
    healthy: int
    healthy_s: float
    draws: int
    settings: int
    struts: int
    told: int
    shown: int
    frequencies: int
    mismatches: int
    mismatch_cases: int


FULL = Size(
    cases=306,
    other_cases=36,
    pairs=36,
    healthy=24,
    healthy_s=16.0,
    draws=1000,
    settings=4,
    struts=6,
    told=3,
    shown=3,
    frequencies=4,
    mismatches=5,
    mismatch_cases=6,
)
QUICK = Size(
    cases=4,
    other_cases=1,
    pairs=1,
    healthy=1,
    healthy_s=3.0,
    draws=20,
    settings=2,
    struts=1,
    told=1,
    shown=1,
    frequencies=1,
    mismatches=0,
    mismatch_cases=0,
)


@dataclass(frozen=True)
class Recover:
    """All of it.

    Attributes:
        recoveries: The main set.
        others: What was found in other settings, by name.
        lookalikes: Failures as the settings see them.
        beliefs: Stability under right and wrong beliefs.
        told: Flights told late or wrongly.
        pairs: Flights with two failures.
        flown: Healthy ones.
        redrawn: The same flights with fresh noise.
        model_error_urad: Largest healthy residual without noise.
        dither_design: What other dithers would separate.
        dither_cost: On pointing.
        mismatches: Flights of machines that differ from the model.
        shown: Whole flights, by name.
        plant: Constants of the plant.
    """

    recoveries: list[Recovery]
    others: dict[str, list[Found]]
    lookalikes: list[Lookalikes]
    beliefs: list[Belief]
    told: list[Told]
    pairs: list[Succession]
    flown: Healthy
    redrawn: Healthy
    model_error_urad: float
    dither_design: list[DesignPoint]
    dither_cost: DitherCost
    mismatches: list[Mismatch]
    shown: dict[str, tuple[Trajectory, Succession]]
    plant: dict[str, Any]


def run_recover(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Recover:
    """Everything side by side on the machine's cores.

    Args:
        seed: Of the failures drawn, and of all noise.
        quick: A small set.
        on_progress: Called with finished and total number of jobs.
    """
    size = QUICK if quick else FULL
    model, bench = load_model(), Bench()
    loops = nominal_loops(model, bench)
    shared = {"model": model, "bench": bench, "loops": loops}
    cases, few = draw(seed, size.cases), draw(seed, size.other_cases)
    sound_cases, drawn = draw(seed + 1, size.healthy), pairs(seed, size.pairs)
    settings, told_cases = SETTINGS[: size.settings], TOLD[: size.told]
    others = [setting for setting in SETTINGS if setting is not MAIN]
    names = list(SHOWN)[: size.shown]
    frequencies_hz = FREQUENCIES_HZ[-size.frequencies :]
    struts, errors = range(size.struts), ERRORS[: size.mismatches]

    jobs: list[tuple[Callable[..., Any], dict[str, Any]]] = [
        *((_shown, {"failures": SHOWN[name], "seed": seed}) for name in names),
        (beliefs, {"struts": struts}),
        (dither_design, {"struts": struts[:3], "frequencies_hz": frequencies_hz}),
        (dither_cost, {"case": cases[0], "duration_s": size.healthy_s}),
        *((lookalikes, {"setting": setting, "struts": struts}) for setting in settings),
        *((told_late_or_wrongly, {"case": case}) for case in told_cases),
        *(
            (healthy, {"case": case, "duration_s": size.healthy_s, "draws": size.draws})
            for case in sound_cases
        ),
        *((recover_case, {"case": case}) for case in cases),
        *((_second, {"failures": both, "seed": seed + k}) for k, both in enumerate(drawn)),
        *((mismatched, {"error": e, "cases": cases[::7][: size.mismatch_cases]}) for e in errors),
        *(
            (_found, {"case": c, "dither": s.dither, "strut_sensors": s.strut_sensors})
            for s in others
            for c in few
        ),
    ]
    calls = [{"job": job, **shared, **arguments} for job, arguments in jobs]
    results = iter(in_parallel(_run, calls, on_progress))

    def take(number: int) -> list[Any]:
        return [next(results) for _ in range(number)]

    shown = dict(zip(names, take(len(names)), strict=True))
    (believed,), (designed,), (cost,) = take(1), take(1), take(1)
    alike, told = take(len(settings)), take(len(told_cases))
    sound, recoveries, second = take(len(sound_cases)), take(len(cases)), take(len(drawn))
    mismatches = [each for both in take(len(errors)) for each in both]
    flown, redrawn, model_errors = zip(*sound, strict=True)
    return Recover(
        recoveries=recoveries,
        others={setting.name: take(len(few)) for setting in others},
        lookalikes=[each for found in alike for each in found],
        beliefs=believed,
        told=[each for flights in told for each in flights],
        pairs=second,
        flown=together(flown),
        redrawn=together(redrawn),
        model_error_urad=max(model_errors),
        dither_design=designed,
        dither_cost=cost,
        mismatches=mismatches,
        shown=shown,
        plant=plant_constants(model),
    )


def _run(job: Callable[..., Any], **arguments: Any) -> Any:
    return job(**arguments)


def _shown(**arguments: Any) -> tuple[Trajectory, Succession]:
    return fly_sequence(**arguments, begin_s=0.0)


def _second(**arguments: Any) -> Succession:
    return fly_sequence(**arguments)[1]


def _found(**arguments: Any) -> Found:
    return find(**arguments)[1]
