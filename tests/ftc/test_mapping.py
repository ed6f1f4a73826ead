"""Mapping from a major task to the actuators: limits, compiled ticks, gains."""

from collections.abc import Callable
from copy import copy
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.controller import StrutMapping
from fjh.rig.hexapod.fault_tolerance import strut_and_payload_stiffness
from ftc import Goal, LocalGeometry, PrioritizedMapping, mapping_for
from ftc.control import PreviousCommand
from prioritized import ConstrainedSystem
from sim import MODELS, NOMINAL, Mechanism, load_model
from tests.ftc.serial import MAJOR, SECONDARY, limited, serial
from tests.profiles import examples

SEEDS = st.integers(0, 2**32 - 1)


@examples(40)
@given(SEEDS, st.sampled_from([{}, {1: 0.2}, {0: -0.3, 3: 0.1}]))
def test_the_achieved_task_is_the_nearest_within_the_limits(seed, locked_at):
    """A bounded solver finds the same error for any secondary reference, with locks or not."""
    own, rng = serial(seed), np.random.default_rng(seed + 1)
    demand, secondary = rng.normal(size=2), rng.choice([0.0, 10.0]) * rng.normal(size=5)
    mapping = limited(own, goal=Goal(joint_weight=(1.0,) * 5, locked_at=locked_at))
    result_m, residual = mapping.tick(demand, own.nominal, secondary_reference=secondary)
    assert np.abs(result_m).max() <= 0.5
    assert not result_m[list(locked_at)].any()
    all_m = result_m.copy()
    all_m[list(locked_at)] = list(locked_at.values())
    achieved = mapping.major_motion(all_m, own.nominal)
    assert residual is not None
    np.testing.assert_allclose(residual, demand - achieved, atol=1e-9)
    J = own.system.J_T[MAJOR]
    offset = J[:, list(locked_at)] @ list(locked_at.values())
    J_m = np.delete(J, list(locked_at), axis=1)
    best = lsq_linear(J_m, demand - offset, (-0.5, 0.5), method="bvls", tol=1e-14)
    assert np.linalg.norm(residual) == pytest.approx(np.sqrt(2 * best.cost), abs=1e-7)


@given(SEEDS)
def test_inactive_limits_change_nothing(seed):
    """Limits may be infinite for some joints, since many arms have continuous joints."""
    own, rng = serial(seed), np.random.default_rng(seed + 1)
    demand, reference_m = 0.1 * rng.normal(size=2), 0.1 * rng.normal(size=5)
    unlimited = limited(own, None)
    free = unlimited.displacements(demand, own.nominal, secondary_reference=reference_m)
    result, residual = unlimited.tick(demand, own.nominal, secondary_reference=reference_m)
    np.testing.assert_array_equal(result, free)
    assert residual is None
    wide = np.where(np.arange(5) % 2, np.inf, 2 * np.abs(free).max())
    box = (-wide, wide)
    mapping = PrioritizedMapping(own, Goal((1.0,) * 5), MAJOR, SECONDARY, limits=box)
    result, residual = mapping.tick(demand, own.nominal, secondary_reference=reference_m)
    np.testing.assert_allclose(result, free, atol=1e-10)
    assert residual is not None and np.abs(residual).max() < 1e-10


@given(SEEDS)
def test_scaled_demands_keep_their_direction(seed):
    own, demand = serial(seed), 5 * np.random.default_rng(seed + 1).normal(size=2)
    _, residual = limited(own, when_limited="scaled").tick(demand, own.nominal)
    achieved = demand - residual
    assert abs(np.linalg.det([achieved, demand])) < 1e-8
    assert 0 <= achieved @ demand <= demand @ demand + 1e-9


@pytest.mark.parametrize(
    ("goal", "limits", "why"),
    [
        (Goal(), (np.zeros(5), np.ones(5)), "with limits"),
        (Goal(locked_at={1: 0.1}), None, "with an actuator locked off centre"),
    ],
)
def test_the_incremental_form_rejects_limits_and_locks_off_centre(goal, limits, why):
    with pytest.raises(ValueError, match=f'form must be "absolute" or "gauss_newton" {why}'):
        PrioritizedMapping(serial(0), goal, MAJOR, SECONDARY, limits=limits, form="incremental")


