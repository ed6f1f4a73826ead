"""Test the rank decision: where it changes, its gap, and its use by all results."""

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from prioritized import (
    ConstrainedSystem,
    Kinematics,
    Status,
    Task,
    failure_atlas,
    force_mapping,
    velocity_mapping,
)
from prioritized._solver.rank import RANK_TOLERANCE
from tests import spaces
from tests.profiles import scaled
from tests.random_systems import SEEDS, major_and_secondary, of_rank, orthogonal


def check(decision: tuple[bool, float], sigma: float, scale: float) -> None:
    """Return the rank decision (counts, gap) on a singular value of a matrix of this scale."""
    distance = sigma / (scale * RANK_TOLERANCE)
    assume(abs(np.log10(distance)) > 0.05)  # round-off moves sigma by 1e-16: 1e-6 of the threshold
    counts, gap = decision
    assert counts == (distance > 1)
    # Round-off is a few percent of sigma = 1e-14.
    assert gap == pytest.approx(max(distance, 1 / distance), rel=0.1)


@given(SEEDS, st.floats(2, 14), st.floats(-3, 3))
def test_ranks_change_where_singular_values_cross_the_tolerance(seed, nearness, unit):
    """Check sigma / scale = rank_tolerance; the gap is the factor to that point."""
    small, size = 10.0**-nearness, 10.0**unit
    U, V = (orthogonal(np.random.default_rng(seed + k), 2) for k in (0, 1))
    weak = size * U @ np.diag([1.0, small]) @ V.T
    norm = size * np.hypot(1.0, small)

    report = ConstrainedSystem(weak, None, [0, 1]).kinematics().manipulability([0, 1])
    # Both rows are major: a selection of norm sqrt(2) takes part in the product.
    reached = not report.unmanipulable, report.gaps["unmanipulable"]
    check(reached, size * small, norm * np.sqrt(2.0))
    reached = not report.unmanipulable_task, report.gaps["unmanipulable_task"]
    check(reached, size * small, norm)

    # As passive columns of the task, the matrix gives a second direction of self-motion.
    task = np.hstack([np.zeros((2, 1)), weak])
    report = ConstrainedSystem(task, None, [0]).kinematics().manipulability([0, 1])
    check((len(report.bases["unstable"].T) == 2, report.gaps["unstable"]), size * small, norm)
    major = len(report.bases["unstable_major"].T) == 2, report.gaps["unstable_major"]
    check(major, size * small, norm)  # with every row major, the same decision

    # As passive columns of the loops, it closes a loop, or gives an internal force and idle joint.
    loops = np.hstack([np.zeros((2, 1)), weak])
    report = ConstrainedSystem(np.zeros((1, 3)), loops, [0]).kinematics().manipulability([0])
    check((not report.irresolvable, report.gaps["irresolvable"]), size * small, norm)
    assert report.unobservable == report.irresolvable

    # As active columns, it gives a second constrained rate.
    report = ConstrainedSystem(np.eye(2), weak, [0, 1]).kinematics().manipulability([0])
    bound = len(report.bases["constrained_active"]) == 2, report.gaps["constrained_active"]
    check(bound, size * small, norm)

    # Mappings are exact or nearest; forces are commanded, or borne by the structure.
    velocity, force = velocity_mapping(weak, [0, 1]), force_mapping(weak, [0, 1])
    is_exact = velocity.status is Status.EXACT
    check((is_exact, float(velocity.gap)), size * small, norm * np.sqrt(2.0))
    assert velocity.rank == 1 + is_exact
    # Rates are finite, as the singular value is inverted or dropped.
    assert np.abs(velocity.major).max() <= 1.01 / (norm * RANK_TOLERANCE)
    assert force.rank == 2  # any force: the structure bears what has no effect in J
    if abs(np.log10(small / RANK_TOLERANCE)) > 0.5:  # a factor of sqrt(2)
        assert (force.status is Status.EXACT) == is_exact
        assert np.trace(force.reaction) == pytest.approx(0.0 if is_exact else 1.0, abs=1e-9)


