"""Eq. (40): how far the Jacobian varies over the stroke, and the proof that it is no further."""

from itertools import pairwise, product

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import direct
from scipy.spatial.transform import Rotation

from experiments import jacobian_certificate as certificate
from experiments.jacobian import (
    CERTIFICATE_LIMIT,
    READINGS,
    VERTICES,
    at_height,
    checks,
    in_millimetres,
    inverse,
    jacobian_at,
    relative_change,
    twist_in_base_axes,
    variation,
)
from experiments.jacobian_certificate import (
    NORMS,
    ORDER,
    certify,
    jacobian_forms,
    jacobian_series,
    size,
)
from fjh.rig.hexapod import paper
from fjh.rig.hexapod.closed_form import Hexapod, hexapod
from fjh.rig.hexapod.forward import forward_kinematics
from sim import NOMINAL, Pose, load_model
from tests.profiles import examples

MACHINE = hexapod(load_model())
STROKE_M = paper.STROKE_M
J_0 = np.linalg.inv(MACHINE.inverse_jacobian(NOMINAL))


def random_hexapod(rng: np.random.Generator) -> Hexapod:
    """The paper's with every node moved by up to 3 cm."""
    return Hexapod(
        bottom_m=MACHINE.bottom_m + rng.uniform(-0.03, 0.03, (6, 3)),
        top_m=MACHINE.top_m + rng.uniform(-0.03, 0.03, (6, 3)),
    )


def seen_from(machine: Hexapod, pose: Pose) -> Hexapod:
    """The same hexapod, its nominal pose where its payload is now."""
    return Hexapod(
        bottom_m=machine.bottom_m - pose.translation_m, top_m=machine.top_m @ pose.rotation.T
    )


@given(seed=st.integers(0, 2**32 - 1))
def test_the_power_series_of_the_jacobian_sums_to_the_jacobian(seed):
    """Forward kinematics and inversion, which know nothing of series, are the oracle."""
    rng = np.random.default_rng(seed)
    machine, struts_m = random_hexapod(rng), rng.uniform(-4e-3, 4e-3, (3, 6))
    series = jacobian_series(machine, struts_m, 6)
    there = jacobian_at(machine, struts_m, twist_in_base_axes)
    errors = [np.abs(sum(series.J[: k + 1]) - there).max() for k in range(7)]
    assert errors[6] < 1e-6 * errors[0]
    assert all(after < 0.5 * before for before, after in pairwise(errors))


def test_the_multilinear_forms_are_the_series_and_symmetric():
    struts = np.random.default_rng(2).uniform(-1, 1, 6)
    forms = jacobian_forms(MACHINE, STROKE_M, 3)
    series = jacobian_series(MACHINE, STROKE_M * struts, 3)
    for k, form in enumerate(forms):
        assert form.shape == (6,) * k + (6, 6)
        contracted = form
        for _ in range(k):
            contracted = np.tensordot(struts, contracted, axes=(0, 0))
        np.testing.assert_allclose(
            contracted, series.J[k], atol=1e-12 * float(size(forms[0], "two"))
        )
    np.testing.assert_allclose(forms[2], forms[2].swapaxes(0, 1), atol=1e-16)
    np.testing.assert_allclose(forms[3], forms[3].transpose(2, 0, 1, 3, 4), atol=1e-16)


def on_ray(machine: Hexapod, end_m: np.ndarray) -> list[Pose]:
    """Five poses on the way to strut displacements."""
    ray = forward_kinematics(machine, end_m * np.linspace(0, 1, 5)[:, None])
    return [Pose(R, x) for R, x in zip(ray.rotation, ray.translation_m, strict=True)]


@given(seed=st.integers(0, 2**32 - 1))
def test_every_estimate_bounds_its_taylor_coefficient_everywhere_on_every_ray(seed):
    """At any point of any ray, by the series of the hexapod as it stands there."""
    rng = np.random.default_rng(seed)
    machine, corner = random_hexapod(rng), rng.choice([-1.0, 1.0], 6)
    length_m, stroke_m = rng.uniform(0.05, 0.5), rng.uniform(1e-4, 3e-3)
    D = np.array([length_m] * 3 + [1.0] * 3)
    poses = on_ray(machine, stroke_m * corner)
    inverses = [np.linalg.inv(machine.inverse_jacobian(pose)) for pose in poses]
    largest = max(float(size(D[:, None] * J, "two")) for J in inverses)
    bounds = certificate.coefficient_bounds(machine, stroke_m, length_m, largest)
    for pose in poses:
        there = seen_from(machine, pose)
        # As the machine stands there its struts have their present lengths.
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


