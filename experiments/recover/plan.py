"""Cases of the study `recover`, each sampled from a seed and the index of the case."""

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
from fjh.rig.hexapod.mismatch import ALONE, SAMPLED
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
FAMILIES = ("all", "other family")
"""Mismatches of runs without failures, alternately, and of runs with events."""
Sort = Literal["failure", "size", "pair", "healthy", "event"]
"""Purpose of a case: a failure, compared with an informed controller; a size of mismatch, with the
supervisor only; two failures; none; or an event, compared with a controller without diagnosis."""


@dataclass(frozen=True)
class Case:
    """Parameters of a run with all compared controllers, few numbers that are sent to workers.

    The path is the testbed's spiral from a given time on, a circle from rest, steps outwards and
    back (a quarter of a turn each), or a constant position.
    """

    sort: Sort
    number: int = 0  # in the study; column `case` of the dataset
    draw: int = 0  # cases with the same number share failure, path, noise and plant if possible
    mismatch: str = "all"  # of plant and model, a name of :func:`sizes_of`
    factor: float = 1.0  # of the sizes of the mismatch
    plant_seed: int = 0
    seed: int = 0  # of the sensors' noise, and of random parameters of events
    begin_s: float = 0.0  # time of the first tick; on the spiral, its starting point
    duration_s: float = 0.0
    course: Literal["spiral", "circle", "steps", "rest"] = "spiral"
    turn_s: float = BENCH.spiral_period_s
    radius: float = 1.0  # in sizes of the robot's path
    plane_seed: int | None = None  # of the plane of the path; None: the first two major rows
    dither: Dither | None = None  # about the actuators' posture
    failures: tuple[Failure, ...] = ()  # in the order of time
    events: tuple[Event, ...] = ()  # at most one
    compared: tuple[str, ...] = ()  # controllers other than the supervised: informed, unaware
    controller: str | None = None  # another controller, package.module:factory
    transient_s: float = 0.5  # start of the run excluded from its errors
    recovered_s: float = 0.5  # time from the failure or event to the start of "after recovery"
    isolable: bool | None = None  # in half a second by the uncertain linear model, if computed
    model: Path | None = None  # MJCF file; None is the hexapod
    options: RobotOptions | None = None  # of the robot of a file

    @property
    def onset_s(self) -> float:
        """Time of the first failure or event; infinite without one."""
        return min((item.time_s for item in (*self.failures, *self.events)), default=inf)

    def rig(self) -> Rig:
        """Return the robot with the plant of this case, for all controllers."""
        rig = exact_rig(self.model, self.options)
        return rig.with_mismatch(sizes_of(rig, self.mismatch).scaled(self.factor), self.plant_seed)

    def path(self, rig: Rig) -> Array:
        """Return the desired displacements of the major rows, [rad] or [m], shape (N, m1)."""
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
        """Return the parameters as columns of the dataset."""
        rig = exact_rig(self.model, self.options)
        row = {"case": self.number} | {name: getattr(self, name) for name in _SAMPLED}
        row["sense"] = self.options.sense if self.options else "task"
        if self.isolable is not None:
            row["isolable"] = self.isolable
        for place, failure in zip(("", "second_"), self.failures, strict=False):
            fault = Fault.of(failure)
            row |= {f"{place}actuator": rig.actuators[fault.actuator], f"{place}kind": fault.kind}
            row |= {f"{place}effectiveness": fault.effectiveness, f"{place}time_s": failure.time_s}
        for event in self.events:
            name = None if event.actuator is None else rig.actuators[rig.number(event.actuator)]
            row |= {"event": event.name, "time_s": event.time_s, "actuator": name}
        return row


_SAMPLED = (
    *("sort", "draw", "mismatch", "factor", "plant_seed", "seed", "begin_s", "duration_s"),
    *("course", "turn_s", "radius"),
)


@lru_cache(maxsize=4)
def exact_rig(model: Path | None = None, options: RobotOptions | None = None) -> Rig:
    """Return the hexapod, or the robot of a file, on its exact plant, built once per process."""
    return hexapod_rig() if model is None or options is None else robot_rig(model, options)