@given(SEEDS)
def test_around_a_lock_off_centre_the_others_close_the_loops_and_do_the_task(seed):
    rng = np.random.default_rng(seed)
    J, C, demand = rng.normal(size=(3, 6)), rng.normal(size=(1, 6)), rng.normal(size=2)
    own = LocalGeometry(ConstrainedSystem(J, C, range(6)))
    mapping = PrioritizedMapping(own, Goal((1.0,) * 6, locked_at={1: 0.2}), [0, 1], [2])
    moved = mapping.displacements(demand, mapping.nominal)
    moved[1] = 0.2
    np.testing.assert_allclose(C @ moved, 0.0, atol=1e-9)
    np.testing.assert_allclose(J[:2] @ moved, demand, atol=1e-9)


ROBOTS = {"arm": (3, 4, 5), "hand": (3, 4), "arms": (3, 4, 5), "platform": (3, 4)}
"""Bundled robots and their major rows, in addition to the hexapod."""


@cache
def mechanism(name: str) -> Mechanism:
    return Mechanism(load_model(MODELS / f"{name}.xml"), site="payload")


def by_objects(mapping: PrioritizedMapping[Any]) -> PrioritizedMapping[Any]:
    """Return a copy of the mapping without compiled ticks."""
    other = copy(mapping)
    vars(other).update(_ticks=[None, None])
    return other


def goal_of(rng: np.random.Generator, n: int, rows: int, *, fails: bool) -> Goal:
    """Sample a goal with random weights and, with `fails`, a locked actuator."""
    secondary = tuple(rng.uniform(0.5, 2.0, rows)) if rng.random() < 0.5 else None
    locked = {int(rng.integers(n)): float(rng.choice([0.0, 1e-4]))} if fails else {}
    return Goal(tuple(rng.uniform(0.5, 2.0, n)), secondary, locked_at=locked)


Ticks = tuple[PrioritizedMapping[Any], Callable[[], tuple[Any, ...]]]
"""Mapping and a function that samples arguments of its tick."""


def robot_ticks(name: str, rng: np.random.Generator) -> Ticks:
    """Return the mapping of a bundled robot and a sampler of ticks."""
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
    """Return a mapping of the hexapod in a random form and a sampler of ticks."""
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


@pytest.mark.parametrize(
    ("mappings", "ticks"), [(6, 10), pytest.param(40, 50, marks=pytest.mark.long)]
)
@pytest.mark.parametrize("name", ["hexapod", *ROBOTS])
def test_a_compiled_tick_equals_the_tick_by_objects(name, mappings, ticks):
    rng, compiled = np.random.default_rng(0), 0
    for _ in range(mappings):
        mapping, sample_tick = hexapod_ticks(rng) if name == "hexapod" else robot_ticks(name, rng)
        for _ in range(ticks):
            demand, pose, *others = sample_tick()
            result, residual = mapping.tick(demand, pose, *others)
            expected, known = by_objects(mapping).tick(demand, pose, *others)
            size = np.abs(expected).max()
            np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9 * size)
            assert (residual is None) == (known is None)
            if residual is not None and known is not None:
                np.testing.assert_allclose(residual, known, atol=1e-9 * np.abs(demand).max())
        compiled += mapping._ticks[mapping.limits is not None] is not None
    assert compiled == mappings


@pytest.mark.parametrize("weights", [{"joint": 1.0}, {"secondary": 1.0}, {"joint": 1.0, "off": 2}])
def test_the_secondary_gain_is_the_effect_of_a_reference(weights):
    """A small reference at the nominal pose moves the commands by the gain, but not the task."""
    goal = Goal(
        joint_weight=(weights["joint"],) * 7 if "joint" in weights else None,
        secondary_weight=(1.0,) * 4 if "secondary" in weights else None,
        locked_at={weights["off"]: 0.0} if "off" in weights else {},
    )
    mapping = mapping_for(mechanism("arm"), goal, (0, 1))
    gain, still = mapping.secondary_gain(), np.zeros(2)
    system = ConstrainedSystem.of(mechanism("arm").jacobians(mapping.nominal))
    assert np.linalg.matrix_rank(gain, 1e-9) == 5 - ("off" in weights) - ("secondary" in weights)
    np.testing.assert_allclose(system.kinematics().J[[0, 1]] @ gain, 0.0, atol=1e-12)
    for reference in 1e-3 * np.eye(7):
        moved = mapping.displacements(still, mapping.nominal, np.zeros(7), None, reference)
        np.testing.assert_allclose(moved, gain @ reference, atol=1e-12)