def test_the_estimates_are_attained_so_none_of_their_factors_can_go():
    """All struts alike: [omega; v] is as long as can be, and x with it; then the end of a ray."""
    length_m, corner = 0.05, np.ones(6)  # turns count little: the line of sight is the stiffest
    D = np.array([length_m] * 3 + [1.0] * 3)[:, None]
    largest = float(size(D * J_0, "two"))
    bounds = certificate.coefficient_bounds(MACHINE, STROKE_M, length_m, largest)
    x_1 = jacobian_series(MACHINE, STROKE_M * corner, 1).from_bottom[1]
    assert np.linalg.norm(x_1) == pytest.approx(bounds.from_bottom[1], rel=1e-9)
    assert size(MACHINE.inverse_jacobian(NOMINAL) / D.T, "two") > bounds.A[0] / np.sqrt(6)

    # Unequal struts: only the longest can be that long, and only the shortest that short.
    machine = Hexapod(
        bottom_m=MACHINE.bottom_m * np.array([[1.2], [1], [1], [1], [1], [0.9]]),
        top_m=MACHINE.top_m,
    )
    lengths_m = machine.nominal_length_m
    assert np.ptp(lengths_m) > 0.03
    bounds = certificate.coefficient_bounds(machine, STROKE_M, length_m, largest)
    assert bounds.over_length[0] == pytest.approx(1 / (lengths_m.min() - STROKE_M), rel=1e-12)
    # A row of A is a moment and a strut, over its length: with no moment the strut alone is left.
    far = certificate.coefficient_bounds(machine, STROKE_M, 1e9, largest)
    longest = far.A[0] / np.sqrt(6) / far.over_length[0]
    assert longest == pytest.approx(lengths_m.max() + STROKE_M, rel=1e-6)


@pytest.mark.parametrize("length_m", [0.05, 3.0])
@pytest.mark.parametrize("norm", NORMS)
def test_the_way_back_from_scaled_turns_is_attained_by_rotations(norm, length_m):
    """||D^-1 M|| is at most ||D^-1|| ||M||_2; an orthogonal M makes it so."""
    M = Rotation.from_rotvec([0.1, 0.5, -0.3]).as_matrix()
    M = np.block([[M, np.zeros((3, 3))], [np.zeros((3, 3)), M]])
    back = M / np.array([length_m] * 3 + [1.0] * 3)[:, None]
    assert size(M, "two") == pytest.approx(1.0)
    assert size(back, norm) == pytest.approx(certificate.unscaled(length_m, norm), rel=1e-12)


@pytest.mark.parametrize("norm", NORMS)
def test_the_largest_of_a_form_is_over_all_its_arguments(norm):
    """By loops over all vertices, each argument its own."""
    rng = np.random.default_rng(7)
    form = rng.normal(size=(6, 6, 6, 6))
    pairs = product(VERTICES, repeat=2)
    brute = max(float(size(np.einsum("i,j,ijab->ab", v, w, form), norm)) for v, w in pairs)
    assert certificate.largest_at_vertices(form, norm) == pytest.approx(brute, rel=1e-12)
    a, b, c, M = (rng.normal(size=shape) for shape in (6, 6, 6, (6, 6)))
    cubic = np.einsum("i,j,k,ab->ijkab", a, b, c, M)
    largest = np.abs(a).sum() * np.abs(b).sum() * np.abs(c).sum() * size(M, norm)
    assert certificate.largest_at_vertices(cubic, norm) == pytest.approx(largest, rel=1e-12)


