"""Eq. (40): how far the Jacobian varies over the stroke, and the proof that it is no further."""

from copy import deepcopy
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import direct
from scipy.spatial.transform import Rotation

from experiments import paper
from experiments.jacobian import certificate
from experiments.jacobian.certificate import ORDER, certify
from experiments.jacobian.norms import NORMS, size
from experiments.jacobian.rays import jacobian_forms, jacobian_series
from experiments.jacobian.readings import READINGS, at_height, in_millimetres, inverse
from experiments.jacobian.summary import CERTIFICATE_LIMIT, complaint
from experiments.jacobian.variation import (
    VERTICES,
    jacobian,
    relative_change,
    twist_in_base_axes,
    variation,
)
from sim import NOMINAL, Hexapod, Pose, forward_kinematics, hexapod, load_model

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
    there = jacobian(machine, struts_m, twist_in_base_axes)
    errors = [np.abs(sum(series[: k + 1]) - there).max() for k in range(7)]
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
        np.testing.assert_allclose(contracted, series[k], atol=1e-12 * float(size(forms[0], "two")))
    np.testing.assert_allclose(forms[2], forms[2].swapaxes(0, 1), atol=1e-16)
    np.testing.assert_allclose(forms[3], forms[3].transpose(2, 0, 1, 3, 4), atol=1e-16)


@given(seed=st.integers(0, 2**32 - 1))
def test_the_estimates_bound_the_taylor_coefficients_everywhere_on_every_ray(seed):
    """At any point of any ray, by the series of the hexapod as it stands there."""
    rng = np.random.default_rng(seed)
    machine, corner = random_hexapod(rng), rng.choice([-1.0, 1.0], 6)
    length_m, stroke_m = rng.uniform(0.05, 0.5), rng.uniform(1e-4, 3e-3)
    scale = np.array([length_m] * 3 + [1.0] * 3)[:, None]
    ray = forward_kinematics(machine, stroke_m * corner * np.linspace(0, 1, 5)[:, None])
    poses = [Pose(R, x) for R, x in zip(ray.rotation, ray.translation_m, strict=True)]
    largest = max(
        size(scale * np.linalg.inv(machine.inverse_jacobian(pose)), "two") for pose in poses
    )
    bounds = certificate._coefficient_bounds(machine, stroke_m, length_m, float(largest))
    for pose in poses:
        series = jacobian_series(seen_from(machine, pose), stroke_m * corner, ORDER + 1)
        for coefficient, bound in zip(series, bounds, strict=True):
            assert size(scale * coefficient, "two") <= bound * (1 + 1e-12)


@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1))
def test_nothing_in_the_box_exceeds_its_certificate(seed):
    rng = np.random.default_rng(seed)
    machine, stroke_m = random_hexapod(rng), rng.uniform(2e-4, 2e-3)
    struts_m = stroke_m * np.vstack([VERTICES, rng.uniform(-1, 1, (50, 6))])
    change = jacobian(machine, struts_m, twist_in_base_axes) - jacobian(
        machine, np.zeros(6), twist_in_base_axes
    )
    taylor = sum(jacobian_series(machine, struts_m, ORDER)[1:])
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
    proof = certify(MACHINE, 0.02, "frobenius")
    assert proof.upper_bound == np.inf


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


def test_jacobian_json_has_what_others_read(jacobian_study):
    np.testing.assert_allclose(jacobian_study["J0"], paper.JACOBIAN, atol=paper.JACOBIAN_TOLERANCE)
    np.testing.assert_allclose(jacobian_study["J0"], J_0, rtol=1e-14)
    assert jacobian_study["condition_number"] == pytest.approx(paper.CONDITION_NUMBER, abs=5e-3)
    assert jacobian_study["J0_from_mjcf_largest_difference"] < 1e-12
    for norm in NORMS:
        one = jacobian_study["variation"][norm]
        assert one["value"] <= one["certified_upper_bound"] < CERTIFICATE_LIMIT * one["value"]
        assert one["paper"] == paper.JACOBIAN_VARIATION[norm]
        at = np.array(one["at_strut_m"])
        assert relative_change(MACHINE, at, norm) == pytest.approx(one["value"], rel=1e-9)
        parts = one["certificate"].values()
        assert sum(parts) == pytest.approx(one["certified_upper_bound"], rel=1e-6)
    assert set(jacobian_study["readings"]) == set(READINGS)
    assert {"experiment", "seed", "versions", "model_sha256"} <= set(jacobian_study)
    errors_m = jacobian_study["newton_error_m"]
    assert errors_m[0] == STROKE_M
    assert errors_m[-1] < 1e-14


def test_no_reading_gives_the_papers_pair_and_the_parts_of_the_stroke_that_would_do(jacobian_study):
    tried = {one["reading"]: one for one in jacobian_study["tried"]}
    assert len(tried) > 20
    assert not any(one["is_the_papers"] for one in tried.values())
    assert "None of the" in jacobian_study["paragraph"]
    low, high = tried["inverse of J"]["stroke_fraction"]
    for part, fits in ((low + high) / 2, True), (0.9 * low, False), (1.1 * high, False):
        e = {n: variation(MACHINE, part * STROKE_M, n, inverse).value for n in NORMS}
        tolerance = paper.JACOBIAN_VARIATION_TOLERANCE
        both = [abs(e[n] - paper.JACOBIAN_VARIATION[n]) < tolerance for n in NORMS]
        assert all(both) == fits
    assert tried["twist, base axes"]["stroke_fraction"] is None
    # Local searches end at corners, all of them above the printed number.
    assert tried["twist; lowest local maximum"]["frobenius"] > 0.0015


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda s: s.update(J0_from_mjcf_largest_difference=1e-6), "MJCF"),
        (lambda s: s["variation"]["two"].update(value=0.004), "two norm"),
        (lambda s: s["variation"]["frobenius"].update(certified_upper_bound=0.0032), "frobenius"),
        (lambda s: s["variation"]["frobenius"].update(certified_upper_bound=None), "None"),
    ],
)
def test_a_study_that_does_not_prove_its_value_is_complained_of(jacobian_study, change, word):
    assert complaint(jacobian_study) is None
    spoilt = deepcopy(jacobian_study)
    change(spoilt)
    assert word in (complaint(spoilt) or "")


def test_all_sixty_four_corners_are_tried():
    assert {tuple(v) for v in VERTICES} == set(product((-1.0, 1.0), repeat=6))
    half = {tuple(v) for v in certificate._VERTICES}
    assert half | {tuple(-np.array(v)) for v in half} == {tuple(v) for v in VERTICES}
