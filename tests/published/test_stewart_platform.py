"""Compare with a Stewart platform of T. Dehaeze, stewart-simscape, built from his parameters."""

from itertools import product

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from fjh.rig import Rig
from sim import Failure
from tests.published import stewart_platform as platform

MODES_HZ = [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.6]
"""Modal frequencies: org/identification.org, modal analysis; to 0.05."""
DAMPING_PERCENT = [0.4, 0.3, 0.3, 0.3, 0.2, 0.2]
"""Damping ratios of the same table, modes 1 to 6; to 0.05, in reverse order."""
COMPLIANCE = [5.1863e-6, 5.1863e-6, 1.7073e-6, 4.75e-8, 4.75e-8, 2.099e-8]
COUPLING = 3.2093e-7
"""org/control-tracking.org, inv(stewart.kinematics.K), here [rotation; translation]: its diagonal,
and the size of its other elements that are not zero."""
STROKES_UM = [76.1, 177.2]
MOBILITY_UM = 31.5
"""Mobility: org/kinematic-study.org, required stroke; to 0.05. The last one is mistaken."""
STIFFNESS, DAMPING, ROD, DISC = 2e7, 20.0, 0.1, 1.0
"""Strut stiffness [N/m] and damping [N s/m]; masses of each strut half and of the disc [kg]."""
BALL = 1000 * 4 / 3 * np.pi * 1e-9
"""Mass of each of six balls of 1 mm radius [kg], the default of the Simscape blocks."""


@pytest.fixture(scope="module")
def strut_jacobian():
    """Return rates of the struts per [angular; linear] velocity of B, from the joints alone."""
    foot, arm = platform.foot, platform.head - [0, 0, 0.135]
    along = platform.head - foot
    along /= np.linalg.norm(along, axis=1)[:, None]
    return np.hstack([np.cross(arm, along), along])


def cylinder(mass: float, radius: float, length: float) -> np.ndarray:
    """Return moments of inertia [kg m^2] across, across and along."""
    across = mass * (3 * radius**2 + length**2) / 12
    return np.array([across, across, mass * radius**2 / 2])


def velocity_at(point: np.ndarray) -> np.ndarray:
    """Return velocity of a point of the disc [m] from B per twist of B, shape (3, 6)."""
    return np.hstack([np.cross(np.eye(3), point).T, np.eye(3)])


def mass_at_b() -> np.ndarray:
    """Return the mass matrix at B of disc, balls and both halves of struts."""
    disc = velocity_at(np.array([0, 0, -0.05]))
    M = DISC * disc.T @ disc
    M[:3, :3] += np.diag(cylinder(DISC, 0.1, 0.01))
    for foot, head in zip(platform.foot, platform.head, strict=True):
        v, length = velocity_at(head - [0, 0, 0.135]), np.linalg.norm(head - foot)
        s = (head - foot) / length
        along, turning = np.outer(s, s), (np.eye(3) - np.outer(s, s)) / length
        inertia = cylinder(ROD, 0.005, 0.05)[0]
        lower, upper = 0.025 * turning, along + (length - 0.025) * turning
        per_head = ROD * (lower.T @ lower + upper.T @ upper) + 2 * inertia * turning.T @ turning
        M += v.T @ (BALL * np.eye(3) + per_head) @ v
    return M


def test_the_modes_are_the_published_ones_and_those_of_lagranges_equations(strut_jacobian):
    result = np.array([mode.imag for mode in platform.modes]) / (2 * np.pi)
    np.testing.assert_allclose(result, MODES_HZ, atol=0.05)
    K = STIFFNESS * strut_jacobian.T @ strut_jacobian
    undamped = np.sqrt(eigh(K, mass_at_b(), eigvals_only=True))
    np.testing.assert_allclose(np.abs(platform.modes), undamped, rtol=1e-7)


