"""Test the box of viable rates: from inside limits can be satisfied forever, from outside not."""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from argument_checks.ties import exceeds
from kernels import lib
from prioritized import viable_rates
from prioritized._analysis.viable import RateBox
from tests.profiles import scaled
from tests.random_systems import SEEDS

EPS, INF = np.finfo(float).eps, np.inf
LONG = pytest.mark.long

EXTREMES = [x + y for x in (-np.inf, -3.0, 0.0, 1e-12, 3.0, np.inf) for y in (0.0, 1e-12, 1e-8)]


class Joints(NamedTuple):
    """Limits of joints, arrays of one shape or numbers, and a period."""

    x_min: np.ndarray | float
    x_max: np.ndarray | float
    v_min: np.ndarray | float
    v_max: np.ndarray | float
    a_min: np.ndarray | float
    a_max: np.ndarray | float
    T: float

    def box(self, x, v) -> RateBox:
        """Return the box of joints at x with rates v."""
        return viable_rates(
            x,
            v,
            position_limits=(self.x_min, self.x_max),
            rate_limits=(self.v_min, self.v_max),
            acceleration_limits=(self.a_min, self.a_max),
            period_s=self.T,
        )

    def beyond(self, x):
        """Return the violation of position limits, relative to the largest position allowed."""
        size = np.maximum(np.abs(self.x_min), np.abs(self.x_max))
        return np.maximum(self.x_min - x, x - self.x_max) / size


def any_joints(rng, n, T=None) -> Joints:
    """Sample limits over many decades; braking takes from one tick to thousands."""

    def size(low, high):
        return 10.0 ** rng.uniform(low, high, n)

    x_min = -size(-6, 3)
    limits = (x_min, x_min + size(-6, 3), -size(-4, 3), size(-4, 3), -size(-3, 4), size(-3, 4))
    return Joints(*limits, T=10.0 ** rng.uniform(-4, 0) if T is None else T)


def kernel(last, slow, fast, down, up):
    """Return the lattice states (i, j), 0 <= i <= last, slow <= j <= fast, that are viable.

    The next is (i + k, k), j - down <= k <= j + up; states without one are removed repeatedly.
    """
    rates = np.arange(slow, fast + 1)
    retained = np.ones((last + 1, len(rates)), dtype=bool)
    while True:
        # next_in[i, k]: True if rate k leads from position i to a state not yet removed
        next_in = np.zeros_like(retained)
        for column, k in enumerate(rates):
            i = np.arange(max(0, -k), min(last, last - k) + 1)
            next_in[i, column] = retained[i + k, column]
        near = (rates >= rates[:, None] - down) & (rates <= rates[:, None] + up)
        still = retained & (next_in @ near.T)
        if (still == retained).all():
            return retained
        retained = still


@pytest.mark.parametrize("seed", range(12))
def test_the_box_is_the_largest_by_dynamic_programming(seed):
    """Check that exactly the rates in the box lead to viable states, by braking on the lattice."""
    rng = np.random.default_rng(seed)
    last, slow, fast = int(rng.integers(0, 60)), -int(rng.integers(0, 12)), int(rng.integers(0, 12))
    down, up = int(rng.integers(1, 5)), int(rng.integers(1, 5))
    h, T, origin = rng.uniform(0.1, 3.0), rng.uniform(1e-3, 2.0), rng.normal()
    retained = kernel(last, slow, fast, down, up)
    i, j = np.mgrid[-8 : last + 9, slow - 9 : fast + 10]
    joints = Joints(
        *(origin, origin + last * h * T, slow * h, fast * h, -down * h / T, up * h / T), T=T
    )
    box = joints.box(origin + i * h * T, j * h)
    some = np.zeros(i.shape, dtype=bool)
    for k in range(slow, fast + 1):
        inside = (i + k >= 0) & (i + k <= last) & (k >= j - down) & (k <= j + up)
        allowed = inside & retained[np.where(inside, i + k, 0), k - slow]
        some |= allowed
        in_box = box.viable & (box.lower <= (k + 1e-9) * h) & (box.upper >= (k - 1e-9) * h)
        assert np.array_equal(in_box, allowed)
    on_lattice = (i >= 0) & (i <= last) & (j >= slow) & (j <= fast)
    assert np.array_equal(some[on_lattice], retained.ravel())
    assert np.array_equal(box.viable, some)