@pytest.mark.parametrize("norm", NORMS)
def test_the_certificate_becomes_the_value_as_the_box_shrinks(norm):
    ratios = [
        certify(MACHINE, s, norm).upper_bound
        / (variation(MACHINE, s, norm).value * float(size(J_0, norm)))
        for s in (6e-4, 6e-5, 6e-6)
    ]
    assert all(ratio >= 1 for ratio in ratios)
    excess = [ratio - 1 for ratio in ratios]
    assert excess[1] < 0.2 * excess[0]
    assert excess[2] < 0.2 * excess[1]


def test_millimetres_change_the_jacobians_units_and_nothing_else():
    """The geometry in mm gives J with its turns per mm: the 2-norm of its lower rows stays."""
    in_mm = Hexapod(bottom_m=1e3 * MACHINE.bottom_m, top_m=1e3 * MACHINE.top_m)
    J = jacobian_at(in_mm, 1e3 * STROKE_M * VERTICES, twist_in_base_axes)
    as_read = jacobian_at(MACHINE, STROKE_M * VERTICES, in_millimetres)
    np.testing.assert_allclose(J, as_read, rtol=1e-9, atol=1e-12)
    found = certify(in_mm, 1e3 * STROKE_M, "two")
    change = J - jacobian_at(in_mm, np.zeros(6), twist_in_base_axes)
    assert size(change, "two").max() <= found.upper_bound


@pytest.mark.parametrize("bad", [-1e-3, np.nan, np.inf])
def test_a_stroke_that_is_none_is_refused(bad):
    with pytest.raises(ValueError, match="stroke_m must be finite and not negative, got"):
        certify(MACHINE, bad, "two")


@pytest.mark.long
@examples(5)
@given(seed=st.integers(0, 2**32 - 1))
def test_nothing_in_the_box_exceeds_its_certificate(seed):
    rng = np.random.default_rng(seed)
    machine, stroke_m = random_hexapod(rng), rng.uniform(2e-4, 2e-3)
    struts_m = stroke_m * np.vstack([VERTICES, rng.uniform(-1, 1, (50, 6))])
    change = jacobian_at(machine, struts_m, twist_in_base_axes) - jacobian_at(
        machine, np.zeros(6), twist_in_base_axes
    )
    taylor = sum(jacobian_series(machine, struts_m, ORDER).J[1:])
    for norm in NORMS:
        proof = certify(machine, stroke_m, norm)
        assert size(change, norm).max() <= proof.upper_bound
        assert size(change - taylor, norm).max() <= proof.remainder + 1e-13


@pytest.mark.parametrize("norm", NORMS)
def test_the_certificate_is_tight_and_its_first_term_alone_would_be_none(norm):
    found = variation(MACHINE, STROKE_M, norm).value * size(J_0, norm)
    proof = certify(MACHINE, STROKE_M, norm)
    assert found <= proof.upper_bound < 1.01 * found
    assert proof.terms[0] < found  # the linear part is not yet a bound
    assert proof.remainder < 0.01 * found


@pytest.mark.parametrize("norm", NORMS)
def test_rounding_stays_far_below_its_allowance(norm):
    """Turned base axes leave both norms of J alone; only rounding tells them apart."""
    turned = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    there = Hexapod(bottom_m=MACHINE.bottom_m @ turned.T, top_m=MACHINE.top_m @ turned.T)
    one, other = (certify(machine, STROKE_M, norm) for machine in (MACHINE, there))
    assert abs(one.upper_bound / other.upper_bound - 1) < 1e-3 * certificate.ROUNDING


def test_a_box_too_large_for_the_argument_gets_no_certificate():
    """Infinite, not wrong: the estimates cannot keep J from growing without limit."""
    for stroke_m in (0.02, 0.45, 10.0):  # the last ones longer than the struts
        assert certify(MACHINE, stroke_m, "frobenius").upper_bound == np.inf


@pytest.mark.long
@pytest.mark.parametrize("norm", NORMS)
def test_the_supremum_is_attained_where_it_is_said_to_be_and_another_search_finds_no_more(norm):
    """DIRECT (Jones et al. 1993) divides the box and starts from no corner."""
    found = variation(MACHINE, STROKE_M, norm)
    assert relative_change(MACHINE, found.at_strut_m, norm) == pytest.approx(found.value, rel=1e-12)
    assert np.abs(found.at_strut_m).max() <= STROKE_M
    other = direct(
        lambda struts: -relative_change(MACHINE, STROKE_M * struts, norm),
        [(-1, 1)] * 6,
        maxfun=4000,
        vol_tol=0.0,
    )
    assert 0.98 * found.value < -other.fun <= found.value


