"""Control authority of two hexacopters, as Du, Quan, Yang and Cai (2015) published it."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from tests.published.faces import ARM, LARGEST, ROUNDED, WEIGHT, distances, effectiveness

HOVER = np.array([WEIGHT, 0, 0, 0])
PUBLISHED = {
    "PNPNPN": [1.4861, 0, 0, 0, 0, 0, 0],
    "PPNNPN": [1.1295, 0.7221, 0.4510, 0.4510, 0.7221, 0, 0],
}
"""Authority without failure, and without rotor 1 to 6: arXiv 1403.5986, tables; recalled."""

STANDARD_GRAVITY = 9.80665
SECOND = {
    ("PNPNPN", (), 1.535, ARM): 1.4861,
    ("PNPNPN", (0,), 1.535, ARM): 0,
    ("PPNNPN", (), 1.535, ARM): 1.1295,
    ("PPNNPN", (0,), 1.535, ARM): 0.7213,
    ("PPNNPN", (4,), 1.535, ARM): 0,
    ("PPNNPN", (), 3.535, ARM): 0.1591,
    ("PPNNPN", (), 1.535, 0.475): 1.1903,
}
"""Rotors lost, mass [kg] and arm [m]: AetheriaPackage, Code2021/test/test_hover_controllability.py.

Its gravity is that of its standard atmosphere.
"""


@pytest.mark.parametrize("case", SECOND)
def test_the_authority_is_that_of_a_second_implementation(authority, case):
    turns, lost, mass, arm = case
    result = authority(turns, lost, mass * STANDARD_GRAVITY, arm)
    assert result == pytest.approx(SECOND[case], abs=ROUNDED)


@pytest.mark.parametrize("lost", range(-1, 6))
@pytest.mark.parametrize("turns", PUBLISHED)
def test_the_authority_is_the_published_distance_of_hover_from_every_face(authority, turns, lost):
    """Compare with the paper's formula and with the hull of all extreme thrusts; zero outside."""
    upper = np.where(np.arange(6) == lost, 0.0, LARGEST)
    B = effectiveness(turns)
    hull = ConvexHull([B @ thrusts for thrusts in product(*([0.0, most] for most in upper))])
    by_hull = -(hull.equations[:, :-1] @ HOVER + hull.equations[:, -1]).max()
    by_formula = distances(B, HOVER, np.zeros(6), upper).min()
    assert by_formula == pytest.approx(by_hull, abs=1e-9)
    result = authority(turns, [lost] if lost >= 0 else [])
    assert result == pytest.approx(max(by_formula, 0.0), abs=1e-9)
    assert result == pytest.approx(PUBLISHED[turns][lost + 1], abs=ROUNDED)


@pytest.mark.parametrize(("turns", "lost", "outside"), [("PNPNPN", 0, 0.0), ("PPNNPN", 4, 0.2133)])
def test_a_published_zero_is_hover_on_a_face_or_beyond_one_and_on_the_plane_of_another(
    turns, lost, outside
):
    """Check the authors' toolbox: minus the least |distance| from any plane outside the set."""
    upper = np.where(np.arange(6) == lost, 0.0, LARGEST)
    away = distances(effectiveness(turns), HOVER, np.zeros(6), upper)
    assert away.min() == pytest.approx(-outside, abs=ROUNDED)
    assert np.abs(away).min() == pytest.approx(0, abs=1e-12)
