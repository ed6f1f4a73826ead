"""Accuracy of the geometry: what the numbers of a model show of it, and the verdicts it decides."""

import copy

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from prioritized import ConstrainedSystem
from sim import Jacobians, jacobians
from tests.three_rrr import EXACT, six_digits, taken, three_rrr


def verdict(jac: Jacobians, accuracy: float | None = None) -> tuple[int, int, int]:
    """Numbers of self-motions and of constraints on the actuators, and the rank of J.

    With the tolerance 1e-10, unless the accuracy of the geometry is stated.
    """
    system = ConstrainedSystem(jac.J_T, jac.J_C, jac.active, geometry_accuracy=accuracy)
    kin = system.kinematics()
    rank = np.linalg.matrix_rank(kin.J, tol=1e-5 * float(np.linalg.norm(jac.J_T)))
    return kin.self_motion.shape[1], len(kin.active_constraint), int(rank)


def skewed(size: float, seed: int) -> np.ndarray:
    """Every axis off by some such angle."""
    axes = np.tile([0.0, 0.0, 1.0], (7, 1))
    axes[:, :2] = size * np.random.default_rng(seed).uniform(-1.0, 1.0, size=(7, 2))
    return axes


def test_exact_numbers_show_no_rounding():
    jac = taken(three_rrr())
    assert jac.geometry_accuracy < 1e-15
    assert verdict(jac) == EXACT


def test_numbers_of_six_digits_show_their_rounding():
    """Half a unit in the last digit, by the largest length: 0.5 to 5 times 1e-6."""
    assert 4e-7 < taken(three_rrr(six_digits)).geometry_accuracy < 5.1e-6


@pytest.mark.parametrize("component", range(7))
def test_one_component_that_should_be_zero_shows_the_rounding(component):
    axes = np.tile([0.0, 0.0, 1.0], (7, 1))
    axes[component, 0] = 1e-8
    assert 1e-8 <= taken(three_rrr(axes=axes)).geometry_accuracy < 1.001e-8


@pytest.mark.parametrize("gap", [1e-9, 1e-6, 5e-4])
def test_a_gap_shows_by_the_size_of_the_constraints(gap):
    model = three_rrr()
    model.eq_data[0, 2] += gap
    jac = taken(model)
    assert jac.closure_residual == pytest.approx(gap, rel=1e-6)
    shown = jac.geometry_accuracy * float(np.linalg.norm(jac.J_C))
    assert shown == pytest.approx(0.1 * gap, rel=1e-6)  # ten times this counts as zero
    assert jac.accuracy is not None
    assert jac.accuracy.J_C_error.max() == pytest.approx(gap, rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_with_the_accuracy_that_the_model_shows_skew_axes_change_no_verdict(seed):
    """Off by 1e-8, without it, the loops seem to hold the machine."""
    jac = taken(three_rrr(axes=skewed(1e-8, seed)))
    assert jac.geometry_accuracy > 1e-9
    assert verdict(jac, jac.geometry_accuracy) == EXACT
    assert verdict(jac)[1] > 0


def test_rounding_that_a_rotation_hides_must_be_stated_by_hand():
    """Turned any way, every axis has components of size 1 in full precision, which show nothing."""
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    jac = taken(three_rrr(axes=skewed(1e-8, seed=0), turn=turn))
    assert jac.geometry_accuracy < 1e-15
    assert verdict(jac)[1] > 0
    assert verdict(jac, 1e-8) == EXACT
    assert verdict(taken(three_rrr(turn=turn))) == EXACT


# A parallelogram on a hinged base, closed by a connect.
FOUR_BAR = """
<mujoco>
  <option><flag contact="disable"/></option>
  <worldbody>
    <body name="base">
      {base}<geom size="0.05"/>
      <body name="crank" pos="0.1 0.02 0">
        <joint name="crank" axis="0 0 1"/><geom size="0.05"/>
        <body name="coupler" pos="0.1 0.3 0">
          <joint name="knee" axis="0 0 1"/><geom size="0.05"/><site name="tool" pos="0.2 0.1 0.05"/>
          <body name="rocker" pos="0.5 0 0">
            <joint name="elbow" axis="0 0 1"/><geom size="0.05"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect body1="rocker" body2="base" anchor="-0.1 -0.3 0"/></equality>
  <actuator><motor joint="crank"/>{driven}</actuator>
</mujoco>
"""
BASE = '<joint name="base" axis="0.3 -0.5 0.8" pos="0.2 0.1 -0.3"/>'
DRIVEN = '<motor joint="base"/>'


def four_bar(base: str = "", driven: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(FOUR_BAR.format(base=base, driven=driven))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("gap", [1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize(
    ("mechanism", "expected"),
    [
        (four_bar(BASE), (1, 0, 1)),
        (four_bar(BASE, DRIVEN), (0, 0, 2)),
        (three_rrr(base=BASE), (1, 0, 3)),
        (three_rrr(base=BASE, driven=DRIVEN), (0, 0, 4)),
    ],
    ids=["four-bar", "four-bar, base driven", "3-RRR", "3-RRR, base driven"],
)
def test_no_gap_of_a_loop_changes_a_verdict(mechanism, expected, gap, axis):
    """Rows taken at two points, that far apart, would make constraints of redundant ones."""
    model = copy.copy(mechanism)
    model.eq_data[-1, axis] += gap
    jac = jacobians(model, mujoco.MjData(model), "tool", closure_tolerance=2e-3)
    assert jac.closure_residual == pytest.approx(gap, rel=1e-3)
    assert verdict(jac) == expected