def extreme_rate(joints: Joints, x: float, v: float, sign: int, ticks: int) -> float | None:
    """Return the largest (sign 1) or smallest next rate of a future in which all limits hold."""
    total = joints.T * np.tri(ticks)
    step = (np.eye(ticks) - np.eye(ticks, k=-1)) / joints.T
    before = np.append(v / joints.T, np.zeros(ticks - 1))
    rows = np.vstack([total, -total, step, -step])
    bounds = np.concatenate(
        [
            np.full(ticks, joints.x_max - x),
            np.full(ticks, x - joints.x_min),
            joints.a_max + before,
            -joints.a_min - before,
        ]
    )
    cost = -sign * np.eye(ticks)[0]
    result = linprog(cost, rows, bounds, bounds=(joints.v_min, joints.v_max), method="highs")
    return None if result.status == 2 else float(result.x[0])


def test_the_ends_of_the_box_are_the_extreme_rates_of_any_future():
    """Compare with a linear program over 40 ticks, also if it is infeasible."""
    rng = np.random.default_rng(0)
    for _ in range(scaled(100)):
        joints = Joints(
            *(-rng.uniform(0, 2), rng.uniform(0, 2), -rng.uniform(0, 1), rng.uniform(0, 1)),
            *(-rng.uniform(0.05, 1), rng.uniform(0.05, 1)),
            T=1.0,
        )
        x, v = rng.uniform(-2.1, 2.1), rng.uniform(-1.2, 1.2)
        box = joints.box([x], [v])
        least, most = (extreme_rate(joints, x, v, sign, ticks=40) for sign in (-1, 1))
        assert (most is not None) == box.viable[0]
        if most is not None:
            assert (box.lower[0], box.upper[0]) == pytest.approx((least, most), abs=1e-6)


SIZES = st.floats(1e-9, 1e9)


@given(
    steps=st.fractions(0, 300),
    braking=SIZES,
    period=st.floats(1e-9, 1e3),
    sign=st.sampled_from([-1, 1]),
)
def test_the_fastest_rate_stops_exactly_at_the_limit_in_any_units(steps, braking, period, sign):
    """Check that braking from w, (w - a T), (w - 2 a T), ... to rest covers the distance."""
    a, T = Fraction(braking), Fraction(period)
    w, distance = steps * a * T, Fraction(0)
    for k in range(int(steps) + 1):
        distance += T * max(w - k * a * T, Fraction(0))
    inf = np.inf
    limits = sorted([sign * float(distance), -sign * inf])
    joints = Joints(limits[0], limits[1], -inf, inf, -braking, braking, period)
    box = joints.box([0.0], [sign * float(w)])
    assert box.viable[0]
    end = box.upper[0] if sign > 0 else -box.lower[0]
    assert end == pytest.approx(float(w), rel=1e-13, abs=0)


def walk(joints: Joints, x, v, ticks, rng):
    """Return positions, rates and boxes of joints that stay at one end of the box for a while."""
    fixed = rng.random(np.shape(x))
    for _ in range(ticks):
        box = joints.box(x, v)
        fixed = np.where(rng.random(np.shape(x)) < 0.02, rng.random(np.shape(x)), fixed)
        part = np.where(fixed < 0.4, 0.0, np.where(fixed < 0.8, 1.0, rng.random(np.shape(x))))
        w = np.clip(box.lower + part * (box.upper - box.lower), box.lower, box.upper)
        x, v, before = x + joints.T * w, w, v
        yield x, v, before, box


@pytest.mark.parametrize(
    ("seed", "ticks"), [(0, 500), *(pytest.param(k, 2000, marks=LONG) for k in range(3))]
)
def test_no_limit_is_ever_violated_by_rates_of_the_box(seed, ticks):
    """Check 1000 joints: positions to round-off, rates exactly, no empty box."""
    rng = np.random.default_rng(seed)
    joints = any_joints(rng, 1000)
    start = rng.uniform(joints.x_min, joints.x_max)
    for x, v, before, box in walk(joints, start, np.zeros(1000), ticks, rng):
        assert box.viable.all()
        assert (box.lower <= box.upper).all()
        assert (joints.beyond(x) <= 1e-12).all()
        assert ((v >= joints.v_min) & (v <= joints.v_max)).all()
        round_off = 4 * EPS * np.maximum(abs(v), abs(before))
        assert (v <= before + joints.T * joints.a_max + round_off).all()
        assert (v >= before + joints.T * joints.a_min - round_off).all()


