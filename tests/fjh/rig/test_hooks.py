"""Events and hooks of a flight: when they begin, what they are drawn from, what they may do."""

from typing import Any

import numpy as np
import pytest

from fjh.rig.events import Event
from fjh.rig.events.hooks import events_of
from sim.plant import Reading
from tests.fjh.blind import blind_flight
from tests.fjh.rigs import path_of, rig


def test_times_count_from_the_first_tick_of_the_path():
    one, reading = rig("hexapod"), Reading(np.ones(2), np.ones(6))
    for time_s, first in ((5.03, 70), (5.0301, 71), (5.0, 0), (3.0, 0)):
        hook: Any = events_of(one, [Event("silent", time_s)], begin_s=5.0, lead_in_s=0.04)[0]
        read = [hook.measured(tick, reading).output[0] for tick in range(80)]
        assert np.flatnonzero(np.array(read) == 0.0)[0] == first


def test_what_is_drawn_is_of_the_seed_and_of_no_other_event():
    one, push, hum = rig("hexapod"), Event("push", 0.03), Event("hum", 0.03)
    cases = [(None, 0), ([push], 0), ([hum, push], 0), ([push, push], 0), ([push], 1)]
    none, alone, both, twice, other = (
        blind_flight(one, events, ticks=60, seed=seed) for events, seed in cases
    )
    np.testing.assert_array_equal(alone.qpos, both.qpos)
    assert not np.array_equal(alone.qpos, other.qpos)
    first, two = (run.true[-1] - none.true[-1] for run in (alone, twice))
    # The second push has its own direction.
    assert np.linalg.norm(two - 2 * first) > 0.1 * np.linalg.norm(two)


class Hook:
    """Pushes the payload from 100 ms on, and reads with an offset."""

    def __init__(self) -> None:
        self.ticks: list[int] = []

    def plant(self, tick: int, model: Any, data: Any) -> None:
        """At the end of the tick before."""
        self.ticks.append(tick)
        data.xfrc_applied[-1, 2] = 0.5 if tick >= 100 else 0.0

    def measured(self, tick: int, reading: Any) -> Any:
        """By a micrometre or microradian."""
        return reading._replace(output=reading.output + 1e-6)


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_a_hook_does_to_the_machine_what_it_is_asked_to(name):
    one, path = rig(name), np.zeros((200, 2))
    events, pilot = Hook(), one.controller()
    run, quiet = one.fly(pilot, path, events=events), one.fly(pilot, path)
    assert events.ticks == list(range(200))
    np.testing.assert_allclose(run.measured[0] - quiet.measured[0], 1e-6, atol=1e-15)
    before, during = np.abs(run.task - quiet.task)[90], np.abs(run.task - quiet.task)[150]
    assert np.linalg.norm(during[3:]) > 3.0 * np.linalg.norm(before[3:])


@pytest.mark.parametrize("name", ["hexapod", "arm"])
def test_inputs_changed_in_place_are_no_memory_of_the_pilot(name):
    class InPlace:
        def sent(self, tick: int, inputs: np.ndarray) -> np.ndarray:
            inputs *= 1.01
            return inputs

    class Anew:
        def sent(self, tick: int, inputs: np.ndarray) -> np.ndarray:
            return 1.01 * inputs

    one, path = rig(name), path_of(name, 0.1)
    runs = [one.fly(one.controller(), path, events=events()) for events in (InPlace, Anew)]
    np.testing.assert_array_equal(runs[0].inputs, runs[1].inputs)
