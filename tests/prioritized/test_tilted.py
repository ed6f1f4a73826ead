"""How a mechanism is turned in space is nobody's business: verdicts stay, bases turn along."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from prioritized import ConstrainedSystem
from tests.random_systems import SEEDS, projector

AXES = np.eye(3)


def hinge(axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Twist [omega; v] of the payload origin per rate of a hinge."""
    return np.concatenate([axis, np.cross(axis, -point)])


def leg(base: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Ball joint, slide along the strut, ball joint: its strut can spin. Balls turn about AXES."""
    strut = (top - base) / np.linalg.norm(top - base)
    slide = np.concatenate([np.zeros(3), strut])
    below, above = ([hinge(axis, point) for axis in AXES] for point in (base, top))
    return np.array([*below, slide, *above]).T


def platform(bases: np.ndarray, tops: np.ndarray) -> ConstrainedSystem:
    """A payload on S-P-S legs: its twist is that of the first leg, and the others must agree."""
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
    """Base and top points; all but the general ones are singular by symmetry."""
    bases, tops = rng.uniform(-1, 1, size=(2, count, 3)) + np.array([[[0, 0, -2]], [[0, 0, 2]]])
    if geometry == "flat":  # all struts in one plane: nothing pushes across it
        bases[:, 1] = tops[:, 1] = 0.0
    if geometry == "one top":  # all struts meet at the payload's own origin: it turns freely there
        tops[:] = 0.0
    if geometry == "parallel":  # nothing pushes sideways
        bases[:, :2] = tops[:, :2]
    return bases, tops


@given(
    SEEDS,
    GEOMETRIES,
    st.sampled_from([1, 2, 3, 6]),
    st.tuples(DEGREES, DEGREES, DEGREES),
    st.data(),
)
def test_a_tilted_mechanism_gets_the_verdicts_of_the_upright_one(seed, geometry, legs, tilt, data):
    """Products that vanish upright leave round-off when tilted; no verdict may chase it."""
    rng = np.random.default_rng(seed)
    bases, tops = points(geometry, rng, legs)
    R = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
    twist = block_diag(R, R)
    codes = data.draw(st.lists(st.integers(0, 2), min_size=legs, max_size=legs))
    failed = [[k for k in range(legs) if codes[k] == code] for code in (1, 2)]
    # Directions, not rows: they turn with the mechanism.
    major = np.eye(6)[data.draw(st.lists(st.integers(0, 5), min_size=1, max_size=3, unique=True))]

    upright = platform(bases, tops).with_failures(*failed)
    tilted = platform(bases @ R.T, tops @ R.T).with_failures(*failed)
    kin, turned_kin = upright.kinematics(), tilted.kinematics()
    report, turned = kin.manipulability(major), turned_kin.manipulability(major @ twist.T)
    assert str(report) == str(turned)  # every flag, and the number of directions of each
    # A worst gain may be small and is known to round-off of the whole.
    np.testing.assert_allclose(turned.worst_gain, report.worst_gain, atol=1e-8)

    # Ball joints turn about fixed axes: their three rates are a vector, and turn, too.
    joints = np.eye(7 * legs)
    for k in range(legs):
        for ball in (7 * k, 7 * k + 4):
            joints[ball : ball + 3, ball : ball + 3] = R
    loops = block_diag(*[twist] * (legs - 1)) if legs > 1 else np.zeros((0, 0))
    locks = np.eye(len(failed[0]))
    turns = {
        "unmanipulable": np.eye(len(major)),
        "unmanipulable_task": twist,
        "unstable": twist,
        "unstable_major": np.eye(len(major)),
        "unstable_secondary": twist,
        "idle": joints[np.ix_(kin.passive, kin.passive)],
        "irresolvable": block_diag(loops, locks),
        "constrained_active": np.eye(len(kin.active)),
    }
    for name, turn in turns.items():
        one, two = report.bases[name], turned.bases[name]
        if name in ("irresolvable", "constrained_active"):
            one, two = one.T, two.T
        # A null space is known to 1e-16 over the least singular value beside it.
        np.testing.assert_allclose(projector(two), projector(turn @ one), atol=1e-6)


def test_the_threshold_must_be_that_of_the_inputs():
    """Against its own largest singular value the round-off of a tilt counts: the law can fail."""
    R = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    strut = R @ np.array([0.0, 0.0, 1.5])
    spin = hinge(strut / 1.5, strut)[3:]  # velocity of the origin as a strut through it spins
    assert 0 < np.abs(spin).max() < 1e-15
    assert np.linalg.matrix_rank(spin[:, None]) == 1
    system = ConstrainedSystem(np.column_stack([strut, spin]), None, [0])
    assert not system.kinematics().manipulability([0]).unstable