@pytest.mark.parametrize("seed", range(3))
def test_limits_are_restored_from_any_state(seed):
    """Check any position and rate after a disturbance: accelerations hold, and no box is empty."""
    rng = np.random.default_rng(seed)
    joints = Joints(
        *(-rng.uniform(0, 1, 300), rng.uniform(0, 1, 300)),
        *(-rng.uniform(0.2, 1, 300), rng.uniform(0.2, 1, 300)),
        *(-rng.uniform(0.2, 1, 300), rng.uniform(0.2, 1, 300)),
        T=0.25,
    )
    x, v = rng.uniform(-5, 5, 300), rng.uniform(-5, 5, 300)
    viable = np.zeros(300, dtype=bool)
    for _, w, before, box in walk(joints, x, v, 1500, rng):
        assert (box.viable | ~viable).all()  # viable states stay viable
        viable = box.viable
        assert (box.lower <= box.upper).all()
        assert (box.viable | (box.lower == box.upper)).all()
        assert (w <= before + 0.25 * joints.a_max + 1e-14).all()
        assert (w >= before + 0.25 * joints.a_min - 1e-14).all()
    assert viable.all()


def path(joints: Joints, x: float, v: float, ticks: int) -> np.ndarray:
    """Return positions of a joint that returns at the only rate of its box."""
    positions = []
    for _ in range(ticks):
        box = joints.box([x], [v])
        v = float(box.lower[0])
        x += joints.T * v
        positions.append(x)
    return np.array(positions)


def test_a_joint_too_fast_to_stop_brakes_with_full_acceleration():
    """Check v = 5 at 1 m with 10 m/s^2 and 0.1 s: 0.1 (4 + 3 + 2 + 1) = 1 m more, not 2."""
    joints = Joints(-2.0, 1.5, -9.0, 9.0, -10.0, 10.0, 0.1)
    np.testing.assert_allclose(path(joints, 1.0, 5.0, 5), [1.4, 1.7, 1.9, 2.0, 2.0])


def test_the_return_from_far_outside_respects_the_other_limit():
    """Check the return from 3 to 0 .. 0.1 at 1 m/s^2 without overshoot: 2 sqrt(3) s, 35 ticks."""
    back = path(Joints(0.0, 0.1, -9.0, 9.0, -1.0, 1.0, 0.1), 3.0, 0.0, 40)
    assert back[27] > 0.1 >= back[34:].max() and back.min() >= -1e-15


@pytest.mark.parametrize(
    ("limits", "x", "v", "viable", "lower", "upper"),
    [
        # Rates have priority over positions: 3 times the rate limit, below the position limit.
        ((0.0, 1.0, -1.0, 1.0, -5.0, 5.0), -0.5, 3.0, False, 2.5, 2.5),
        # Limits apply from the next tick on.
        ((0.0, 1.0, -9.0, 9.0, -5.0, 5.0), 1.01, 0.0, True, -0.5, -0.1),
        # Four ticks of full braking end at 1 m; round-off must not exclude it.
        ((-1.0, 1.0, -9.0, 9.0, -10.0, 10.0), 0.4 + 1e-14, 4.0, True, 3.0, 3.0),
        ((-1.0, 1.0, -9.0, 9.0, -10.0, 10.0), 0.4 + 1e-9, 4.0, False, 3.0, 3.0),
        # Without limits of one kind, the others give the box.
        ((-INF, INF, -INF, INF, -INF, INF), 3.0, 4.0, True, -INF, INF),
        ((0.0, 1.0, -INF, INF, -INF, INF), 0.25, 4.0, True, -2.5, 7.5),
        ((-INF, INF, -1.0, 2.0, -INF, INF), 3.0, -70.0, True, -1.0, 2.0),
        ((-INF, INF, -INF, INF, -5.0, 3.0), 3.0, 4.0, True, 3.5, 4.3),
    ],
)
def test_boxes_equal_those_computed_by_hand(limits, x, v, viable, lower, upper):
    box = Joints(*limits, T=0.1).box([x], [v])
    assert box.viable[0] == viable
    assert (box.lower[0], box.upper[0]) == pytest.approx((lower, upper))


