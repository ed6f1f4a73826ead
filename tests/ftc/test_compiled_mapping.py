"""A tick of the mapping in one compiled call is the mapping by its objects, on five robots."""

from collections.abc import Callable
from copy import copy
from functools import cache
from typing import Any

import numpy as np
import pytest

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.controller import StrutMapping
from fjh.rig.hexapod.fault_tolerance import strut_and_payload_stiffness
from ftc import Goal, PrioritizedMapping, mapping_for
from ftc.control import PreviousCommand
from sim import MODELS, NOMINAL, Mechanism, load_model

ROBOTS = {"arm": (3, 4, 5), "hand": (3, 4), "arms": (3, 4, 5), "platform": (3, 4)}
"""Bundled ones and their major rows, beside the hexapod."""


@cache
def mechanism(name: str) -> Mechanism:
    return Mechanism(load_model(MODELS / f"{name}.xml"), site="payload")


def by_objects(mapping: PrioritizedMapping[Any]) -> PrioritizedMapping[Any]:
    """The same mapping without compiled ticks."""
    other = copy(mapping)
    vars(other).update(_ticks=[None, None])
    return other


def goal_of(rng: np.random.Generator, n: int, rows: int, *, fails: bool) -> Goal:
    """Random weights, and perhaps an actuator that stands, off centre or not."""
    secondary = tuple(rng.uniform(0.5, 2.0, rows)) if rng.random() < 0.5 else None
    standing = {int(rng.integers(n)): float(rng.choice([0.0, 1e-4]))} if fails else {}
    return Goal(tuple(rng.uniform(0.5, 2.0, n)), secondary, locked_at=standing)


Ticks = tuple[PrioritizedMapping[Any], Callable[[], tuple[Any, ...]]]
"""A mapping, and random arguments of its tick."""


def robot_ticks(name: str, rng: np.random.Generator) -> Ticks:
    """Of a bundled robot."""
    model, major = mechanism(name), ROBOTS[name]
    n = len(model.nominal.displacements)
    goal = goal_of(rng, n, 6 - len(major), fails=name != "hand" and rng.random() < 0.5)
    sides = rng.uniform(2e-3, 2e-2, (2, n))
    limits = (-sides[0], sides[1]) if rng.random() < 0.6 else None
    mapping = mapping_for(model, goal, major, limits)

    def tick() -> tuple[Any, ...]:
        commanded = 5e-3 * rng.normal(size=n)
        pose = mapping.estimate(commanded, mapping.nominal)
        reference = 1e-3 * rng.normal(size=n) if rng.random() < 0.5 else None
        return 1e-3 * rng.normal(size=len(major)), pose, commanded, None, reference

    return mapping, tick


def hexapod_ticks(rng: np.random.Generator) -> Ticks:
    """Of the hexapod, in all forms, with limits or not."""
    model = load_model()
    form = str(rng.choice(["absolute", "incremental", "gauss_newton"]))
    goal = goal_of(rng, 6, 4, fails=form != "incremental" and rng.random() < 0.5)
    limits = None if form == "incremental" or rng.random() < 0.4 else (np.full(6, -3e-5), 3e-5)
    jacobian = str(rng.choice(["constant", "analytic"]))
    how: Any = {"form": form, "limits": limits, "stiffness": strut_and_payload_stiffness(model)}
    mapping = StrutMapping(hexapod(model), goal, jacobian, **how)  # pyright: ignore[reportArgumentType]

    def tick() -> tuple[Any, ...]:
        pose, demand = NOMINAL.moved(1e-4 * rng.normal(size=6)), 1e-4 * rng.normal(size=2)
        commanded, before = 1e-5 * rng.normal(size=(2, 6))
        last = PreviousCommand(1e-4 * rng.normal(size=2), before, 1e-6 * rng.normal(size=6))
        reference = 1e-5 * rng.normal(size=6) if rng.random() < 0.5 else None
        return demand, pose, commanded, last, reference

    return mapping, tick


def compared(name: str, mappings: int, ticks: int) -> None:
    """So many random ticks of so many random mappings of a robot."""
    rng, compiled = np.random.default_rng(0), 0
    for _ in range(mappings):
        mapping, draw = hexapod_ticks(rng) if name == "hexapod" else robot_ticks(name, rng)
        for _ in range(ticks):
            demand, pose, *rest = draw()
            found, lacking = mapping.tick(demand, pose, *rest)
            expected, known = by_objects(mapping).tick(demand, pose, *rest)
            size = np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * size)
            assert (lacking is None) == (known is None)
            if lacking is not None and known is not None:
                np.testing.assert_allclose(lacking, known, atol=1e-9 * np.abs(demand).max())
        compiled += mapping._ticks[mapping.limits is not None] is not None
    assert compiled == mappings


@pytest.mark.parametrize("name", ["hexapod", *ROBOTS])
def test_a_compiled_tick_displaces_the_actuators_as_the_objects_do(name):
    compared(name, mappings=6, ticks=10)


@pytest.mark.long
@pytest.mark.parametrize("name", ["hexapod", *ROBOTS])
def test_ten_thousand_compiled_ticks_of_five_robots_are_those_of_the_objects(name):
    compared(name, mappings=40, ticks=50)


def test_a_tick_without_limits_is_what_the_displacements_are():
    mapping = mapping_for(mechanism("arm"), Goal((1.0,) * 7), ROBOTS["arm"])
    demand, still = np.array([1e-3, 0.0, 2e-3]), np.zeros(7)
    found, lacking = mapping.tick(demand, mapping.nominal, still)
    np.testing.assert_array_equal(found, mapping.displacements(demand, mapping.nominal, still))
    assert lacking is None


def test_limits_that_hold_the_task_back_leave_what_the_achieved_task_lacks():
    """By the Jacobian of the posture: what is not reached is demanded less J times what moves."""
    model, n, rows = mechanism("arm"), 7, list(ROBOTS["arm"])
    limits = np.full(n, -1e-4), np.full(n, 1e-4)
    mapping = mapping_for(model, Goal((1.0,) * n), rows, limits)
    demand = np.array([1e-2, 0.0, 0.0])
    found, lacking = mapping.tick(demand, mapping.nominal, np.zeros(n))
    J = model.jacobians(mapping.nominal).J_T[rows]
    assert lacking is not None
    np.testing.assert_allclose(lacking, demand - J @ found, atol=1e-15)
    assert (np.abs(found) <= 1e-4).all() and np.abs(lacking).max() > 1e-3


def test_next_to_a_singularity_the_objects_decide():
    """A strut parallel to all others: the payload may shift, and no rank of it is clear."""
    machine = hexapod(load_model())
    parallel = type(machine)(machine.top_m - [0.0, 0.0, 1.0], machine.top_m)
    mapping = StrutMapping(machine, Goal((1.0,) * 6), "analytic")
    pose = parallel.posture(NOMINAL)
    step = mapping._step(np.zeros(2), pose, None, None, None)
    assert mapping._moved(mapping._ticks[0], pose, step, None) is None
