"""Tests of eq. (40), the variation of the Jacobian over the stroke, and of its certificate."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import direct
from scipy.spatial.transform import Rotation

from experiments import jacobian
from experiments import jacobian_certificate as certificate
from experiments.jacobian_certificate import NORMS, ORDER, certify, jacobian_series, size
from fjh.rig.hexapod import paper
from fjh.rig.hexapod.closed_form import Hexapod, hexapod
from fjh.rig.hexapod.forward import forward_kinematics
from sim import NOMINAL, Pose, load_model
from tests.profiles import examples

STROKE_M = paper.STROKE_M
seeds = st.integers(0, 2**32 - 1)
each_norm = pytest.mark.parametrize("norm", NORMS)
machine = cache(lambda: hexapod(load_model()))
nominal = cache(lambda: np.linalg.inv(machine().inverse_jacobian(NOMINAL)))
varied = cache(lambda norm: jacobian.variation(machine(), STROKE_M, norm))


def random_hexapod(rng: np.random.Generator) -> Hexapod:
    """Return the paper's hexapod with every node moved by up to 3 cm."""
    return Hexapod(
        bottom_m=machine().bottom_m + rng.uniform(-0.03, 0.03, (6, 3)),
        top_m=machine().top_m + rng.uniform(-0.03, 0.03, (6, 3)),
    )


@given(seeds)
def test_the_power_series_of_the_jacobian_sums_to_the_jacobian(seed):
    """The reference is forward kinematics and inversion."""
    rng = np.random.default_rng(seed)
    geometry, struts_m = random_hexapod(rng), rng.uniform(-4e-3, 4e-3, (3, 6))
    series = jacobian_series(geometry, struts_m, 6)
    there = jacobian.jacobian_at(geometry, struts_m, jacobian.twist_in_base_axes)
    errors = [np.abs(sum(series.J[: k + 1]) - there).max() for k in range(7)]
    assert errors[6] < 1e-6 * errors[0]
    assert all(after < 0.5 * before for before, after in pairwise(errors))


@given(seeds)
def test_every_estimate_bounds_its_taylor_coefficient_on_every_ray(seed):
    """Coefficients are computed at five points of any ray, as a hexapod with that nominal pose."""
    rng = np.random.default_rng(seed)
    geometry, corner = random_hexapod(rng), rng.choice([-1.0, 1.0], 6)
    length_m, stroke_m = rng.uniform(0.05, 0.5), rng.uniform(1e-4, 3e-3)
    D = np.array([length_m] * 3 + [1.0] * 3)
    ray = forward_kinematics(geometry, stroke_m * corner * np.linspace(0, 1, 5)[:, None])
    poses = [Pose(R, x) for R, x in zip(ray.rotation, ray.translation_m, strict=True)]
    inverses = [np.linalg.inv(geometry.inverse_jacobian(pose)) for pose in poses]
    largest = max(float(size(D[:, None] * J, "two")) for J in inverses)
    bounds = certificate.coefficient_bounds(geometry, stroke_m, length_m, largest)
    for pose in poses:
        there = Hexapod(  # with this nominal pose
            geometry.bottom_m - pose.translation_m, geometry.top_m @ pose.rotation.T
        )
        # This hexapod has the lengths of the pose.
        series = jacobian_series(there, stroke_m * corner, ORDER + 1)
        sizes = {
            "arm": [np.linalg.norm(p, axis=-1).max() for p in series.arm],
            "from_bottom": [np.linalg.norm(x, axis=-1).max() for x in series.from_bottom],
            "over_length": [np.abs(o).max() for o in series.over_length],
            "A": [size(A / D, "two") for A in series.A],
            "J": [size(D[:, None] * J, "two") for J in series.J],
        }
        for name, computed in sizes.items():
            for k, one in enumerate(computed[: ORDER + 2]):
                assert one <= getattr(bounds, name)[k] * (1 + 1e-12), (name, k)


