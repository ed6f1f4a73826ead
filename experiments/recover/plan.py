"""Which cases there are: four campaigns, each case drawn from a seed and its place alone."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np

from experiments.recover.case import BENCH, Case, Course, Sort, exact_rig
from experiments.rig.choices import Failing, Sensing
from experiments.rig.events import EVENTS, Event
from experiments.rig.hexapod.fault_tolerance import DITHER
from experiments.rig.hexapod.mismatch import ALONE
from experiments.rig.options import RobotOptions
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import KINDS
from sim import Array, Failure, FailureKind

BEFORE_S, AFTER_S = 1.2, 2.5
"""Of a run of the hexapod, before and after its failure."""

# The hexapod, whose random streams have numbers of their own.

_STREAMS: dict[Sort, int] = {"failure": 2, "size": 2, "pair": 4, "healthy": 5, "event": 6}
_HEALTHY_AMONG_EVENTS, _EVENTS_OF_ROBOTS = 7, 8
_STANDING_M, _EFFECTIVENESS = 10e-6, (0.2, 0.8)

FACTORS = (0.3, 3.0, 10.0, 30.0, 100.0)
"""Sizes of a mismatch beside one, which the failures have, and zero, the exact plant."""
_LARGEST = {"drift_urad_per_s": 100.0, "gain_drift_per_s": 100.0}
_LARGEST |= {"damping": 3.0, "all": 3.0, "timestep_s": 0.0}
"""Of the factors: a damper has no negative constant, a physics step no size. Others end at 30,
where gains and springs are within 90 %, and a delay makes the loop itself unstable."""

Block = tuple[Sort, str, float, int]
"""Sort, mismatch, factor and number of cases."""
WHOLE: list[Block] = [
    ("failure", "exact", 1.0, 60),
    ("failure", "all", 1.0, 306),
    *(("failure", name, 1.0, 60) for name in ALONE),
    *(
        ("size", name, factor, 3)
        for name, factor in product(("all", *ALONE), FACTORS)
        if factor <= _LARGEST.get(name, 30.0)
    ),
    ("pair", "all", 1.0, 24),
]
"""The rate claimed is that with all mismatches: 306 of 306 show 98.8 % (at 95 %), 60 of 60 show
94 %. Three of a size, a locked, a free and a weak strut, show where it breaks, no rate."""
QUICK: list[Block] = [
    ("failure", "exact", 1.0, 1),
    ("failure", "all", 1.0, 3),
    *(("size", "all", factor, 1) for factor in FACTORS[:2]),
    ("pair", "all", 1.0, 1),
]


def hexapod_failures(
    blocks: Sequence[Block], healthy: int, healthy_s: float, seed: int
) -> tuple[Case, ...]:
    """Struts fail at random times and in random postures on the spiral; then so many healthy runs.

    Their number comes last, as it may change.
    """
    cases = list[Case]()
    for sort, mismatch, factor, count in (*blocks, ("healthy", "all", 1.0, healthy)):
        beside = ("informed", *(["unaware"] if mismatch == "all" else []))
        how = {"mismatch": mismatch, "factor": factor}
        how["compared"] = beside if sort == "failure" else ()
        cases += [replace(_on_spiral(sort, seed, draw, healthy_s), **how) for draw in range(count)]
    return _numbered(cases)


def _on_spiral(sort: Sort, seed: int, draw: int, healthy_s: float) -> Case:
    rng = np.random.default_rng([seed, _STREAMS[sort], draw])
    posture = rng.normal(scale=_STANDING_M, size=6)
    seeds = rng.integers(2**32, size=2).tolist()
    if sort == "healthy":
        return of_hexapod(sort, draw, seeds, 0.0, healthy_s, posture)
    if sort == "pair":
        failures = _pair(rng)  # in the posture in which opposite struts are most alike
        posture, after_s = 0.0, failures[1].time_s - failures[0].time_s + 2.0
    else:
        strut, kind = list(product(range(6), KINDS))[draw % (6 * len(KINDS))]
        left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        failures, after_s = (Failure(strut, kind, _time_s(rng, 1.5, 13.4), left),), AFTER_S
    begin_s = failures[0].time_s - BEFORE_S
    return of_hexapod(sort, draw, seeds, begin_s, BEFORE_S + after_s, posture, failures)


def of_hexapod(
    sort: Sort,
    draw: int,
    seeds: Sequence[int],
    begin_s: float,
    duration_s: float,
    posture: Array | float = 0.0,
    failures: tuple[Failure, ...] = (),
) -> Case:
    """A case of the hexapod on its exact plant.

    `seeds` are of plant and noise, `posture` where the struts stand, (6,) or one for all, [m].
    """
    dither = replace(DITHER, offset=tuple(np.broadcast_to(posture, 6).tolist()))
    return Case(0, sort, draw, "exact", 1.0, *seeds, begin_s, duration_s, dither, failures)


def _pair(rng: np.random.Generator) -> tuple[Failure, Failure]:
    """Two struts, locked or free, some time apart, at random times on the spiral."""
    struts = rng.permutation(6)[:2].tolist()
    rigid: tuple[FailureKind, ...] = ("locked", "free")
    kinds = [rigid[k] for k in rng.integers(len(rigid), size=2)]
    first_s = _time_s(rng, 1.5, 9.0)
    second_s = round(first_s + _time_s(rng, 0.1, 2.0), 3)
    return Failure(struts[0], kinds[0], first_s), Failure(struts[1], kinds[1], second_s)


def _time_s(rng: np.random.Generator, low_s: float, high_s: float) -> float:
    """Whole control periods, so that all cases of a draw are sampled alike."""
    return round(float(rng.uniform(low_s, high_s)), 3)


def _numbered(cases: Iterable[Case]) -> tuple[Case, ...]:
    return tuple(replace(case, number=number) for number, case in enumerate(cases))


EVENTS_EACH, QUICK_EVENTS = 12, ("locked", "hard_over", "sag", "bias")
COURSES = 6
"""Of each draw in turn: the spiral, three times, twice at another speed and radius; a circle; steps
that are held; rest."""
_AFTER_EVENT_S, _EARLY_S, _LATER_S = 3.0, (0.2, 0.8), (0.9, 6.0)
_EARLY = (2, 9)
"""Draws, of every twelve, whose event happens while the diagnosis is still learning."""


def hexapod_events(
    names: Iterable[str], each: int, healthy_s: float, seed: int
) -> tuple[Case, ...]:
    """A run without events, which takes longest, and so many of each event.

    Cases of one draw have the same plant, course, posture, time and noise, whatever happens: what
    an event costs is not the luck of the draw.
    """
    rng = np.random.default_rng([seed, _HEALTHY_AMONG_EVENTS])
    seeds = rng.integers(2**32, size=2).tolist()
    posture = rng.normal(scale=_STANDING_M, size=6)
    healthy = of_hexapod("healthy", 0, seeds, 0.0, healthy_s, posture)
    healthy = replace(healthy, mismatch="all", course=Course("circle"))
    return _numbered([healthy, *(_eventful(n, seed, k) for n, k in product(names, range(each)))])


def _eventful(name: str, seed: int, draw: int) -> Case:
    """The case of an event in a draw.

    All courses are run on plants of the diagnosis' own family of errors, then on plants of another
    one; struts take turns.
    """
    rng = np.random.default_rng([seed, _STREAMS["event"], draw])
    posture = rng.normal(scale=_STANDING_M, size=6)
    seeds = rng.integers(2**32, size=2).tolist()
    early, turns = draw % (2 * COURSES) in _EARLY, draw // COURSES
    after_s = round(float(np.exp(rng.uniform(*np.log(_EARLY_S if early else _LATER_S)))), 3)
    turn_s, radius = np.exp(rng.uniform(*np.log([(1.0, 4.0), (0.5, 2.0)]).T)).tolist()
    latest_s = BENCH.duration_s - after_s - _AFTER_EVENT_S
    begin_s = 0.0 if early else round(float(rng.uniform(0, latest_s)), 3)
    spiral, circle = Course("spiral", turn_s, radius), Course("circle", turn_s, radius)
    courses = (Course(), spiral, spiral, circle, Course("steps", 4.0, 0.5), Course("rest"))
    strut = (draw + turns) % 6 if EVENTS[name].of == "actuator" else None
    return replace(
        of_hexapod("event", draw, seeds, begin_s, round(after_s + _AFTER_EVENT_S, 3), posture),
        mismatch="other family" if turns % 2 else "all",
        events=(Event(name, round(begin_s + after_s, 3), strut),),
        course=courses[draw % COURSES],
        compared=("unaware", *(["informed"] if name in get_args(Failing) else [])),
        transient_s=min(0.5, after_s / 2),
    )


# Any other robot, on a circle.

ROBOT_EVENTS_EACH, QUICK_ROBOT_EVENTS = 2, ("locked", "sag", "bias")
_LEARNED_S, _LEFT_S, _AFTER_ROBOT_EVENT_S = 0.8, 1.0, 1.5
"""What is not counted at the start, while the diagnosis learns; how long a run goes on once it has
recovered, and from an event on."""
_HEALTHY_S, _HEALTHY = 6.0, 3
"""Of each sensing: how long runs without failures last, and how many there are."""


def robot_failures(
    model: Path,
    options: Mapping[Sensing, RobotOptions],
    designs: Mapping[Sensing, DitherDesign | None],
    *,
    turn_s: float,
    seed: int,
    quick: bool,
) -> tuple[Case, ...]:
    """Each actuator fails in each way, as seen by each of some sensings, whose draws are equal."""
    cases = list[Case]()
    for sense, of_sense in options.items():
        rig, robot = exact_rig(model, of_sense), (model, of_sense, designs[sense], turn_s)
        design = designs[sense]
        found = () if design is None else design.separations.isolable()
        separated = {(fault.actuator, fault.kind) for fault in found}
        # One period of the slowest loop's crossover, in which errors decay; not less than on the
        # hexapod, whose loops are faster.
        recovered_s = max(0.5, 1 / min(margins.crossover_hz for margins in rig.margins))
        each = list(product(range(len(rig.actuators)), KINDS))
        for place, (actuator, kind) in enumerate(each[:1] if quick else each):
            rng = np.random.default_rng([seed, place])
            when_s = _time_s(rng, 1.5, 3.5)
            left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
            duration_s, own_seed = round(when_s + recovered_s + _LEFT_S, 3), rng.integers(2**32)
            case = replace(
                _on_circle("failure", place, int(own_seed), duration_s, *robot),
                failures=(Failure(actuator, kind, when_s, left),),
                compared=("informed",),
                recovered_s=recovered_s,
                isolable=(actuator, kind) in separated,
            )
            cases.append(case)
        for place in range(len(each), len(each) + (0 if quick else _HEALTHY)):
            own_seed = int(np.random.default_rng([seed, place]).integers(2**32))
            cases.append(_on_circle("healthy", place, own_seed, _HEALTHY_S, *robot))
    return _numbered(cases)


def robot_events(
    model: Path,
    options: RobotOptions,
    design: DitherDesign | None,
    *,
    names: Iterable[str],
    each: int,
    turn_s: float,
    seed: int,
) -> tuple[Case, ...]:
    """Cases of each event; those of one draw differ in what happens, and to which actuator."""
    actuators, cases = len(exact_rig(model, options).actuators), list[Case]()
    for (place, name), draw in product(enumerate(names), range(each)):
        rng = np.random.default_rng([seed, _EVENTS_OF_ROBOTS, draw])
        time_s = _time_s(rng, 1.0, 2.0)
        own_seed, begin = (int(number) for number in rng.integers(2**32, size=2))
        struck = (begin + place + draw) % actuators if EVENTS[name].of == "actuator" else None
        duration_s = round(time_s + _AFTER_ROBOT_EVENT_S, 3)
        case = _on_circle("event", draw, own_seed, duration_s, model, options, design, turn_s)
        cases.append(replace(case, events=(Event(name, time_s, struck),), compared=("unaware",)))
    return _numbered(cases)


def _on_circle(
    sort: Sort,
    draw: int,
    seed: int,
    duration_s: float,
    model: Path,
    options: RobotOptions,
    design: DitherDesign | None,
    turn_s: float,
) -> Case:
    dither = None if design is None else design.dither
    case = Case(0, sort, draw, "all", 1.0, seed, seed, 0.0, duration_s, dither)
    course = Course("circle", turn_s, plane_seed=seed)
    return replace(case, course=course, transient_s=_LEARNED_S, model=model, options=options)