def sizes_of(rig: Rig, mismatch: str) -> Mismatch:
    """Return the mismatch of plant and model with this name.

    "other family" is none that the diagnosis assumes: log-normal, correlated, twice as wide.
    """
    everything = rig.machine.everything
    twice = {name: 2 * getattr(everything, name) for name in SAMPLED}
    other = replace(everything, family="lognormal", **twice)
    return {"exact": EXACT, "all": everything, FAMILIES[1]: other, **ALONE}[mismatch]


# The cases: failures and events, of the hexapod and of other robots.

BEFORE_S, AFTER_S = 1.2, 2.5
"""Durations [s] of a run of the hexapod before and after the failure."""
COURSES = 6
"""Number of paths for each event: the spiral (as in the testbed, and with two other speeds and
radii), a circle, steps, a constant position."""

_STREAMS: dict[Sort, int] = {"failure": 2, "size": 2, "pair": 4, "healthy": 5, "event": 6}
_HEALTHY_AMONG_EVENTS, _EVENTS_OF_ROBOTS = 7, 8
"""Numbers of random streams."""
_POSTURE_M, _EFFECTIVENESS = 10e-6, (0.2, 0.8)
_AFTER_EVENT_S, _EARLY_S, _LATER_S = 3.0, (0.2, 0.8), (0.9, 6.0)
_EARLY = (2, 9)
"""Indices, of every twelve cases, with the event in the learning phase of the diagnosis."""
_LEARNED_S, _LEFT_S, _AFTER_ROBOT_EVENT_S = 0.8, 1.0, 1.5
"""Durations [s] in runs of other robots: learning phase (excluded from errors), time after
recovery, time after an event."""
_HEALTHY_S, _HEALTHY = 6.0, 12
"""Duration [s] and number of healthy runs of other robots for each sensor configuration."""

Block = tuple[Sort, str, float, int]
"""Block of cases: sort, mismatch, factor and number of cases."""

FACTORS = (0.3, 3.0, 10.0, 30.0, 100.0)
"""Factors of mismatches, in addition to 1 (cases with failures) and 0 (exact plant)."""
_LARGEST = {"drift_urad_per_s": 100.0, "gain_drift_per_s": 100.0}
_LARGEST |= {"damping": 3.0, "all": 3.0, "timestep_s": 0.0}
"""Largest factors: damping cannot be negative, a physics step has no size. Others end at 30, where
gains and springs differ by up to 90 %, and a delay makes the loop unstable."""
WHOLE: list[Block] = [
    ("failure", "exact", 1.0, 60),
    ("failure", "all", 1.0, 306),
    ("failure", "other family", 1.0, 102),
    *(("failure", name, 1.0, 36) for name in ALONE),
    *(
        ("size", name, factor, 3)
        for name, factor in product(("all", *ALONE), FACTORS)
        if factor <= _LARGEST.get(name, 30.0)
    ),
    ("pair", "all", 1.0, 24),
]
"""Blocks of the full study. With 95 % confidence, 306 of 306 correct cases imply a rate above 98.8
%, 36 of 36 one above 90 %. The three cases of each size (locked, free, weak) only show where the
diagnosis fails."""
QUICK: list[Block] = [
    ("failure", "exact", 1.0, 1),
    ("failure", "all", 1.0, 3),
    *(("size", "all", factor, 1) for factor in FACTORS[:2]),
    ("pair", "all", 1.0, 1),
]
EVENTS_EACH = 12
QUICK_EVENTS, QUICK_ROBOT_EVENTS = ("locked", "hard_over", "sag", "bias"), ("locked", "sag", "bias")


def hexapod_cases(sampling: Mapping[str, Any], healthy: int) -> tuple[Case, ...]:
    """Return the cases of the hexapod: events, or failures and healthy runs.

    Args:
        sampling: Basis of the dataset: seed, and arguments of :func:`hexapod_events` as "events" or
            of :func:`hexapod_failures` as "flights".
        healthy: Number of healthy runs, which may increase later.
    """
    seed = sampling["seed"]
    if "events" in sampling:
        return hexapod_events(**sampling["events"], seed=seed)
    return hexapod_failures(**sampling["flights"], healthy=healthy, seed=seed)


def healthy_for(hours: float) -> int:
    """Return the number of healthy runs that last at least this long in total."""
    return ceil(round(hours * 3600 / BENCH.duration_s, 6))


