"""Cases of the study as numbers and words alone, each drawn from a seed and its place."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from math import inf
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from experiments.rig.events import EVENTS, Event
from experiments.rig.hexapod.fault_tolerance import DITHER
from experiments.rig.hexapod.mismatch import ALONE, OTHER
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.mismatch import EXACT, Mismatch
from experiments.rig.mjcf import robot_rig
from experiments.rig.options import RobotOptions
from experiments.rig.rig import Rig
from ftc.fdi.dither import Dither
from ftc.fdi.dither_design import DitherDesign
from ftc.fdi.fault_model import KINDS, Fault
from sim import Array, Failure, FailureKind

BENCH = TestbedConfig()
MISMATCHES = ("exact", *ALONE, "all", "other family")
"""Names of differences of plant and model, in the order of the tables."""

Sort = Literal["failure", "size", "pair", "healthy", "event"]
"""What a case is for: one failure, beside an informed controller; the supervised controller alone,
against the size of a mismatch; two failures; no failure; an event, beside an unaware controller."""


@dataclass(frozen=True)
class Course:
    """A path of the major rows.

    Attributes:
        shape: The testbed's spiral, from any time on; a circle from rest; steps out and back, each
            held for a quarter of a turn; or none.
        turn_s: Time of one turn.
        radius: In sizes of the robot's path.
        plane_seed: Of the plane of the major rows in which it lies; None: the first two rows.
    """

    shape: Literal["spiral", "circle", "steps", "rest"] = "spiral"
    turn_s: float = BENCH.spiral_period_s
    radius: float = 1.0
    plane_seed: int | None = None


@dataclass(frozen=True)
class Case:
    """One run with all controllers that are compared; so small that it can be sent anywhere.

    Attributes:
        sort: What it is for.
        number: In the study; column `case` of the dataset.
        draw: Cases of one draw have the same failure, path, noise and plant, as far as they can.
        mismatch: Of plant and model, a name in `MISMATCHES`.
        factor: By which its sizes are multiplied.
        plant_seed: Of the plant.
        seed: Of the sensors' noise, and of what is drawn of events.
        begin_s: Time of its first tick; on the spiral, where it begins.
        duration_s: How long it lasts.
        dither: Secondary motion, about where the actuators stand; None is none.
        failures: What happens, in the order of time.
        events: What else happens; one at most.
        course: Path of the major rows.
        compared: Controllers beside the supervised one, "informed" and "unaware".
        transient_s: Start of the run that its errors do not count.
        recovered_s: What counts as recovery begins so long after what happens.
        isolable: Whether the dither separates the failure in half a second, by the uncertain linear
            model; None: that is not known.
        model: MJCF file; None is the hexapod.
        options: Of the robot of a file.
    """

    sort: Sort
    number: int = 0
    draw: int = 0
    mismatch: str = "all"
    factor: float = 1.0
    plant_seed: int = 0
    seed: int = 0
    begin_s: float = 0.0
    duration_s: float = 0.0
    dither: Dither | None = None
    failures: tuple[Failure, ...] = ()
    events: tuple[Event, ...] = ()
    course: Course = Course()
    compared: tuple[str, ...] = ()
    transient_s: float = 0.5
    recovered_s: float = 0.5
    isolable: bool | None = None
    model: Path | None = None
    options: RobotOptions | None = None

    @property
    def happens_s(self) -> float:
        """Time of its first failure or event; infinite where nothing happens."""
        return min((each.time_s for each in (*self.failures, *self.events)), default=inf)

    def rig(self) -> Rig:
        """The robot with the plant of this case, for all its controllers."""
        rig = exact_rig(self.model, self.options)
        return rig.drawn(sizes_of(rig, self.mismatch).scaled(self.factor), self.plant_seed)

    def path(self, rig: Rig) -> Array:
        """Desired displacements of the major rows, shape (N, m1)."""
        course, rows = self.course, len(rig.major)
        if course.shape == "spiral":
            size_urad = course.radius * BENCH.spiral_radius_urad
            bench = replace(BENCH, spiral_period_s=course.turn_s, spiral_radius_urad=size_urad)
            return bench.spiral_rad(self.duration_s, self.begin_s)
        if course.shape == "rest":
            return np.zeros((round(self.duration_s / rig.period_s), rows))
        sized = replace(rig, size=course.radius * rig.size)
        path = sized.path(course.shape, duration_s=self.duration_s, turn_s=course.turn_s)
        if course.plane_seed is None:
            return path
        normal = np.random.default_rng([course.plane_seed, 1]).normal(size=(rows, rows))
        return path @ np.linalg.qr(normal)[0]

    def parameters(self) -> dict[str, Any]:
        """The columns in which cases differ before they are simulated."""
        rig, course = exact_rig(self.model, self.options), self.course
        row = {name: getattr(self, name) for name in _PARAMETERS}
        row |= {"case": self.number, "sense": self.options.sense if self.options else "task"}
        row |= {"course": course.shape, "turn_s": course.turn_s, "radius": course.radius}
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


_PARAMETERS = (
    *("sort", "draw", "mismatch", "factor", "plant_seed", "seed"),
    *("begin_s", "duration_s"),
)


@lru_cache(maxsize=4)
def exact_rig(model: Path | None = None, options: RobotOptions | None = None) -> Rig:
    """The hexapod, or the robot of a file, on its exact plant: once in each process."""
    return hexapod_rig() if model is None or options is None else robot_rig(model, options)


def sizes_of(rig: Rig, mismatch: str) -> Mismatch:
    """How far a plant of a name in `MISMATCHES` is from the model."""
    named = {"exact": EXACT, "all": rig.machine.everything, "other family": OTHER, **ALONE}
    return named[mismatch]


# The four campaigns.

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


def hexapod_failures(
    blocks: Sequence[Block], healthy: int, healthy_s: float, seed: int
) -> tuple[Case, ...]:
    """Struts fail at random times and in random postures on the spiral; then so many healthy runs.

    The number of these comes last, as it may change.
    """
    cases = list[Case]()
    last: Block = ("healthy", "all", 1.0, healthy)
    for sort, mismatch, factor, count in (*blocks, last):
        compared = ("informed", *(["unaware"] if mismatch == "all" else []))
        how = {"mismatch": mismatch, "factor": factor}
        how["compared"] = compared if sort == "failure" else ()
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
    healthy = replace(healthy, duration_s=healthy_s, course=Course("circle"))
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
    latest_s = BENCH.duration_s - after_s - _AFTER_EVENT_S
    begin_s = 0.0 if early else round(float(rng.uniform(0, latest_s)), 3)
    spiral, circle = Course("spiral", turn_s, radius), Course("circle", turn_s, radius)
    courses = (Course(), spiral, spiral, circle, Course("steps", 4.0, 0.5), Course("rest"))
    strut = (draw + turns) % 6 if EVENTS[name].of == "actuator" else None
    return replace(
        case,
        draw=draw,
        mismatch="other family" if turns % 2 else "all",
        begin_s=begin_s,
        duration_s=round(after_s + _AFTER_EVENT_S, 3),
        events=(Event(name, round(begin_s + after_s, 3), strut),),
        course=courses[draw % COURSES],
        compared=("unaware", *(["informed"] if name in get_args(FailureKind) else [])),
        transient_s=min(0.5, after_s / 2),
    )


def on_circle(case: Case, turn_s: float, design: DitherDesign | None) -> Case:
    """A case of another robot, of which others are made: on a circle in a plane of their own."""
    dither, course = None if design is None else design.dither, Course("circle", turn_s)
    return replace(case, dither=dither, course=course, transient_s=_LEARNED_S)


def recovered_s(rig: Rig) -> float:
    """One period of the slowest loop's crossover, in which errors after a failure decay.

    Not less than on the hexapod, whose loops are faster.
    """
    return max(0.5, 1 / min(each.crossover_hz for each in rig.margins))


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
    course = replace(first.course, plane_seed=seed)
    return replace(first, draw=draw, plant_seed=seed, seed=seed, course=course)
