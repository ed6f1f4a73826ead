"""Flights in which anything happens, not only what the diagnosis has a hypothesis for."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from experiments.recover.course import SPIRAL, Course
from experiments.recover.flight import Flight
from experiments.rig.events import EVENTS, Event
from experiments.rig.hexapod.testbed import TestbedConfig

AFTER_S = 3.0
"""Of a flight, from its event on."""

EARLY_S, LATER_S = (0.2, 0.8), (0.9, 6.0)
"""When an event happens, from the first tick: while the diagnosis learns, or thereafter."""

COURSES = 6
"""Of each draw in turn: the spiral, three times, twice at another speed and radius; a circle; steps
that are held; rest."""

_EARLY = (2, 9)
"""Draws, of every twelve, in which the diagnosis is still learning."""

_TURN_S, _RADIUS, _STEPS = (1.0, 4.0), (0.5, 2.0), Course("steps", 4.0, 0.5)
_STANDING_M = 10e-6
_STREAM, _SOUND_STREAM = 6, 7
"""Of random numbers; those of other flights have smaller ones."""


@dataclass(frozen=True)
class EventCounts:
    """Which flights there are.

    Attributes:
        names: Of the events.
        each: Flights of each of them.
        sound_s: How long the one flight without any lasts.
    """

    names: tuple[str, ...]
    each: int
    sound_s: float


WHOLE = EventCounts(tuple(EVENTS), 12, 3600.0)
QUICK = EventCounts(("locked", "hard_over", "sag", "bias"), 1, 2.0)


class EventPlan:
    """Flights 0, 1, ...; each is a pure function of counts, seed and number.

    Flights of one draw have the same plant, course, posture, time and noise, whatever happens: what
    an event costs is not the luck of the draw. The first flight is the one without events, which
    takes longest.
    """

    def __init__(self, counts: EventCounts, seed: int) -> None:
        """Take what is flown, and the seed of all that is drawn."""
        self.counts, self.seed = counts, seed

    def __len__(self) -> int:
        return 1 + len(self.counts.names) * self.counts.each

    def __getitem__(self, number: int) -> Flight:
        if not number:
            return self._sound()
        place, draw = divmod(number - 1, self.counts.each)
        return replace(drawn(self.counts.names[place], self.seed, draw), number=number)

    def as_json(self) -> dict[str, Any]:
        """What the flights are drawn from, beside the seed."""
        return asdict(self.counts)

    def _sound(self) -> Flight:
        """Without events, around a circle."""
        rng = np.random.default_rng([self.seed, _SOUND_STREAM])
        seeds = rng.integers(2**32, size=2).tolist()
        flight = Flight(
            number=0,
            sort="sound",
            draw=0,
            mismatch="all",
            factor=1.0,
            plant_seed=seeds[0],
            failures=(),
            begin_s=0.0,
            duration_s=self.counts.sound_s,
            posture_m=tuple(rng.normal(scale=_STANDING_M, size=6).tolist()),
            seed=seeds[1],
        )
        return replace(flight, course=Course("circle"))


def drawn(name: str, seed: int, draw: int) -> Flight:
    """The flight of an event in a draw.

    All courses are flown with plants of the diagnosis' own family of errors, then with plants of
    another one; struts take turns.
    """
    rng = np.random.default_rng([seed, _STREAM, draw])
    posture = rng.normal(scale=_STANDING_M, size=6).tolist()
    seeds = rng.integers(2**32, size=2).tolist()
    early = draw % (2 * COURSES) in _EARLY
    after_s = round(float(np.exp(rng.uniform(*np.log(EARLY_S if early else LATER_S)))), 3)
    course = _course(rng, draw % COURSES)
    latest_s = TestbedConfig().duration_s - after_s - AFTER_S
    begin_s = 0.0 if early else round(float(rng.uniform(0, latest_s)), 3)
    turns = draw // COURSES
    strut = (draw + turns) % 6 if EVENTS[name].of == "actuator" else None
    return Flight(
        number=draw,
        sort="event",
        draw=draw,
        mismatch="other family" if turns % 2 else "all",
        factor=1.0,
        plant_seed=seeds[0],
        failures=(),
        begin_s=begin_s,
        duration_s=round(after_s + AFTER_S, 3),
        posture_m=tuple(posture),
        seed=seeds[1],
        events=(Event(name, round(begin_s + after_s, 3), strut),),
        course=course,
    )


def _course(rng: np.random.Generator, place: int) -> Course:
    turn_s, radius = np.exp(rng.uniform(*np.log([_TURN_S, _RADIUS]).T)).tolist()
    spiral = Course("spiral", turn_s, radius)
    return (SPIRAL, spiral, spiral, Course("circle", turn_s, radius), _STEPS, Course("rest"))[place]