def hexapod_failures(
    blocks: Sequence[Block],
    healthy: int,
    healthy_s: float,
    seed: int,
    controller: str | None = None,
) -> tuple[Case, ...]:
    """Return cases with failures at random times and postures on the spiral, then healthy ones.

    Healthy runs are last because their number may change.
    """
    cases = list[Case]()
    for sort, mismatch, factor, count in blocks:
        options: dict[str, Any] = {"mismatch": mismatch, "factor": factor}
        if sort == "failure" and mismatch in FAMILIES:
            options |= {"compared": ("informed", "unaware"), "controller": controller}
        elif sort == "failure":
            options["compared"] = ("informed",)
        cases += [replace(_on_spiral(sort, seed, k, healthy_s), **options) for k in range(count)]
    for k in range(healthy):
        cases.append(replace(_on_spiral("healthy", seed, k, healthy_s), mismatch=FAMILIES[k % 2]))
    return numbered(cases)


def _on_spiral(sort: Sort, seed: int, index: int, healthy_s: float) -> Case:
    rng = np.random.default_rng([seed, _STREAMS[sort], index])
    case = replace(_random_posture(sort, rng), draw=index)
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
        case = replace(case, dither=about(0.0))  # opposite struts are hardest to distinguish there
    else:
        strut, kind = list(product(range(6), KINDS))[index % (6 * len(KINDS))]
        effectiveness = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        failures = (Failure(strut, kind, _time_s(rng, 1.5, 13.4), effectiveness),)
    return around(replace(case, failures=failures), after_s)


def _random_posture(sort: Sort, rng: np.random.Generator) -> Case:
    """Return a case of the hexapod with random posture and seeds."""
    posture = rng.normal(scale=_POSTURE_M, size=6)
    plant_seed, seed = rng.integers(2**32, size=2).tolist()
    return Case(sort, plant_seed=plant_seed, seed=seed, dither=about(posture))


def about(posture: Array | float) -> Dither:
    """Return the hexapod's dither about strut displacements [m], shape (6,) or one for all."""
    return replace(DITHER, offset=tuple(np.broadcast_to(posture, 6).tolist()))


def around(case: Case, after_s: float = AFTER_S) -> Case:
    """Return a case that is cut to the part of the spiral around its first failure."""
    return replace(case, begin_s=case.onset_s - BEFORE_S, duration_s=BEFORE_S + after_s)


def _time_s(rng: np.random.Generator, low_s: float, high_s: float) -> float:
    return round(float(rng.uniform(low_s, high_s)), 3)


def numbered(cases: Iterable[Case]) -> tuple[Case, ...]:
    """Return the cases with numbers in their order."""
    return tuple(replace(case, number=number) for number, case in enumerate(cases))


def hexapod_events(
    names: Iterable[str], each: int, healthy_s: float, seed: int
) -> tuple[Case, ...]:
    """Return the longest case, a run without events, and `each` cases of each event.

    Cases with the same index differ only in the event; plant, path, posture, time and noise are the
    same.
    """
    rng = np.random.default_rng([seed, _HEALTHY_AMONG_EVENTS])
    plant_seed, noise_seed = rng.integers(2**32, size=2).tolist()
    dither = about(rng.normal(scale=_POSTURE_M, size=6))
    healthy = Case("healthy", plant_seed=plant_seed, seed=noise_seed, dither=dither)
    healthy = replace(healthy, duration_s=healthy_s, course="circle")
    return numbered([healthy, *(_with_event(n, seed, k) for n, k in product(names, range(each)))])