@each_norm
def test_norms_are_attained_by_rotations_and_over_all_arguments_of_a_form(norm):
    """Orthogonal M attain ||D^-1 M|| <= ||D^-1|| ||M||_2; forms are evaluated at all vertices."""
    turn = Rotation.from_rotvec([0.1, 0.5, -0.3]).as_matrix()
    M = np.kron(np.eye(2), turn)
    for length_m in (0.05, 3.0):
        back = M / np.array([length_m] * 3 + [1.0] * 3)[:, None]
        assert size(back, norm) == pytest.approx(certificate.unscaled(length_m, norm), rel=1e-12)
    rng = np.random.default_rng(7)
    form = rng.normal(size=(6, 6, 6, 6))
    pairs = np.einsum("ni,mj,ijab->nmab", jacobian.VERTICES, jacobian.VERTICES, form)
    brute = float(size(pairs, norm).max())
    assert certificate.largest_at_vertices(form, norm) == pytest.approx(brute, rel=1e-12)


@pytest.mark.long
@each_norm
def test_the_certificate_is_tight_converges_to_the_value_and_survives_rounding(norm):
    """The first term alone is no bound; rotated base axes do not change the norms of J."""
    value = varied(norm).value * size(nominal(), norm)
    proof = certify(machine(), STROKE_M, norm)
    assert value <= proof.upper_bound < 1.01 * value
    assert proof.terms[0] < value  # the linear part alone is no bound
    assert proof.remainder < 0.01 * value
    excess = []
    for stroke_m in (6e-4, 6e-5, 6e-6):
        largest = jacobian.variation(machine(), stroke_m, norm).value * float(size(nominal(), norm))
        excess.append(certify(machine(), stroke_m, norm).upper_bound / largest - 1)
    assert min(excess) >= 0
    assert excess[1] < 0.2 * excess[0] and excess[2] < 0.2 * excess[1]
    turned = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    there = Hexapod(bottom_m=machine().bottom_m @ turned.T, top_m=machine().top_m @ turned.T)
    off = certify(there, STROKE_M, norm).upper_bound / proof.upper_bound - 1
    assert abs(off) < 1e-3 * certificate.ROUNDING


def test_a_box_too_large_for_the_proof_has_no_certificate():
    """The bound is infinite, as the estimates do not bound J."""
    for stroke_m in (0.02, 0.45, 10.0):  # the last ones longer than the struts
        assert certify(machine(), stroke_m, "frobenius").upper_bound == np.inf


@pytest.mark.long
@examples(5)
@given(seeds)
def test_nothing_in_the_box_exceeds_its_certificate(seed):
    rng = np.random.default_rng(seed)
    geometry, stroke_m = random_hexapod(rng), rng.uniform(2e-4, 2e-3)
    struts_m = stroke_m * np.vstack([jacobian.VERTICES, rng.uniform(-1, 1, (50, 6))])
    at_rest = jacobian.jacobian_at(geometry, np.zeros(6), jacobian.twist_in_base_axes)
    change = jacobian.jacobian_at(geometry, struts_m, jacobian.twist_in_base_axes) - at_rest
    taylor = sum(jacobian_series(geometry, struts_m, ORDER).J[1:])
    for norm in NORMS:
        proof = certify(geometry, stroke_m, norm)
        assert size(change, norm).max() <= proof.upper_bound
        assert size(change - taylor, norm).max() <= proof.remainder + 1e-13


@pytest.mark.long
@each_norm
def test_the_supremum_is_attained_and_another_search_gives_the_same(norm):
    """The other search is DIRECT (Jones et al. 1993), which subdivides the box."""
    largest = varied(norm)
    there = jacobian.relative_change(machine(), largest.at_strut_m, norm)
    assert there == pytest.approx(largest.value, rel=1e-12)
    assert np.abs(largest.at_strut_m).max() <= STROKE_M
    other = direct(
        lambda struts: -jacobian.relative_change(machine(), STROKE_M * struts, norm),
        [(-1, 1)] * 6,
        maxfun=4000,
        vol_tol=0.0,
    )
    assert 0.98 * largest.value < -other.fun <= largest.value


@pytest.mark.parametrize(
    ("norm", "corner", "e", "times"),
    [
        ("frobenius", [1, 1, -1, -1, -1, -1], 0.00305, 2.5),
        ("two", [1, 1, -1, -1, -1, 1], 0.0035, 1.9),
    ],
)
def test_the_papers_values_are_exceeded_at_a_corner(norm, corner, e, times):
    """Struts are long or short by the full stroke."""
    change = jacobian.relative_change(machine(), STROKE_M * np.array(corner), norm)
    assert change == pytest.approx(e, abs=5e-6)
    assert change > times * paper.JACOBIAN_VARIATION[norm]


