"""Paths without an end: they begin at rest, repeat, and change without a jump."""

from functools import cache

import numpy as np
import pytest

from fjh.live.course import COURSES, REST, Course, course
from fjh.rig import Rig
from sim import HEXAPOD_MJCF

NAMES = ("hexapod", "arm")
MOVING = [name for name in COURSES if name != REST]
SETTLED_S = 1.0
"""After which what was demanded before a path began no longer shows."""


@cache
def rig(name: str) -> Rig:
    if name == "hexapod":
        return Rig.hexapod()
    return Rig.of_mjcf(HEXAPOD_MJCF.with_name(f"{name}.xml"), major=[3, 4, 5])


@cache
def of(name: str, path: str) -> Course:
    return course(rig(name), path)


@pytest.mark.parametrize("path", COURSES)
@pytest.mark.parametrize("name", NAMES)
def test_a_course_begins_at_rest_and_repeats_with_its_cycle(name, path):
    its = of(name, path)
    start = len(its.desired) - its.cycle
    first, _ = its.at(np.arange(1))
    np.testing.assert_array_equal(first, 0.0)
    ticks = start + np.arange(2 * its.cycle)
    desired, demands = its.at(ticks)
    np.testing.assert_array_equal(desired[: its.cycle], desired[its.cycle :])
    if demands is not None:
        np.testing.assert_array_equal(demands[: its.cycle], demands[its.cycle :])
    assert desired.any() == (path != REST)


@pytest.mark.parametrize("path", COURSES)
@pytest.mark.parametrize("name", NAMES)
def test_what_repeats_is_what_a_longer_path_would_have_gone_on_with(name, path):
    """The cycle before the one that is kept: no seam shows, in what is desired or demanded."""
    one, its = rig(name), of(name, path)
    start, settled = len(its.desired) - its.cycle, round(SETTLED_S / one.period_s)
    before, before_demands = its.at(np.arange(max(0, start - its.cycle), start))
    desired, demands = its.at(start + its.cycle - len(before) + np.arange(len(before)))
    kept = slice(settled, None)
    np.testing.assert_allclose(before[kept], desired[kept], atol=1e-9 * one.size)
    if demands is not None and before_demands is not None:
        np.testing.assert_allclose(before_demands[kept], demands[kept], atol=2e-3 * one.size)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("path", ["circle", "spiral"])
def test_the_first_ticks_are_those_of_the_rig_of_that_path(name, path):
    one, its = rig(name), of(name, path)
    duration_s = {"circle": 3.0, "spiral": 8.0}[path]
    expected = one.path(path, duration_s=duration_s)
    np.testing.assert_allclose(its.desired[: len(expected)], expected, atol=1e-12 * one.size)


@pytest.mark.parametrize("path", MOVING)
def test_the_demands_of_the_arm_are_those_of_a_path_that_is_known_beforehand(path):
    """Half a second before its end they are the same whatever follows, to a thousandth."""
    one, its = rig("arm"), of("arm", path)
    ticks = len(its.desired)
    demands = one.feedforward_demands(its.desired)
    assert demands is not None and its.demands is not None
    kept = ticks - round(SETTLED_S / one.period_s)
    np.testing.assert_allclose(its.demands[:kept], demands[:kept], atol=1e-3 * one.size)


@pytest.mark.parametrize("path", COURSES)
def test_the_hexapod_of_the_paper_is_demanded_nothing_beforehand(path):
    its = of("hexapod", path)
    assert its.demands is None and its.at(np.arange(3))[1] is None


@pytest.mark.parametrize("former", ["circle", "spiral", REST])
@pytest.mark.parametrize("path", ["circle", "spiral", REST])
@pytest.mark.parametrize("name", NAMES)
def test_a_change_of_path_has_no_jump(name, path, former):
    """No tick moves farther than the fastest of both paths, and what the fade of 1 s adds.

    The former path goes back by 2 radii at the most; the fade is at most 15/8 as fast as a ramp.
    """
    one, was = rig(name), of(name, former)
    at = 3 + len(was.desired) + round(0.4 * was.cycle)
    now = course(one, path, was, at)
    before, _ = was.at(at + np.arange(-3, 0))
    after, _ = now.at(np.arange(2 * len(now.desired)))
    motion = largest_step(np.concatenate([before, after]))
    fastest = largest_step(of(name, path).desired) + largest_step(was.desired)
    assert motion <= fastest + 15 / 8 * 2 * one.size * one.period_s
    np.testing.assert_allclose(after[0], was.at(at + np.arange(1))[0][0], atol=1e-12 * one.size)
    start = len(now.desired) - now.cycle
    expected = of(name, path)
    np.testing.assert_allclose(now.desired[start:], expected.desired[-now.cycle :], atol=0)


def largest_step(desired: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(desired, axis=0), axis=1).max(initial=0.0))


def test_a_change_to_steps_goes_to_rest_first():
    """Steps are jumps of their own; until the first of them the fade is smooth."""
    one, was = rig("hexapod"), of("hexapod", "circle")
    now = course(one, "steps", was, 2500)
    switch = round(1.0 / one.period_s)
    assert largest_step(now.desired[:switch]) < 0.02 * one.size
    np.testing.assert_allclose(now.desired[switch], 0.0, atol=1e-9 * one.size)
    assert largest_step(now.desired) == pytest.approx(one.size)