def _with_event(name: str, seed: int, index: int) -> Case:
    """Return the case of an event with this index.

    All paths occur first on plants of the mismatch family that the diagnosis assumes, then of
    another family; the struts alternate.
    """
    rng = np.random.default_rng([seed, _STREAMS["event"], index])
    case = _random_posture("event", rng)
    early, turns = index % (2 * COURSES) in _EARLY, index // COURSES
    after_s = round(float(np.exp(rng.uniform(*np.log(_EARLY_S if early else _LATER_S)))), 3)
    turn_s, radius = np.exp(rng.uniform(*np.log([(1.0, 4.0), (0.5, 2.0)]).T)).tolist()
    sized = {"turn_s": turn_s, "radius": radius}
    steps = {"course": "steps", "turn_s": 4.0, "radius": 0.5}
    courses = ({}, sized, sized, {"course": "circle", **sized}, steps, {"course": "rest"})
    latest_s = BENCH.duration_s - after_s - _AFTER_EVENT_S
    begin_s = 0.0 if early else round(float(rng.uniform(0, latest_s)), 3)
    strut = (index + turns) % 6 if EVENTS[name].of == "actuator" else None
    return replace(
        case,
        draw=index,
        mismatch=FAMILIES[turns % 2],
        begin_s=begin_s,
        duration_s=round(after_s + _AFTER_EVENT_S, 3),
        events=(Event(name, round(begin_s + after_s, 3), strut),),
        compared=("unaware", *(["informed"] if name in get_args(FailureKind) else [])),
        transient_s=min(0.5, after_s / 2),
        **courses[index % COURSES],
    )


def recovered_s(rig: Rig) -> float:
    """Return the time [s] in which errors after a failure decay: a period of the slowest crossover.

    The time is at least that of the hexapod, whose loops are fast.
    """
    return max(0.5, 1 / min(loop.crossover_hz for loop in rig.margins))


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
    """Return cases of any robot on a circle, with failures or events, and the dithers by sensing.

    Raises:
        WrongInput: An option does not fit the robot.
        sim.ModelError: The file or its model is invalid.
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
            cases += robot_events(first, events, 1 if quick else EVENTS_EACH, seed)
        else:
            cases += robot_failures(first, design, seed, quick)
    for case in {(case.options, case.plane_seed, case.duration_s): case for case in cases}.values():
        check_reachable(rig := exact_rig(file, case.options), case.path(rig))
    return numbered(cases), dithers


def robot_failures(
    first: Case, design: DitherDesign | None, seed: int, quick: bool
) -> Iterator[Case]:
    """Yield failures of each kind and actuator, equal for every sensing, then healthy runs."""
    rig = exact_rig(first.model, first.options)
    isolable = () if design is None else design.separations.isolable()
    separated = {(fault.actuator, fault.kind) for fault in isolable}
    combinations = list(product(range(len(rig.actuators)), KINDS))
    for place, (actuator, kind) in enumerate(combinations[:1] if quick else combinations):
        rng = np.random.default_rng([seed, place])
        when_s = _time_s(rng, 1.5, 3.5)
        effectiveness = float(rng.uniform(*_EFFECTIVENESS)) if kind == "weak" else 0.0
        yield replace(
            _of_robot(first, place, int(rng.integers(2**32))),
            duration_s=round(when_s + recovered_s(rig) + _LEFT_S, 3),
            failures=(Failure(actuator, kind, when_s, effectiveness),),
            compared=("informed",),
            recovered_s=recovered_s(rig),
            isolable=(actuator, kind) in separated,
        )
    for place in range(len(combinations), len(combinations) + (0 if quick else _HEALTHY)):
        case_seed = int(np.random.default_rng([seed, place]).integers(2**32))
        healthy = replace(_of_robot(first, place, case_seed), sort="healthy")
        yield replace(healthy, duration_s=_HEALTHY_S, mismatch=FAMILIES[place % 2])


def robot_events(first: Case, names: Iterable[str], count: int, seed: int) -> Iterator[Case]:
    """Yield cases of each event; those with the same index differ only in event and actuator."""
    actuators = len(exact_rig(first.model, first.options).actuators)
    for (place, name), index in product(enumerate(names), range(count)):
        rng = np.random.default_rng([seed, _EVENTS_OF_ROBOTS, index])
        time_s = _time_s(rng, 1.0, 2.0)
        case_seed, offset = rng.integers(2**32, size=2).tolist()
        actuator = (offset + place + index) % actuators if EVENTS[name].of == "actuator" else None
        yield replace(
            _of_robot(first, index, case_seed),
            duration_s=round(time_s + _AFTER_ROBOT_EVENT_S, 3),
            mismatch=FAMILIES[index % 2],
            events=(Event(name, time_s, actuator),),
            compared=("unaware",),
        )


def _of_robot(first: Case, index: int, seed: int) -> Case:
    return replace(first, draw=index, plant_seed=seed, seed=seed, plane_seed=seed)