def test_one_rate_remains_if_braking_just_suffices():
    """Check full braking at the limit from 1 with 10 m/s^2 and 0.1 s, for any round-off."""
    joints = Joints(-1.0, 1.0, -9.0, 9.0, -10.0, 10.0, 0.1)
    box = joints.box(np.full(7, 1.0), 1.0 + 1e-13 * np.arange(-3, 4))
    assert box.viable.all()
    np.testing.assert_array_equal(box.lower, box.upper)


@pytest.mark.parametrize("d", [1e12, 1e25, 1e40, 1e100])
def test_braking_that_takes_more_ticks_than_can_be_counted_is_continuous(d):
    """Check w = sqrt(2 a d), the limit of many ticks."""
    joints = Joints(-np.inf, d, -np.inf, np.inf, -1e-9, np.inf, 1e-3)
    assert joints.box([0.0], [0.0]).upper[0] == pytest.approx(np.sqrt(2e-9 * d), rel=1e-9)


NUMBERS = st.floats(-1e119, 1e119)
LARGE = st.one_of(st.just(0.0), st.floats(1e-119, 1e119), st.just(np.inf))
POSITIVE = st.one_of(st.floats(1e-119, 1e119), st.just(np.inf))


@given(
    state=st.tuples(NUMBERS, NUMBERS),
    x_min=NUMBERS,
    sizes=st.tuples(LARGE, LARGE, LARGE, POSITIVE, POSITIVE),
    T=st.floats(1e-119, 1e119),
)
def test_no_ratio_of_limits_empties_a_box_or_gives_nan(state, x_min, sizes, T):
    """Check that rest is always allowed at rest within the limits."""
    (x, v), (range_, slow, fast, down, up) = state, sizes
    joints = Joints(x_min, x_min + range_, -slow, fast, -down, up, T)
    box = joints.box([x], [v])
    assert box.lower[0] <= box.upper[0]
    still = joints.box([np.clip(x, joints.x_min, joints.x_max)], [0.0])
    assert still.viable[0]
    assert still.lower[0] <= 0.0 <= still.upper[0]


def test_a_batch_is_its_joints_one_by_one():
    rng = np.random.default_rng(3)
    joints = any_joints(rng, 5, T=0.1)
    x, v = rng.normal(size=(4, 3, 5)), rng.normal(size=(3, 5))
    box = joints.box(x, v)
    for at in np.ndindex(4, 3, 5):
        one = Joints(*(np.asarray(A)[at[-1]] for A in joints[:-1]), T=0.1).box([x[at]], [v[at[1:]]])
        assert (box.lower[at], box.upper[at]) == (one.lower[0], one.upper[0])
        assert box.viable[at] == one.viable[0]


@given(SEEDS, st.integers(0, 6))
def test_plain_arrays_and_lists_have_the_same_box(seed, n):
    """Compare bit-wise at any limits, including infinite and violated ones."""
    rng = np.random.default_rng(seed)
    joints = any_joints(rng, n)
    sides = [
        np.where(rng.random(n) < 0.2, infinite, side)
        for side, infinite in zip(joints[:-1], (-np.inf, np.inf) * 3, strict=True)
    ]
    x, v = 10 * rng.normal(size=n), rng.normal(size=n)
    plain = Joints(*sides, T=joints.T).box(x, v)
    other = Joints(*(side.tolist() for side in sides), T=joints.T).box(x, v.tolist())
    whole = joints.box(np.zeros(n, dtype=int), v), joints.box(np.zeros(n), v)
    for name in ("lower", "upper", "viable"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(other, name), strict=True)
        assert not getattr(plain, name).flags.writeable
        np.testing.assert_array_equal(*(getattr(box, name) for box in whole))


@given(st.sampled_from(EXTREMES), st.sampled_from(EXTREMES), st.sampled_from([0.0, 1e-9, 1.0]))
def test_the_compiled_rule_for_ties_is_the_rule(value, bound, zero):
    assert lib.exceeds(value, bound, zero) == exceeds(value, bound, zero=zero)


def test_incompatible_batches_raise_with_names():
    joints = any_joints(np.random.default_rng(0), 2)
    with pytest.raises(ValueError, match=r"broadcast, got position \(2,\), rate \(3,\)"):
        joints.box(np.zeros((2, 2)), np.zeros((3, 2)))
