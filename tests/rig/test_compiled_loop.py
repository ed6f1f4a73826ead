"""A flight in compiled code is the flight step by step, bit for bit, wherever it ends."""

from dataclasses import fields, replace

import numpy as np
import pytest

from experiments.goals.control import PseudoInverseMapping
from experiments.rig import Rig
from experiments.rig.hexapod import compiled_loop
from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.controller import StrutMapping, controller_for
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.mismatch import Mismatch
from experiments.rig.run import Run
from ftc.goal import Goal
from sim import NOMINAL, Failure, hexapod

TICKS = 60


class StepByStep:
    """A controller that the compiled code does not know."""

    def __init__(self, pilot):
        self.start, self.step = pilot.start, pilot.step


@pytest.fixture
def compiled_ticks() -> list[int]:
    """How many ticks of each run were compiled."""
    return []


@pytest.fixture
def rig(compiled_ticks) -> Rig:
    def counted(*given):
        run = compiled_loop.begun(*given)
        compiled_ticks.append(0 if run is None else len(run.inputs))
        return run

    return replace(hexapod_rig(), fast_start=counted)


def assert_same(one: Run, other: Run) -> None:
    for name in ("true", "measured", "inputs", "displacement", "qpos", "closure_m", "saturated"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.estimated, other.estimated)
    assert type(one.state.pose) is type(other.state.pose)
    for field in fields(one.state):
        if field.name not in ("pose", "bumpless_transfer"):
            a, b = (getattr(run.state, field.name) for run in (one, other))
            np.testing.assert_equal(a, b)


def both_ways(rig, pilot, **flight):
    path = rig.path("circle", duration_s=TICKS * rig.period_s)
    return rig.fly(pilot, path, **flight), rig.fly(StepByStep(pilot), path, **flight)


@pytest.mark.parametrize("jacobian", ["analytic", "constant"])
@pytest.mark.parametrize("column", COLUMNS, ids=lambda column: column.name)
def test_the_columns_of_table_1_are_the_same_flights_in_compiled_code(
    rig, column, jacobian, compiled_ticks
):
    ahead = column.name == "W_b"
    pilot = controller_for(rig.control.testbed, column.goal, jacobian=jacobian, feedforward=ahead)
    assert_same(*both_ways(rig, pilot, failures=column.failures, lead_in_s=0.01, seed=3))
    assert compiled_ticks == [TICKS + 10, 0]


def test_what_happens_to_the_plant_happens_in_compiled_code(rig, compiled_ticks):
    sizes = Mismatch(gain=0.03, delay_ticks=1, floor_um_per_s=12.5, hysteresis=0.01)
    rig = rig.drawn(replace(sizes, drift_urad_per_s=100.0), 1)
    pilot = controller_for(rig.control.testbed, COLUMNS[0].goal)
    struck = [Failure(2, "locked", 0.02), Failure(4, "free", 0.03)]
    assert_same(*both_ways(rig, pilot, failures=struck))
    assert compiled_ticks == [TICKS, 0]


@pytest.mark.parametrize("last", [0, 1, 31])
def test_where_the_compiled_code_ends_the_flight_goes_on_step_by_step(
    rig, last, compiled_ticks, monkeypatch
):
    code, told = compiled_loop.lib, []

    class Doubtful:
        STRUT_ROOM = code.STRUT_ROOM

        @staticmethod
        def strut_tick(task, k, *loops):
            return k < last and code.strut_tick(task, k, *loops)

    monkeypatch.setattr(compiled_loop, "lib", Doubtful)
    pilot = controller_for(rig.control.testbed, COLUMNS[4].goal)
    struck = [Failure(1, "free", last * rig.period_s)]
    assert_same(*both_ways(rig, pilot, failures=struck, on_tick=told.append))
    assert told == [*range(1, TICKS + 1)] * 2
    assert compiled_ticks == [last, 0]


class Seen:
    """Who looks at what the sensors read."""

    def measured(self, tick, reading):
        """The same."""
        return reading


@pytest.mark.parametrize(
    ("goal", "how", "events"),
    [
        (Goal((1.0,) * 6), {"form": "incremental"}, None),
        (Goal((1.0,) * 6, locked_at={0: 1e-6}), {}, None),
        (Goal((1.0,) * 6, effectiveness={0: 0.5}), {}, None),
        (Goal((1.0,) * 6), {}, Seen()),
    ],
    ids=["incremental", "off centre", "weak", "readings changed"],
)
def test_what_the_compiled_code_does_not_know_goes_step_by_step(
    rig, goal, how, events, compiled_ticks
):
    pilot = controller_for(rig.control.testbed, goal, **how)
    assert_same(*both_ways(rig, pilot, events=events))
    assert compiled_ticks == [0, 0]


def test_a_mapping_of_another_optimality_is_obeyed_and_not_the_compiled_one(model):
    """A weighted pseudo-inverse that hardly weighs pointing hardly points."""
    goal, demand = Goal(joint_weight=(1.0, 2.0, 3.0, 1.0, 1.0, 1.0)), np.array([1e-5, 2e-5])
    pose = NOMINAL.moved(np.full(6, 1e-5))
    strict = StrutMapping(hexapod(model), goal, "analytic")
    other = PseudoInverseMapping(hexapod(model), goal, "analytic", major_weight=1e-3)
    expected = other.at(hexapod(model).inverse_jacobian(pose)).mapping(demand)
    np.testing.assert_allclose(other.displacements(demand, pose), expected, rtol=1e-9)
    assert np.abs(expected).max() < 1e-3 * np.abs(strict.displacements(demand, pose)).max()