def test_the_papers_values_are_exceeded_at_a_corner_that_anyone_can_check():
    """Struts 1, 2 long and 3 to 6 short by the full stroke: e is 2.5 times the printed one."""
    corner = STROKE_M * np.array([1, 1, -1, -1, -1, -1])
    e = relative_change(MACHINE, corner, "frobenius")
    assert e == pytest.approx(0.00305, abs=5e-6)
    assert e > 2.5 * paper.JACOBIAN_VARIATION["frobenius"]
    e = relative_change(MACHINE, STROKE_M * np.array([1, 1, -1, -1, -1, 1]), "two")
    assert e == pytest.approx(0.00350, abs=5e-6)
    assert e > 1.9 * paper.JACOBIAN_VARIATION["two"]


H = 1e-6


def slopes(coordinates, pose: Pose) -> np.ndarray:
    """Central differences of coordinates of the pose along each strut, shape (k, 6)."""
    struts_m = MACHINE.displacements(pose)
    columns = []
    for e in H * np.eye(6):
        ahead, behind = (forward_kinematics(MACHINE, struts_m + s * e) for s in (1, -1))
        columns.append((coordinates(ahead) - coordinates(behind)) / (2 * H))
    return np.array(columns).T


@pytest.mark.parametrize("name", ["Euler rates, R = Rz Ry Rx", "Euler rates, R = Rx Ry Rz"])
def test_euler_rates_are_the_slopes_of_the_angles(name):
    sequence = {"Rz Ry Rx": "ZYX", "Rx Ry Rz": "XYZ"}[name.split("= ")[1]]
    pose = NOMINAL.moved(np.array([0.02, -0.03, 0.04, 2e-3, 1e-3, -1e-3]))
    J = np.linalg.inv(MACHINE.inverse_jacobian(pose))

    def angles_and_origin(at: Pose) -> np.ndarray:
        angles = Rotation.from_matrix(at.rotation).as_euler(sequence)
        by_axis = [angles[sequence.index(axis)] for axis in "XYZ"]
        return np.concatenate([by_axis, at.translation_m])

    np.testing.assert_allclose(READINGS[name](pose, J), slopes(angles_and_origin, pose), atol=1e-7)
    assert np.abs(READINGS[name](pose, J) - J).max() > 0.01


def test_the_twist_of_another_point_is_the_slope_of_that_point():
    pose = NOMINAL.moved(np.array([0.02, -0.03, 0.04, 2e-3, 1e-3, -1e-3]))
    J = np.linalg.inv(MACHINE.inverse_jacobian(pose))
    point = slopes(lambda at: at.translation_m + 0.2 * at.rotation[:, 2], pose)
    np.testing.assert_allclose(at_height(0.2)(pose, J)[3:], point, atol=1e-8)


def test_readings_are_what_they_are_called():
    pose = NOMINAL.moved(np.array([0.02, -0.03, 0.04, 2e-3, 1e-3, -1e-3]))
    J = np.linalg.inv(MACHINE.inverse_jacobian(pose))
    along = READINGS["twist, payload axes"](pose, J)
    np.testing.assert_allclose(pose.rotation @ along[:3], J[:3], atol=1e-14)
    np.testing.assert_allclose(pose.rotation @ along[3:], J[3:], atol=1e-14)
    np.testing.assert_allclose(inverse(pose, J), MACHINE.inverse_jacobian(pose), atol=1e-13)
    np.testing.assert_allclose(in_millimetres(pose, J)[:3], J[:3] / 1000, rtol=1e-15)
    for reading in READINGS.values():  # at the nominal pose (38) reads the same in every way
        np.testing.assert_allclose(reading(NOMINAL, J_0), J_0, atol=1e-15)


@pytest.fixture(scope="module")
def tables(jacobian_study):
    return {name: pd.DataFrame(jacobian_study[name]) for name in ("tried", "variation")}