def test_the_damping_ratios_are_the_published_ones_in_reverse():
    """Check damping in proportion to stiffness: a ratio grows as its frequency."""
    result = [-100 * mode.real / abs(mode) for mode in platform.modes]
    expected = [100 * abs(mode) * DAMPING / STIFFNESS / 2 for mode in platform.modes]
    np.testing.assert_allclose(result, expected, rtol=1e-5)
    np.testing.assert_allclose(result[::-1], DAMPING_PERCENT, atol=0.05)
    assert not np.allclose(result, DAMPING_PERCENT, atol=0.05)


def test_the_compliance_is_the_published_one(strut_jacobian):
    J = platform.kin.J
    result = J @ J.T / STIFFNESS
    np.testing.assert_allclose(np.diag(result), COMPLIANCE, rtol=5e-5)
    coupled = np.abs(result[[0, 1], [4, 3]])
    np.testing.assert_allclose(coupled, COUPLING, rtol=5e-5)
    K = STIFFNESS * strut_jacobian.T @ strut_jacobian
    np.testing.assert_allclose(result, np.linalg.inv(K), atol=1e-9 * COMPLIANCE[0])


def test_the_strokes_are_the_published_ones_by_exact_inverse_kinematics():
    """Check the 25 of 32 corners of the box in the source, which contain the extremes."""
    need = np.abs(platform.need)
    strokes = 2 * need.max(), 2 * need.sum(axis=1).max()
    np.testing.assert_allclose(strokes, STROKES_UM, atol=0.05)
    foot, head, B = platform.foot, platform.head, np.array([0, 0, 0.135])
    others = np.linalg.norm(head - foot, axis=1)
    lengths = []
    for *shift, about_x, about_y in product((-1, 1), repeat=5):
        turn = Rotation.from_euler("xyz", [3e-5 * about_x, 3e-5 * about_y, 0])
        there = turn.apply(head - B) + B + 5e-5 * np.array(shift)
        lengths.append(np.linalg.norm(there - foot, axis=1) - others)
    for count in (25, 32):
        assert 1e6 * np.ptp(lengths[:count]) == pytest.approx(strokes[1], abs=1e-3)


def test_the_mobility_divides_by_the_change_of_length_and_the_published_one_multiplies():
    along = platform.head - platform.foot
    along /= np.linalg.norm(along, axis=1)[:, None]
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 50), np.linspace(0, 2 * np.pi, 50))
    methods = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1
    )
    change = np.abs(methods @ along.T).max(axis=-1)
    assert (50.0 * change).min() == pytest.approx(MOBILITY_UM, abs=0.05)
    set_of_translations = platform.upright.kinematics().attainable([0, 1, 2], (-50, 50))
    assert set_of_translations.radius == pytest.approx(50.0, abs=1e-9)
    assert (50.0 / change).min() == pytest.approx(50.0, abs=0.01)
    # No larger ball is possible, since each strut bounds translations along itself.
    np.testing.assert_allclose(set_of_translations.support(along), 50.0, atol=1e-9)


STIFF_LOOPS = """<default><equality solref="1e-4 1" solimp="0.9999 0.9999"/></default>
<option integrator="implicitfast" timestep="5e-5" jacobian="dense"/>"""
"""Solver parameters for loops much stiffer than the struts, unlike MuJoCo's defaults."""


@pytest.mark.long
def test_the_platform_follows_a_circle_while_a_strut_locks(tmp_path):
    """Check three translations with five struts, diagnosed with the file alone."""
    file = tmp_path / "stewart.xml"
    file.write_text(platform.mjcf.replace("<worldbody>", STIFF_LOOPS + "<worldbody>"))
    rig = Rig.of_mjcf(file, site="B", major=[3, 4, 5])
    path = rig.path("circle", duration_s=1.4)
    run = rig.fly(rig.supervisor(), path, failures=[Failure("strut1", "locked", 0.9)])
    (listed,) = run.diagnoses
    assert (listed.actuator, listed.kind) == ("strut1", "locked") and listed.time_s < 1.1
    assert run.closure_m.max() < 1e-7
    error = np.linalg.norm(run.desired - run.true, axis=1) / rig.size
    before, after = error[run.time_s < 0.9], error[run.time_s > listed.time_s + 0.1]
    assert np.sqrt((before**2).mean()) < 0.01
    assert np.sqrt((after**2).mean()) < 0.02
