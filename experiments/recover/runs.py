"""The study: single failures, failures in succession, and all that is computed beside them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any

import numpy as np

from experiments.hexapod.controller import nominal_loops
from experiments.hexapod.fault_tolerance import fault_of, fault_text
from experiments.hexapod.metrics import plant_constants
from experiments.hexapod.other_controller import track_with
from experiments.hexapod.recording.hexapod import Mark
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import Testbed, TestbedConfig
from experiments.output.controllers import controller_factory
from experiments.output.parallel import in_parallel
from experiments.recover import predictions, robustness
from experiments.recover.predictions import FREQUENCIES_HZ, SETTINGS, Setting
from experiments.recover.recovery import (
    BEFORE_S,
    GOAL,
    Identification,
    Recovery,
    Scenario,
    diagnose,
    draw,
    identify,
    recover,
)
from experiments.recover.robustness import GAIN_ERRORS, INFORMED_LATE, FaultFree
from ftc.fdi.fault_model import FaultKind
from sim import Failure, load_model

MAIN = SETTINGS[1]
"""The detector alone, and the dither: what the large set is simulated with."""
OTHERS = [setting for setting in SETTINGS if setting is not MAIN]

SHOWN = {
    "locked": (Failure(0, "locked", 8.25),),
    "free": (Failure(0, "free", 8.25),),
    "cascade": (
        Failure(0, "locked", 4.0),
        Failure(3, "free", 6.0),
        Failure(1, "locked", 8.0),
        Failure(4, "locked", 10.0),
    ),
}
"""Failures of the runs that are kept whole, by name. The cascade leaves struts 3 and 6 in the end,
which pull in one direction of the (alpha, beta) plane."""

_FIRST_S, _GAP_S, _LEFT_S = (1.5, 9.0), (0.1, 2.0), 2.0
_MISMATCH_CASES = 6
_KINDS: tuple[FaultKind, ...] = ("locked", "free")


def pairs(seed: int, number: int) -> list[tuple[Failure, ...]]:
    """Two struts each, locked or free, some time apart, at random times on the spiral."""
    rng = np.random.default_rng([seed, 4])
    drawn = []
    for _ in range(number):
        struts = rng.permutation(6)[:2]
        first_s = round(float(rng.uniform(*_FIRST_S)), 3)
        times_s = first_s, first_s + round(float(rng.uniform(*_GAP_S)), 3)
        kinds = [_KINDS[k] for k in rng.integers(len(_KINDS), size=2)]
        each = zip(struts, kinds, times_s, strict=True)
        drawn.append(tuple(Failure(int(strut), kind, time_s) for strut, kind, time_s in each))
    return drawn


def succession(
    testbed: Testbed, failures: tuple[Failure, ...], seed: int, begin_s: float | None = None
) -> tuple[Trajectory, Identification]:
    """Simulate the failures, and two seconds more.

    `begin_s` is where on the spiral; None: shortly before the first failure.
    """
    begin_s = failures[0].time_s - BEFORE_S if begin_s is None else begin_s
    return diagnose(testbed, _span(failures, seed, begin_s))


def compared(
    testbed: Testbed, failures: tuple[Failure, ...], seed: int, controller: str
) -> tuple[Trajectory, str | None]:
    """The same from the start of the spiral with another controller, and the failure of that."""
    return track_with(testbed, controller, GOAL, **_span(failures, seed, 0.0))


def _span(failures: tuple[Failure, ...], seed: int, begin_s: float) -> dict[str, Any]:
    duration_s = failures[-1].time_s + _LEFT_S - begin_s
    return {"failures": failures, "seed": seed, "begin_s": begin_s, "duration_s": duration_s}


def marks(run: Trajectory, found: Identification) -> list[Mark]:
    """For a recording: each failure, when its strut was first named, and the last diagnosis."""
    marks = []
    for failure in found.failures:
        own = [
            each
            for each in found.diagnoses
            if each.fault.actuator == failure.actuator and run.time_s[each.tick] >= failure.time_s
        ]
        found_s = float(run.time_s[own[0].tick]) if own else np.inf
        words = f"found: {fault_text(own[-1].fault)}" if own else ""
        happened = fault_text(fault_of(failure))
        marks.append(Mark(failure.actuator, failure.time_s, happened, found_s, words))
    return marks


SIZE: dict[str, tuple[Any, Any]] = {
    "cases": (306, 4),
    "cases_in_other_settings": (36, 1),
    "pairs": (36, 1),
    "fault_free": (24, 1),
    "fault_free_s": (16.0, 3.0),
    "draws": (1000, 20),
    "settings": (4, 2),
    "struts": (6, 1),
    "informed": (3, 1),
    "shown": (3, 1),
    "frequencies": (4, 1),
    "gain_errors": (5, 0),
}
"""How much of everything in the whole study, and with --quick."""


@dataclass(frozen=True)
class Recover:
    """All of it; what are dictionaries here are entries of the JSON file.

    Attributes:
        predicted: For each of `recoveries`, the distance from other struts, and from other kinds.
        others: What was identified in other settings, by their names.
        redrawn: As `fault_free`, with fresh noise.
        model_error_urad: Largest fault-free residual without noise.
        shown: Whole runs, by name.
        plant: Constants of the plant.
        controller: Another one, package.module:factory.
        compared: Whole runs with it, by name, each with a sentence if it failed.
    """

    seed: int
    recoveries: list[Recovery]
    predicted: list[tuple[float, float]]
    others: dict[str, list[Identification]]
    lookalikes: list[dict[str, Any]]
    beliefs: list[dict[str, Any]]
    informed: list[dict[str, Any]]
    pairs: list[tuple[Trajectory, Identification]]
    fault_free: FaultFree
    redrawn: FaultFree
    model_error_urad: float
    dither_design: list[dict[str, Any]]
    dither_cost: dict[str, Any]
    mismatches: list[dict[str, Any]]
    shown: dict[str, tuple[Trajectory, Identification]]
    plant: dict[str, Any]
    controller: str | None = None
    compared: dict[str, tuple[Trajectory, str | None]] = field(default_factory=dict)


def run_recover(
    *,
    seed: int,
    quick: bool,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    controller: str | None = None,
) -> Recover:
    """Everything, independent jobs in parallel on the machine's cores.

    Args:
        seed: Of the failures drawn, and of all noise.
        quick: A small set.
        on_progress: Called with finished and total number of jobs.
        controller: Another one, to be compared in the same scenarios.

    Raises:
        WrongInput: There is no such controller.
    """
    if controller is not None:
        controller_factory(controller)  # a wrong name is refused before anything runs
    model, bench = load_model(), TestbedConfig()
    testbed = Testbed(model, bench, nominal_loops(model, bench))
    done = _by_name(testbed, _jobs(seed, quick, controller), on_progress)
    simulated, redrawn, model_errors_urad = zip(*done["fault_free"], strict=True)
    return Recover(
        seed=seed,
        recoveries=done["recoveries"],
        predicted=done["predicted"],
        others={each.name: done[each.name] for each in OTHERS},
        lookalikes=list(chain(*done["lookalikes"])),
        beliefs=done["beliefs"][0],
        informed=list(chain(*done["informed"])),
        pairs=done["pairs"],
        fault_free=robustness.together(simulated),
        redrawn=robustness.together(redrawn),
        model_error_urad=max(model_errors_urad),
        dither_design=done["dither_design"][0],
        dither_cost=done["dither_cost"][0],
        mismatches=list(chain(*done["mismatches"])),
        shown=dict(zip(SHOWN, done["shown"], strict=False)),
        plant=plant_constants(model),
        controller=controller,
        compared=dict(zip(SHOWN, done["compared"], strict=False)),
    )


Jobs = tuple[Callable[..., Any], list[tuple[Any, ...]]]
"""A function of the testbed and further arguments, and these, a tuple for each call."""


def _jobs(seed: int, quick: bool, controller: str | None) -> dict[str, Jobs]:
    """Independent jobs, by what they are for."""
    size = {name: both[quick] for name, both in SIZE.items()}
    cases, few = draw(seed, size["cases"]), draw(seed, size["cases_in_other_settings"])
    fault_free, drawn = draw(seed + 1, size["fault_free"]), pairs(seed, size["pairs"])
    compare = [] if controller is None else [controller]
    shown, errors = list(SHOWN.values())[: size["shown"]], GAIN_ERRORS[: size["gain_errors"]]
    frequencies_hz, settings = FREQUENCIES_HZ[-size["frequencies"] :], SETTINGS[: size["settings"]]
    struts, lasting, draws = range(size["struts"]), size["fault_free_s"], size["draws"]
    late = robustness.informed_late_or_wrongly
    return {
        "shown": (succession, [(failures, seed, 0.0) for failures in shown]),
        "beliefs": (predictions.beliefs, [(struts,)]),
        "dither_design": (predictions.dither_design, [(struts[:3], frequencies_hz)]),
        "dither_cost": (robustness.dither_cost, [(cases[0], lasting)]),
        "lookalikes": (predictions.lookalikes, [(s, struts) for s in settings]),
        "informed": (late, [(case,) for case in INFORMED_LATE[: size["informed"]]]),
        "fault_free": (robustness.fault_free, [(c, lasting, draws) for c in fault_free]),
        "recoveries": (recover, [(case, *compare) for case in cases]),
        "predicted": (predictions.from_others_and_kinds, [(case,) for case in cases]),
        "pairs": (succession, [(both, noise) for noise, both in enumerate(drawn, seed)]),
        "mismatches": (robustness.mismatched, [(e, cases[::7][:_MISMATCH_CASES]) for e in errors]),
        "compared": (compared, [(failures, seed, name) for name in compare for failures in shown]),
        **{s.name: (_identified, [(c, s) for c in few]) for s in OTHERS},
    }


def _identified(testbed: Testbed, scenario: Scenario, setting: Setting) -> Identification:
    return identify(testbed, scenario, setting.dither, strut_sensors=setting.strut_sensors)[1]


def _by_name(
    testbed: Testbed, jobs: dict[str, Jobs], on_progress: Callable[[int, int], None]
) -> dict[str, list[Any]]:
    """Results of all calls, in parallel, by the names of the jobs."""
    calls = [
        {"job": job, "testbed": testbed, "arguments": arguments}
        for job, all_arguments in jobs.values()
        for arguments in all_arguments
    ]
    results = iter(in_parallel(_run, calls, on_progress))
    return {name: list(islice(results, len(calls))) for name, (_, calls) in jobs.items()}


def _run(job: Callable[..., Any], testbed: Testbed, arguments: tuple[Any, ...]) -> Any:
    return job(testbed, *arguments)