def test_jacobian_json_has_what_others_read(jacobian_study, tables):
    # Half a unit of the last digit, and 0.00055 for 1.004: the geometry gives 1.00455.
    np.testing.assert_allclose(jacobian_study["J0"], paper.JACOBIAN, atol=6e-4)
    np.testing.assert_allclose(jacobian_study["J0"], J_0, rtol=1e-14)
    assert jacobian_study["condition_number"] == pytest.approx(paper.CONDITION_NUMBER, abs=5e-3)
    assert jacobian_study["J0_from_mjcf_largest_difference"] < 1e-12
    for one in tables["variation"].itertuples():
        assert one.value <= one.certified_upper_bound < CERTIFICATE_LIMIT * one.value
        assert one.paper == paper.JACOBIAN_VARIATION[one.norm]
        at = np.array(one.at_strut_m)
        assert relative_change(MACHINE, at, one.norm) == pytest.approx(one.value, rel=1e-9)
        parts = one.linear + one.quadratic + one.cubic + one.remainder
        assert parts == pytest.approx(one.certified_upper_bound, rel=1e-6)
    assert list(tables["variation"].norm) == list(NORMS)


def test_the_papers_pair_is_that_of_the_largest_entry_over_both_norms(tables):
    """The same numerator for both: their ratio, 1.5, is that of the norms of J_0, 1.54."""
    tried = tables["tried"].set_index("reading")
    assert len(tried) == 25
    (theirs,) = tried.index[tried.is_the_papers]
    assert theirs == "twist; largest entry of the change"
    corner = STROKE_M * np.array([-1, -1, -1, -1, -1, 1])
    change = jacobian_at(MACHINE, corner, twist_in_base_axes) - J_0
    assert np.unravel_index(np.abs(change).argmax(), (6, 6)) == (1, 2)
    for norm in NORMS:
        e = np.abs(change).max() / size(J_0, norm)
        assert tried.loc[theirs, norm] == pytest.approx(e, rel=1e-12)
        assert round(e, 4) == paper.JACOBIAN_VARIATION[norm]


def test_a_part_of_the_stroke_that_would_do_does(tables):
    tried = tables["tried"].set_index("reading")
    low, high = tried.loc["inverse of J", ["low_fraction", "high_fraction"]]
    for part, fits in ((low + high) / 2, True), (0.9 * low, False), (1.1 * high, False):
        e = {n: variation(MACHINE, part * STROKE_M, n, inverse).value for n in NORMS}
        tolerance = paper.JACOBIAN_VARIATION_TOLERANCE
        both = [abs(e[n] - paper.JACOBIAN_VARIATION[n]) < tolerance for n in NORMS]
        assert all(both) == fits
    assert tried.loc["twist, base axes", ["low_fraction", "high_fraction"]].isna().all()
    # Local searches end at corners, all of them above the printed number.
    assert tried.frobenius["twist; lowest local maximum"] > 0.0015


@pytest.mark.parametrize(
    ("norm", "column", "value", "what"),
    [
        ("two", "value", 0.004, "eq. (40), two norm: value found divided"),
        ("frobenius", "certified_upper_bound", 0.0032, "eq. (40), frobenius norm: certified bound"),
        ("frobenius", "certified_upper_bound", np.nan, "eq. (40), frobenius norm: value found"),
    ],
)
def test_a_study_that_does_not_prove_its_value_fails_a_check(tables, norm, column, value, what):
    assert all(check.passed for check in checks(tables, 0.0))
    spoilt = tables["variation"].set_index("norm")
    spoilt.loc[norm, column] = value
    spoilt = tables | {"variation": spoilt.reset_index()}
    failed = [str(check) for check in checks(spoilt, 0.0) if not check.passed]
    assert failed[0].startswith(what)
    (failed,) = (str(check) for check in checks(tables, 1e-6) if not check.passed)
    assert failed.startswith("eq. (39): largest difference of geometry and MJCF is 1e-06")


def test_all_sixty_four_corners_are_tried():
    assert {tuple(v) for v in VERTICES} == set(product((-1.0, 1.0), repeat=6))
    half = {tuple(v) for v in certificate._VERTICES}
    assert half | {tuple(-np.array(v)) for v in half} == {tuple(v) for v in VERTICES}
