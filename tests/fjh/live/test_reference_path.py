"""Periodic paths start at rest, repeat, and change without a jump."""

from functools import cache

import numpy as np
import pytest

from fjh.live.reference_path import PATHS, REST, ReferencePath, reference_path
from tests.fjh.rigs import shared_rig

SETTLED_S = 1.0
"""Time [s] after which earlier demands have no more effect."""
of_each_robot = pytest.mark.parametrize("name", ["hexapod", "arm"])


@cache
def path_of(name: str, path: str) -> ReferencePath:
    return reference_path(shared_rig(name), path)


@pytest.mark.parametrize("path", PATHS)
@of_each_robot
def test_repeated_cycle_continues_the_path(name, path):
    """Desired and demanded displacements of the former cycle continue without a seam."""
    rig, its = shared_rig(name), path_of(name, path)
    start, settled = len(its.desired) - its.cycle, round(SETTLED_S / rig.period_s)
    before, before_demands = its.at(np.arange(max(0, start - its.cycle), start))
    desired, demands = its.at(start + its.cycle - len(before) + np.arange(len(before)))
    compared = slice(settled, None)
    np.testing.assert_allclose(before[compared], desired[compared], atol=1e-9 * rig.size)
    if demands is not None and before_demands is not None:
        np.testing.assert_allclose(
            before_demands[compared], demands[compared], atol=2e-3 * rig.size
        )


@of_each_robot
@pytest.mark.parametrize(("path", "duration_s"), [("circle", 3.0), ("spiral", 8.0)])
def test_the_first_ticks_are_those_of_the_rig_of_that_path(name, path, duration_s):
    rig, its = shared_rig(name), path_of(name, path)
    expected = rig.path(path, duration_s=duration_s)
    np.testing.assert_allclose(its.desired[: len(expected)], expected, atol=1e-12 * rig.size)


def largest_step(desired: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(desired, axis=0), axis=1).max(initial=0.0))


@pytest.mark.parametrize("former", ["circle", "spiral", REST])
@pytest.mark.parametrize("path", ["circle", "spiral", REST])
@of_each_robot
def test_a_change_of_path_has_no_jump(name, path, former):
    """The largest step is that of both paths and of a fade over 2 radii in 1 s, 15/8 of a ramp."""
    rig, was = shared_rig(name), path_of(name, former)
    at = 3 + len(was.desired) + round(0.4 * was.cycle)
    now = reference_path(rig, path, was, at)
    before, _ = was.at(at + np.arange(-3, 0))
    after, _ = now.at(np.arange(2 * len(now.desired)))
    fastest = largest_step(path_of(name, path).desired) + largest_step(was.desired)
    motion = largest_step(np.concatenate([before, after]))
    assert motion <= fastest + 15 / 8 * 2 * rig.size * rig.period_s
    np.testing.assert_allclose(after[0], was.at(at + np.arange(1))[0][0], atol=1e-12 * rig.size)
    np.testing.assert_array_equal(
        now.desired[-now.cycle :], path_of(name, path).desired[-now.cycle :]
    )


def test_the_path_rests_before_a_change_to_steps():
    """Steps are jumps by definition; before the first one the fade is smooth."""
    rig, was = shared_rig("hexapod"), path_of("hexapod", "circle")
    now = reference_path(rig, "steps", was, 2500)
    switch = round(1.0 / rig.period_s)
    assert largest_step(now.desired[:switch]) < 0.02 * rig.size
    np.testing.assert_allclose(now.desired[switch], 0.0, atol=1e-9 * rig.size)
    assert largest_step(now.desired) == pytest.approx(rig.size)