H = 1e-6
ASIDE = NOMINAL.moved(np.array([0.02, -0.03, 0.04, 2e-3, 1e-3, -1e-3]))


def slopes(coordinates) -> np.ndarray:
    """Return derivatives of coordinates at a pose off centre along each strut, shape (k, 6)."""
    struts_m, columns = machine().displacements(ASIDE), []
    for e in H * np.eye(6):
        ahead, behind = (forward_kinematics(machine(), struts_m + s * e) for s in (1, -1))
        columns.append((coordinates(ahead) - coordinates(behind)) / (2 * H))
    return np.array(columns).T


def angles_by_axis(sequence: str):
    def angles_and_origin(at: Pose) -> np.ndarray:
        angles = Rotation.from_matrix(at.rotation).as_euler(sequence)
        return np.concatenate([[angles[sequence.index(axis)] for axis in "XYZ"], at.translation_m])

    return angles_and_origin


def test_readings_are_derivatives_of_the_stated_quantities():
    """Euler rates are derivatives of angles, the twist of a point that of its position."""
    J = np.linalg.inv(machine().inverse_jacobian(ASIDE))
    for order, sequence in (("Rz Ry Rx", "ZYX"), ("Rx Ry Rz", "XYZ")):
        euler = jacobian.READINGS[f"Euler rates, R = {order}"](ASIDE, J)
        np.testing.assert_allclose(euler, slopes(angles_by_axis(sequence)), atol=1e-7)
        assert np.abs(euler - J).max() > 0.01
    point = slopes(lambda at: at.translation_m + 0.2 * at.rotation[:, 2])
    np.testing.assert_allclose(jacobian.at_height(0.2)(ASIDE, J)[3:], point, atol=1e-8)
    along = jacobian.READINGS["twist, payload axes"](ASIDE, J)
    np.testing.assert_allclose(np.kron(np.eye(2), ASIDE.rotation) @ along, J, atol=1e-14)
    np.testing.assert_allclose(
        jacobian.inverse(ASIDE, J), machine().inverse_jacobian(ASIDE), atol=1e-13
    )
    np.testing.assert_allclose(jacobian.in_millimetres(ASIDE, J)[:3], J[:3] / 1000, rtol=1e-15)
    for (
        reading
    ) in jacobian.READINGS.values():  # at the nominal pose (38) reads the same in every way
        np.testing.assert_allclose(reading(NOMINAL, nominal()), nominal(), atol=1e-15)


def test_the_json_states_eq_39_and_the_proof_of_eq_40(study):
    J_0 = study.summary["J0"]
    # Half a unit of the last digit; 0.00055 for 1.004, as the geometry gives 1.00455.
    np.testing.assert_allclose(J_0, paper.JACOBIAN, atol=6e-4)
    np.testing.assert_allclose(J_0, nominal(), rtol=1e-14)
    assert study.summary["condition_number"] == pytest.approx(paper.CONDITION_NUMBER, abs=5e-3)
    for one in study.tables["variation"].itertuples():
        assert one.paper == paper.JACOBIAN_VARIATION[one.norm]
        at = jacobian.relative_change(machine(), np.array(one.at_strut_m), one.norm)
        assert at == pytest.approx(one.value, rel=1e-9)
        parts = one.linear + one.quadratic + one.cubic + one.remainder
        assert parts == pytest.approx(one.certified_upper_bound, rel=1e-6)
    assert list(study.tables["variation"].norm) == list(NORMS)


def test_the_papers_pair_is_the_largest_entry_over_both_norms(study):
    """The ratio of the two for one numerator, 1.5, is that of the norms of J_0, 1.54."""
    readings = study.tables["tried"].set_index("reading")
    assert len(readings) == 25
    (papers_reading,) = readings.index[readings.is_the_papers]
    assert papers_reading == "twist; largest entry of the change"
    corner = STROKE_M * np.array([-1, -1, -1, -1, -1, 1])
    change = jacobian.jacobian_at(machine(), corner, jacobian.twist_in_base_axes) - nominal()
    assert np.unravel_index(np.abs(change).argmax(), (6, 6)) == (1, 2)
    for norm in NORMS:
        e = np.abs(change).max() / size(nominal(), norm)
        assert readings.loc[papers_reading, norm] == pytest.approx(e, rel=1e-12)
        assert round(e, 4) == paper.JACOBIAN_VARIATION[norm]
