"""Cases of the study as numbers and words alone, each drawn from a seed and its place."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from math import ceil, inf
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from fjh.rig.dither import dither_entry, rig_dither
from fjh.rig.events import EVENTS, Event
from fjh.rig.hexapod.fault_tolerance import DITHER
from fjh.rig.hexapod.mismatch import ALONE, OTHER
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.mismatch import EXACT, Mismatch
from fjh.rig.mjcf import robot_rig
from fjh.rig.options import RobotOptions, Sensing
from fjh.rig.reach import check_reachable
from fjh.rig.rig import Rig
from ftc.fdi import KINDS, Dither, DitherDesign, Fault
from sim import Array, Failure
from sim.plant import FailureKind

BENCH = TestbedConfig()
Sort = Literal["failure", "size", "pair", "healthy", "event"]
"""What a case is for: one failure, beside an informed controller; the supervised controller alone,
against the size of a mismatch; two failures; no failure; an event, beside an unaware controller."""


@dataclass(frozen=True)
class Case:
    """One run with all controllers that are compared; so small that it can be sent anywhere.

    Its path is the testbed's spiral, from any time on; a circle from rest; steps out and back, each
    held for a quarter of a turn; or none.
    """

    sort: Sort
    number: int = 0  # in the study; column `case` of the dataset
    draw: int = 0  # of one draw are the same failure, path, noise and plant, as far as can be
    mismatch: str = "all"  # of plant and model, a name of :func:`sizes_of`
    factor: float = 1.0  # by which its sizes are multiplied
    plant_seed: int = 0
    seed: int = 0  # of the sensors' noise, and of what is drawn of events
    begin_s: float = 0.0  # time of its first tick; on the spiral, where it begins
    duration_s: float = 0.0
    course: Literal["spiral", "circle", "steps", "rest"] = "spiral"
    turn_s: float = BENCH.spiral_period_s
    radius: float = 1.0  # in sizes of the robot's path
    plane_seed: int | None = None  # of the plane of the path; None: the first two major rows
    dither: Dither | None = None  # about where the actuators stand
    failures: tuple[Failure, ...] = ()  # in the order of time
    events: tuple[Event, ...] = ()  # what else happens; one at most
    compared: tuple[str, ...] = ()  # controllers beside the supervised one: informed, unaware
    controller: str | None = None  # somebody else's, package.module:factory
    transient_s: float = 0.5  # start of the run that its errors do not count
    recovered_s: float = 0.5  # what counts as recovery begins so long after what happens
    isolable: bool | None = None  # in half a second by the uncertain linear model, if that is known
    model: Path | None = None  # MJCF file; None is the hexapod
    options: RobotOptions | None = None  # of the robot of a file

    @property
    def happens_s(self) -> float:
        """Time of its first failure or event; infinite where nothing happens."""
        return min((each.time_s for each in (*self.failures, *self.events)), default=inf)

    def rig(self) -> Rig:
        """The robot with the plant of this case, for all its controllers."""
        rig = exact_rig(self.model, self.options)
        return rig.with_mismatch(sizes_of(rig, self.mismatch).scaled(self.factor), self.plant_seed)

    def path(self, rig: Rig) -> Array:
        """Desired displacements of the major rows, shape (N, m1)."""
        if self.course == "spiral":
            size_urad = self.radius * BENCH.spiral_radius_urad
            bench = replace(BENCH, spiral_period_s=self.turn_s, spiral_radius_urad=size_urad)
            return bench.spiral_rad(self.duration_s, self.begin_s)
        rows = len(rig.major)
        if self.course == "rest":
            return np.zeros((round(self.duration_s / rig.period_s), rows))
        sized = replace(rig, size=self.radius * rig.size)
        path = sized.path(self.course, duration_s=self.duration_s, turn_s=self.turn_s)
        if self.plane_seed is None:
            return path
        normal = np.random.default_rng([self.plane_seed, 1]).normal(size=(rows, rows))
        return path @ np.linalg.qr(normal)[0]

    def parameters(self) -> dict[str, Any]:
        """The columns in which cases differ before they are simulated."""
        rig = exact_rig(self.model, self.options)
        row = {"case": self.number} | {name: getattr(self, name) for name in _DRAWN}
        row["sense"] = self.options.sense if self.options else "task"
        if self.isolable is not None:
            row["isolable"] = self.isolable
        for place, failure in zip(("", "second_"), self.failures, strict=False):
            fault = Fault.of(failure)
            row |= {f"{place}actuator": rig.actuators[fault.actuator], f"{place}kind": fault.kind}
            row |= {f"{place}effectiveness": fault.effectiveness, f"{place}time_s": failure.time_s}
        for event in self.events:
            own = None if event.actuator is None else rig.actuators[rig.number(event.actuator)]
            row |= {"event": event.name, "time_s": event.time_s, "actuator": own}
        return row


_DRAWN = (
    *("sort", "draw", "mismatch", "factor", "plant_seed", "seed", "begin_s", "duration_s"),
    *("course", "turn_s", "radius"),
)


@lru_cache(maxsize=4)
def exact_rig(model: Path | None = None, options: RobotOptions | None = None) -> Rig:
    """The hexapod, or the robot of a file, on its exact plant: once in each process."""
    return hexapod_rig() if model is None or options is None else robot_rig(model, options)


def sizes_of(rig: Rig, mismatch: str) -> Mismatch:
    """How far a plant of a name is from the model."""
    named = {"exact": EXACT, "all": rig.machine.everything, "other family": OTHER, **ALONE}
    return named[mismatch]


# The cases: failures and events, of the hexapod and of other robots.

BEFORE_S, AFTER_S = 1.2, 2.5
"""Of a run of the hexapod, before and after its failure."""
COURSES = 6
"""Of the draws of an event in turn: the spiral, three times, twice at another speed and radius; a
circle; steps that are held; rest."""

_STREAMS: dict[Sort, int] = {"failure": 2, "size": 2, "pair": 4, "healthy": 5, "event": 6}
_HEALTHY_AMONG_EVENTS, _EVENTS_OF_ROBOTS = 7, 8
"""Of random numbers; failures are the same at every size."""
_STANDING_M, _EFFECTIVENESS = 10e-6, (0.2, 0.8)
_AFTER_EVENT_S, _EARLY_S, _LATER_S = 3.0, (0.2, 0.8), (0.9, 6.0)
_EARLY = (2, 9)
"""Draws, of every twelve, whose event happens while the diagnosis is still learning."""
_LEARNED_S, _LEFT_S, _AFTER_ROBOT_EVENT_S = 0.8, 1.0, 1.5
"""Of other robots: what is not counted at the start, while the diagnosis learns; how long a run
goes on once it has recovered, and from an event on."""
_HEALTHY_S, _HEALTHY = 6.0, 3
"""Of other robots and each sensing: how long runs without failures last, and how many there are."""

Block = tuple[Sort, str, float, int]
"""Sort, mismatch, factor and number of cases."""

FACTORS = (0.3, 3.0, 10.0, 30.0, 100.0)
"""Sizes of a mismatch beside one, which the failures have, and zero, the exact plant."""
_LARGEST = {"drift_urad_per_s": 100.0, "gain_drift_per_s": 100.0}
_LARGEST |= {"damping": 3.0, "all": 3.0, "timestep_s": 0.0}
"""Of the factors: a damper has no negative constant, a physics step no size. Others end at 30,
where gains and springs are within 90 %, and a delay makes the loop itself unstable."""
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
EVENTS_EACH, ROBOT_EVENTS_EACH = 12, 2
QUICK_EVENTS, QUICK_ROBOT_EVENTS = ("locked", "hard_over", "sag", "bias"), ("locked", "sag", "bias")


def hexapod_cases(drawn_from: Mapping[str, Any], healthy: int) -> tuple[Case, ...]:
    """Cases of the hexapod from what they are drawn from, with so many healthy runs if they fail.

    Args:
        drawn_from: The seed, and the arguments of :func:`hexapod_events` as "events" or those of
            :func:`hexapod_failures` as "flights", as in the basis of the dataset.
        healthy: More runs without failures can be simulated later.
    """
    seed = drawn_from["seed"]
    if "events" in drawn_from:
        return hexapod_events(**drawn_from["events"], seed=seed)
    return hexapod_failures(**drawn_from["flights"], healthy=healthy, seed=seed)


def healthy_for(hours: float) -> int:
    """How many runs without failures last at least so many hours."""
    return ceil(round(hours * 3600 / BENCH.duration_s, 6))


def hexapod_failures(
    blocks: Sequence[Block],
    healthy: int,
    healthy_s: float,
    seed: int,
    controller: str | None = None,
) -> tuple[Case, ...]:
    """Struts fail at random times and in random postures on the spiral; then so many healthy runs.

    The number of these comes last, as it may change.
    """
    cases = list[Case]()
    last: Block = ("healthy", "all", 1.0, healthy)
    for sort, mismatch, factor, count in (*blocks, last):
        how: dict[str, Any] = {"mismatch": mismatch, "factor": factor}
        if sort == "failure" and mismatch == "all":
            how |= {"compared": ("informed", "unaware"), "controller": controller}
        elif sort == "failure":
            how["compared"] = ("informed",)
        cases += [replace(_on_spiral(sort, seed, draw, healthy_s), **how) for draw in range(count)]
    return numbered(cases)


def _on_spiral(sort: Sort, seed: int, draw: int, healthy_s: float) -> Case:
    rng = np.random.default_rng([seed, _STREAMS[sort], draw])
    case = replace(_standing(sort, rng), draw=draw)
    if sort == "healthy":
        return replace(case, duration_s=healthy_s)
    after_s = AFTER_S
    if sort == "pair":
        struts = rng.permutation(6)[:2].tolist()
        rigid: tuple[FailureKind, ...] = ("locked", "free")
        kinds = [rigid[k] for k in rng.integers(len(rigid), size=2)]
        first_s = _time_s(rng, 1.5, 9.0)
        times_s = first_s, round(first_s + _time_s(rng, 0.1, 2.0), 3)
        failures = tuple(map(Failure, struts, kinds, times_s))
        after_s = times_s[1] - first_s + 2.0
        case = replace(case, dither=about(0.0))  # where opposite struts are most alike
    else:
        strut, kind = list(product(range(6), KINDS))[draw % (6 * len(KINDS))]
        left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        failures = (Failure(strut, kind, _time_s(rng, 1.5, 13.4), left),)
    return around(replace(case, failures=failures), after_s)


def _standing(sort: Sort, rng: np.random.Generator) -> Case:
    """A case of the hexapod in a random posture, with seeds of its own."""
    posture = rng.normal(scale=_STANDING_M, size=6)
    plant_seed, seed = rng.integers(2**32, size=2).tolist()
    return Case(sort, plant_seed=plant_seed, seed=seed, dither=about(posture))


def about(posture: Array | float) -> Dither:
    """The dither of the hexapod about where the struts stand, (6,) or one for all, [m]."""
    return replace(DITHER, offset=tuple(np.broadcast_to(posture, 6).tolist()))


def around(case: Case, after_s: float = AFTER_S) -> Case:
    """A case with the part of the spiral around its first failure."""
    return replace(case, begin_s=case.happens_s - BEFORE_S, duration_s=BEFORE_S + after_s)


def _time_s(rng: np.random.Generator, low_s: float, high_s: float) -> float:
    """Whole control periods, so that all cases of a draw are sampled alike."""
    return round(float(rng.uniform(low_s, high_s)), 3)


def numbered(cases: Iterable[Case]) -> tuple[Case, ...]:
    """The same cases with their numbers, in their order."""
    return tuple(replace(case, number=number) for number, case in enumerate(cases))


def hexapod_events(
    names: Iterable[str], each: int, healthy_s: float, seed: int
) -> tuple[Case, ...]:
    """A run without events, which takes longest, and so many of each event.

    Cases of one draw have the same plant, course, posture, time and noise, whatever happens: what
    an event costs is not the luck of the draw.
    """
    rng = np.random.default_rng([seed, _HEALTHY_AMONG_EVENTS])
    plant_seed, own_seed = rng.integers(2**32, size=2).tolist()
    dither = about(rng.normal(scale=_STANDING_M, size=6))
    healthy = Case("healthy", plant_seed=plant_seed, seed=own_seed, dither=dither)
    healthy = replace(healthy, duration_s=healthy_s, course="circle")
    return numbered([healthy, *(_eventful(n, seed, k) for n, k in product(names, range(each)))])


def _eventful(name: str, seed: int, draw: int) -> Case:
    """The case of an event in a draw.

    All courses are run on plants of the diagnosis' own family of errors, then on plants of another
    one; struts take turns.
    """
    rng = np.random.default_rng([seed, _STREAMS["event"], draw])
    case = _standing("event", rng)
    early, turns = draw % (2 * COURSES) in _EARLY, draw // COURSES
    after_s = round(float(np.exp(rng.uniform(*np.log(_EARLY_S if early else _LATER_S)))), 3)
    turn_s, radius = np.exp(rng.uniform(*np.log([(1.0, 4.0), (0.5, 2.0)]).T)).tolist()
    sized = {"turn_s": turn_s, "radius": radius}
    steps = {"course": "steps", "turn_s": 4.0, "radius": 0.5}
    courses = ({}, sized, sized, {"course": "circle", **sized}, steps, {"course": "rest"})
    latest_s = BENCH.duration_s - after_s - _AFTER_EVENT_S
    begin_s = 0.0 if early else round(float(rng.uniform(0, latest_s)), 3)
    strut = (draw + turns) % 6 if EVENTS[name].of == "actuator" else None
    return replace(
        case,
        draw=draw,
        mismatch="other family" if turns % 2 else "all",
        begin_s=begin_s,
        duration_s=round(after_s + _AFTER_EVENT_S, 3),
        events=(Event(name, round(begin_s + after_s, 3), strut),),
        compared=("unaware", *(["informed"] if name in get_args(FailureKind) else [])),
        transient_s=min(0.5, after_s / 2),
        **courses[draw % COURSES],
    )


def recovered_s(rig: Rig) -> float:
    """One period of the slowest loop's crossover, in which errors after a failure decay.

    Not less than on the hexapod, whose loops are faster.
    """
    return max(0.5, 1 / min(each.crossover_hz for each in rig.margins))


def robot_cases(
    file: Path,
    robot: RobotOptions,
    turn_s: float,
    dither: str,
    events: Sequence[str],
    *,
    seed: int,
    quick: bool,
) -> tuple[tuple[Case, ...], dict[Sensing, dict[str, Any] | None]]:
    """Failures of any robot, or these events, on a circle; and its dither for each sensing.

    Raises:
        WrongInput: Something that the robot does not have or cannot do.
        sim.ModelError: The file, or what it says.
    """
    cases, dithers = list[Case](), dict[Sensing, dict[str, Any] | None]()
    senses: tuple[Sensing, ...] = ("both",) if quick or events else get_args(Sensing)
    for sense in senses:
        options = replace(robot, sense=sense)
        design = rig_dither(rig := exact_rig(file, options), dither)
        dithers[sense] = dither_entry(design, rig)
        first = Case(
            "event" if events else "failure",
            model=file,
            options=options,
            dither=None if design is None else design.dither,
            course="circle",
            turn_s=turn_s,
            transient_s=_LEARNED_S,
        )
        if events:
            cases += robot_events(first, events, 1 if quick else ROBOT_EVENTS_EACH, seed)
        else:
            cases += robot_failures(first, design, seed, quick)
    for case in {(case.options, case.plane_seed, case.duration_s): case for case in cases}.values():
        check_reachable(rig := exact_rig(file, case.options), case.path(rig))
    return numbered(cases), dithers


def robot_failures(
    first: Case, design: DitherDesign | None, seed: int, quick: bool
) -> Iterator[Case]:
    """Each actuator of a robot fails in each way, the same for every sensing; then healthy runs."""
    rig = exact_rig(first.model, first.options)
    found = () if design is None else design.separations.isolable()
    separated = {(fault.actuator, fault.kind) for fault in found}
    each = list(product(range(len(rig.actuators)), KINDS))
    for place, (actuator, kind) in enumerate(each[:1] if quick else each):
        rng = np.random.default_rng([seed, place])
        when_s = _time_s(rng, 1.5, 3.5)
        left = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        yield replace(
            _of_robot(first, place, int(rng.integers(2**32))),
            duration_s=round(when_s + recovered_s(rig) + _LEFT_S, 3),
            failures=(Failure(actuator, kind, when_s, left),),
            compared=("informed",),
            recovered_s=recovered_s(rig),
            isolable=(actuator, kind) in separated,
        )
    for place in range(len(each), len(each) + (0 if quick else _HEALTHY)):
        own_seed = int(np.random.default_rng([seed, place]).integers(2**32))
        yield replace(_of_robot(first, place, own_seed), sort="healthy", duration_s=_HEALTHY_S)


def robot_events(first: Case, names: Iterable[str], each: int, seed: int) -> Iterator[Case]:
    """Cases of each event; those of one draw differ in what happens, and to which actuator."""
    actuators = len(exact_rig(first.model, first.options).actuators)
    for (place, name), draw in product(enumerate(names), range(each)):
        rng = np.random.default_rng([seed, _EVENTS_OF_ROBOTS, draw])
        time_s = _time_s(rng, 1.0, 2.0)
        own_seed, begin = rng.integers(2**32, size=2).tolist()
        struck = (begin + place + draw) % actuators if EVENTS[name].of == "actuator" else None
        yield replace(
            _of_robot(first, draw, own_seed),
            duration_s=round(time_s + _AFTER_ROBOT_EVENT_S, 3),
            events=(Event(name, time_s, struck),),
            compared=("unaware",),
        )


def _of_robot(first: Case, draw: int, seed: int) -> Case:
    return replace(first, draw=draw, plant_seed=seed, seed=seed, plane_seed=seed)