@given(SEEDS, st.floats(0, 8))
def test_round_off_of_fast_passive_joints_is_no_motion(seed, exponent):
    """Check the difference of two passive rates of 10^k per active rate: round-off 1e-16 10^k."""
    slow = 10.0**-exponent
    rng = np.random.default_rng(seed)
    turn = orthogonal(rng, 2)  # any other pair of passive coordinates
    J_Cp, J_Tp = slow * orthogonal(rng, 2) @ turn, np.array([[1.0, -1.0]]) @ turn
    J_Ca = -J_Cp @ turn.T @ np.ones((2, 1)) / slow
    system = ConstrainedSystem(np.hstack([[[0.0]], J_Tp]), np.hstack([J_Ca, J_Cp]), [0])
    kin = system.kinematics()
    np.testing.assert_allclose(np.linalg.norm(kin.passive_rates([slow])), np.sqrt(2.0))
    assert kin.manipulability([0]).unmanipulable
    assert kin.velocity_mapping([0]).rank == 0


def test_the_rank_is_decided_with_the_given_scale_and_tolerance():
    """Check a small difference of large terms, and directions 3e-10 apart at tolerance 1e-8."""
    left_over = 1e-17 * np.ones((1, 3))
    assert velocity_mapping(left_over, [0], scale=1.0).rank == 0
    assert velocity_mapping(left_over, [0]).rank == 1
    mapping = velocity_mapping(np.eye(2), [[1, 0], [1, 3e-10]], rank_tolerance=1e-8)
    assert mapping.rank == 1 and mapping.secondary.shape == (2, 1)


NEAR = st.floats(-1.0, 2.0)
"""Exponents of singular values in multiples of the threshold: 0.1 to 100."""


def nearly_fixed(seed: int, nearness: float, m: int, columns: int) -> Kinematics:
    """Return an arm of m task rows whose passive columns, but perhaps the first, hardly move it."""
    rng = np.random.default_rng(seed)
    active, retained = rng.normal(size=(m, 4)), min(m, columns)
    sigma = 10.0 ** (nearness + rng.uniform(-0.5, 0.5, size=retained)) * RANK_TOLERANCE
    if retained > 1 and rng.random() < 0.5:
        sigma[0] = 1.0
    passive = orthogonal(rng, m)[:, :retained] * sigma @ orthogonal(rng, columns)[:retained]
    J_T = np.hstack([active, np.linalg.norm(active) * passive])
    return ConstrainedSystem(J_T, None, range(4)).kinematics()


def nearly_constrained(seed: int, nearness: float, m: int, columns: int) -> Kinematics:
    """Return loops that constrain one active rate by slightly more, or less, than the threshold."""
    rng = np.random.default_rng(seed)
    J_Cp = of_rank(rng, columns + 1, columns, columns)
    follow, forbidden = rng.normal(size=(columns, 4)), rng.normal(size=(1, 4))
    weak = np.linalg.norm(J_Cp) * 10.0**nearness * RANK_TOLERANCE * spaces.null(J_Cp.T) @ forbidden
    J_C = np.hstack([J_Cp @ follow + weak, J_Cp])
    return ConstrainedSystem(rng.normal(size=(m, 4 + columns)), J_C, range(4)).kinematics()


@pytest.mark.parametrize("near", [nearly_fixed, nearly_constrained])
@given(SEEDS, NEAR, st.integers(1, 6), st.integers(1, 3), st.data())
def test_power_balances_at_any_gap(near, seed, nearness, m, columns, data):
    """Check force times velocity = torque times rate, for any motion that the report admits."""
    kin, rng = near(seed, nearness, m, columns), np.random.default_rng(seed)
    major, others = major_and_secondary(data, m)
    mapping = kin.force_mapping(
        major, None, rng.uniform(0.5, 2, 4), rng.uniform(0.5, 2, len(others))
    )
    targets = [rng.normal(size=size) for size in (len(major), 4, len(others))]
    torques, f = mapping(*targets), np.empty(m)
    f[major], f[others] = (
        targets[0] - mapping.residual(targets[0]),
        mapping.secondary_force(*targets),
    )
    Z = spaces.null(kin.active_constraint)
    rates = Z @ rng.normal(size=Z.shape[1])
    v = kin.J @ rates + kin.self_motion @ rng.normal(size=kin.self_motion.shape[1])
    size = np.linalg.norm(np.concatenate(targets)) * np.linalg.norm(v)
    size += np.linalg.norm(torques) * np.linalg.norm(rates)
    assert abs(f @ v - torques @ rates) <= 1e-9 * size


@given(SEEDS, NEAR, st.integers(1, 6), st.integers(1, 3))
def test_report_and_mappings_agree_on_the_self_motion_of_the_task(seed, nearness, m, columns):
    """Check that with every row major the self-motion is that of the task, without force on it."""
    kin, rows = nearly_fixed(seed, nearness, m, columns), list(range(m))
    report = kin.manipulability(rows)
    assert report.bases["unstable"].shape == report.bases["unstable_major"].shape
    velocity, force = kin.velocity_mapping(rows), kin.force_mapping(rows)
    assert (velocity.status is Status.SELF_MOTION) == report.unstable
    assert (force.status is Status.LEAST_SQUARES) == report.unstable
    assert force.rank == m - report.bases["unstable"].shape[1]
    assert force.gap <= 1.001 * report.gaps["unstable"]


FLAGS = (
    *("unmanipulable", "unmanipulable_task", "unstable", "unstable_major"),
    *("irresolvable", "constrained_active"),
)


def weak(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Return a matrix with half of its singular values between 1e-3 and 1e-9."""
    k = min(rows, columns)
    sigma = np.where(rng.random(k) < 0.5, 1.0, 10.0 ** -rng.uniform(3, 9, size=k))
    return orthogonal(rng, rows)[:, :k] * sigma @ orthogonal(rng, columns)[:k]


def mechanisms(seed: int) -> Iterator[ConstrainedSystem]:
    """Sample three actuators and any loops, with tolerances among the singular values."""
    rng = np.random.default_rng(seed)
    while True:
        c, accuracy = int(rng.integers(0, 5)), 10.0 ** -rng.uniform(5, 9)
        J_C = weak(rng, c, 7) if c else None
        yield ConstrainedSystem(weak(rng, 3, 7), J_C, range(3), geometry_accuracy=accuracy)


def conditions(system: ConstrainedSystem) -> Iterator[tuple[tuple[int, ...], Kinematics]]:
    """Return every condition of three actuators, as of an atlas."""
    for code in itertools.product(range(3), repeat=3):
        locked, free = ([k for k in range(3) if code[k] == what] for what in (1, 2))
        yield code, system.with_failures(locked, free).kinematics()


@pytest.mark.parametrize("seed", range(scaled(20)))
def test_atlas_report_and_mappings_agree_on_weak_directions(seed):
    rows = [0, 1]
    for system in itertools.islice(mechanisms(seed), 5):
        atlas = failure_atlas(system, rows)
        for row, (code, kin) in enumerate(conditions(system)):
            report = kin.manipulability(rows)
            for flag in FLAGS:
                assert getattr(atlas, flag)[row] == getattr(report, flag), (code, flag)
            mapping = kin.velocity_mapping(rows, joint_weight=np.ones(len(kin.active)))
            assert (mapping.status is Status.SELF_MOTION) == report.unstable_major
            assert (mapping.rank < 2) == report.unmanipulable
            assert mapping.rank == atlas.major_rank[row]
            attainable = kin.attainable(rows, (-1.0, 1.0))
            assert (attainable.radius > 0.0) == bool(atlas.possible[row])


@pytest.mark.parametrize(("seed", "number"), [(22, 68), (25, 7), (28, 77), (33, 10)])
def test_no_mapping_or_hierarchy_moves_along_unreachable_directions(seed, number):
    """Check loops of condition 1e4, whose rows for solvers differ from those decided on."""
    system = next(itertools.islice(mechanisms(seed), number, None))
    for code, kin in conditions(system):
        mapping = kin.velocity_mapping([0, 1], joint_weight=np.ones(len(kin.active)))
        assert (mapping.rank < 2) == kin.manipulability([0, 1]).unmanipulable, code
        hierarchy = kin.hierarchy([Task([0, 1]), Task.joints()])
        for v in np.eye(2):
            rates = hierarchy.solve([v, None]).rates
            assert np.linalg.norm(rates) <= 1.01 * mapping.largest_gain, code


@given(st.floats(-13, -7), st.booleans())
def test_no_gap_exceeds_that_of_the_loop_closure(exponent, more):
    """Check that gaps include the first decision, whether a loop determines a passive joint."""
    weak = 10.0**exponent
    t = 2e-10 if more else 1e-10
    system = ConstrainedSystem([[1, 1]], [[1, weak]], [0], rank_tolerance=t)
    report = system.kinematics().manipulability([0])
    distance = max(weak / t, t / weak)
    for name, gap in report.gaps.items():
        assert gap <= 1.01 * distance, name
    assert float(system.kinematics().velocity_mapping([0]).gap) <= 1.01 * distance
    assert float(system.kinematics().force_mapping([0]).gap) <= 1.01 * distance


@given(st.floats(-9, 0))
def test_a_fast_passive_joint_without_effect_on_the_task_changes_no_rank(exponent):
    """Check the rotor of a screw of any lead, which turns fast without effect on the task."""
    lead = 10.0**exponent
    system = ConstrainedSystem([[1, 0, 0], [0, 1e-5, 0]], [[1, 0, -lead]], [0, 1])
    report = system.kinematics().manipulability([0, 1])
    assert not report.unmanipulable
    assert system.kinematics().velocity_mapping([0, 1]).status is Status.EXACT
    assert failure_atlas(system, [0, 1]).possible[0]


@pytest.mark.parametrize("w", [1e9, 1e11])
def test_relatively_small_weights_and_metrics_reduce_the_gap(w):
    """Check a joint weight of 1 with one of 1e11, and an inertia of 1e-11 with one of 1."""
    J = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    velocity = velocity_mapping(J, [0], joint_weight=np.ones(3), secondary_weight=[w])
    assert velocity([0.0], joint_velocity=[0.0, 0.0, 5.0])[2] == pytest.approx(5.0 * (w < 1e10))
    assert float(velocity.gap) < 20.0
    system = ConstrainedSystem([[1, 0, 0, 0]], [[1, 1, 1, 0]], [0])
    assert system.kinematics(passive_metric=[0, 1e-11, 3e-11, 1]).gap < 10.0
    assert system.kinematics(passive_metric=[0, 1, 3, 1]).gap > 1e9


def test_the_accuracy_sets_the_tolerance_and_stays_visible():
    system = ConstrainedSystem(np.eye(2), None, [0, 1], geometry_accuracy=1e-6)
    assert system.geometry_accuracy == 1e-6
    assert system.rank_tolerance == pytest.approx(1e-5)
    failed = dataclasses.replace(system, J_T=2 * np.eye(2)).with_failures(locked=[0])
    assert (failed.geometry_accuracy, failed.rank_tolerance) == (1e-6, system.rank_tolerance)
    assert ConstrainedSystem(np.eye(2), None, [0, 1]).geometry_accuracy is None
    # Round-off does not depend on the accuracy of the geometry.
    exact = ConstrainedSystem(np.eye(2), None, [0, 1], geometry_accuracy=0.0)
    assert exact.rank_tolerance == RANK_TOLERANCE


@pytest.mark.parametrize("seed", range(6))
def test_a_tolerance_of_zero_causes_no_division_by_zero(seed):
    """Check a duplicated loop, whose round-off counts."""
    J = np.random.default_rng(seed).normal(size=(4, 5))
    system = ConstrainedSystem(J[:3], J[[3, 3]], [0, 1, 2], rank_tolerance=0.0)
    assert np.isfinite(system.kinematics().passive_rates(np.zeros(3))).all()


@pytest.mark.parametrize("batched", [False, True])
def test_joint_weights_are_exact_for_any_geometry(batched):
    """Check a weight ratio of 1e5 on a robot known to 1e-4."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        J, target = rng.normal(size=(2, 5)), rng.normal(size=2)
        J = np.stack([J, J]) if batched else J
        fine, rough = (
            velocity_mapping(J, [0, 1], None, [1.0, 2.0, 3.0, 1e5, 0.5], rank_tolerance=tolerance)
            for tolerance in (1e-10, 1e-3)
        )
        np.testing.assert_allclose(rough.major, fine.major, rtol=1e-9)
        np.testing.assert_allclose(rough(target), fine(target), rtol=1e-9)


AXES = np.eye(3)


def hinge(axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the twist [omega; v] of the payload origin per rate of a hinge."""
    return np.concatenate([axis, np.cross(axis, -point)])


def leg(base: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Return ball joint, slide along the strut, ball joint: the strut can spin. Balls use AXES."""
    strut = (top - base) / np.linalg.norm(top - base)
    slide = np.concatenate([np.zeros(3), strut])
    below, above = ([hinge(axis, point) for axis in AXES] for point in (base, top))
    return np.array([*below, slide, *above]).T


def platform(bases: np.ndarray, tops: np.ndarray) -> ConstrainedSystem:
    """Return a payload on S-P-S legs: its twist is that of the first leg, equal to the others."""
    legs = [leg(base, top) for base, top in zip(bases, tops, strict=True)]
    N = 7 * len(legs)
    J_T = np.hstack([legs[0], np.zeros((6, N - 7))])
    J_C = np.zeros((6 * len(legs) - 6, N))
    for k in range(1, len(legs)):
        rows = slice(6 * k - 6, 6 * k)
        J_C[rows, :7] = legs[0]
        J_C[rows, 7 * k : 7 * k + 7] = -legs[k]
    return ConstrainedSystem(J_T, J_C, [7 * k + 3 for k in range(len(legs))])


DEGREES = st.floats(-180, 180)
GEOMETRIES = st.sampled_from(["general", "flat", "one top", "parallel"])


def points(geometry: str, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return base and top points; all but the general ones are singular by symmetry."""
    bases, tops = rng.uniform(-1, 1, size=(2, count, 3)) + np.array([[[0, 0, -2]], [[0, 0, 2]]])
    if geometry == "flat":  # all struts in one plane exert no force across it
        bases[:, 1] = tops[:, 1] = 0.0
    if geometry == "one top":  # the payload rotates freely about the common point of all struts
        tops[:] = 0.0
    if geometry == "parallel":  # no lateral force acts
        bases[:, :2] = tops[:, :2]
    return bases, tops


@given(
    SEEDS,
    GEOMETRIES,
    st.sampled_from([1, 2, 3, 6]),
    st.tuples(DEGREES, DEGREES, DEGREES),
    st.data(),
)
def test_a_tilted_mechanism_has_the_classification_of_the_upright_one(
    seed, geometry, legs, tilt, data
):
    """Check that products that vanish when upright are round-off when tilted."""
    rng = np.random.default_rng(seed)
    bases, tops = points(geometry, rng, legs)
    R = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
    twist = block_diag(R, R)
    codes = data.draw(st.lists(st.integers(0, 2), min_size=legs, max_size=legs))
    failed = [[k for k in range(legs) if codes[k] == code] for code in (1, 2)]
    # Directions rotate with the mechanism, unlike rows.
    major = np.eye(6)[data.draw(st.lists(st.integers(0, 5), min_size=1, max_size=3, unique=True))]

    upright = platform(bases, tops).with_failures(*failed)
    tilted = platform(bases @ R.T, tops @ R.T).with_failures(*failed)
    kin, turned_kin = upright.kinematics(), tilted.kinematics()
    assume(kin.closure_condition < 1e3)  # beyond 5e3 round-off of the loops may change a decision
    report, turned = kin.manipulability(major), turned_kin.manipulability(major @ twist.T)
    assert str(report) == str(turned)  # flags, and numbers of directions
    # A small worst gain has the round-off of the largest one.
    np.testing.assert_allclose(turned.worst_gain, report.worst_gain, atol=1e-8)

    turns = {
        "unmanipulable": np.eye(len(major)),
        "unmanipulable_task": twist,
        "unstable": twist,
        "unstable_major": np.eye(len(major)),
        "unstable_secondary": twist,
        "constrained_active": np.eye(len(kin.active)),
    }
    for name, turn in turns.items():
        one, two = report.bases[name], turned.bases[name]
        if name == "constrained_active":
            one, two = one.T, two.T
        # The accuracy of a null space is 1e-16 over the smallest nonzero singular value.
        spaces.assert_same(two, turn @ one)
