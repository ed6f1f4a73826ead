"""The constant Jacobian in closed loop, and three uses of the Jacobian at the present pose."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize

from experiments.jacobian import SCALED_COLUMN, VARIANTS, checks
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.controller import StrutMapping
from fjh.rig.hexapod.curvature import (
    Visited,
    extra_percent,
    follow,
    goal_vector,
    loop_gain_error,
    optimum,
)
from fjh.rig.hexapod.detector import pointing_angles, secondary_motion
from fjh.rig.hexapod.forward import forward_kinematics
from fjh.rig.hexapod.rig import nominal_testbed
from ftc import Goal
from ftc.control import PreviousCommand
from sim import NOMINAL, Plant, load_model

GOALS = {column.name: column.goal for column in COLUMNS}


@cache
def machine():
    return hexapod(load_model())


def circle(radius_rad: float, turns: int = 1) -> np.ndarray:
    """Return a path from the center along alpha, around, and back; shape (T, 2)."""
    out = np.linspace(0, 1, 20)[:, None] * [radius_rad, 0.0]
    angle = np.linspace(0, 2 * np.pi * turns, 199 * turns + 1)
    around = radius_rad * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([out, around, out[::-1]])


def variant(name: str, goal: Goal = GOALS[SCALED_COLUMN]) -> StrutMapping:
    jacobian, form = VARIANTS[name]
    return StrutMapping(machine(), goal, jacobian, form=form)


def excess(name: str, path: np.ndarray, goal: Goal = GOALS[SCALED_COLUMN]) -> float:
    """Return the distance from the optimum in percent, from the geometry alone."""
    return extra_percent(machine(), goal, follow(variant(name, goal), path))


@pytest.mark.parametrize("name", ["W_a", "W_b", "W_d", "W_e"])
def test_the_optimum_is_what_a_general_optimizer_finds(name):
    """SLSQP on the struts with pointing as an equality uses no Jacobian of the library."""
    goal, wanted = GOALS[name], np.array([8e-3, -5e-3])
    best = optimum(machine(), goal, wanted[None])
    free = [k for k in range(6) if k not in goal.locked_at]

    def visited(struts_mm: np.ndarray) -> Visited:
        strut_m = np.zeros((1, 6))
        strut_m[0, free] = 1e-3 * struts_mm
        pose = forward_kinematics(machine(), strut_m)
        secondary = secondary_motion(pose.rotation, pose.translation_m)
        return Visited(strut_m, pointing_angles(pose.rotation), secondary)

    def cost(struts_mm: np.ndarray) -> float:
        return 1e6 * float(np.sum(goal_vector(goal, visited(struts_mm)) ** 2))

    rule = {"type": "eq", "fun": lambda x: 1e3 * (visited(x).pointing_rad[0] - wanted)}
    start = 1e3 * variant("constant", goal).displacements(wanted, NOMINAL)[free]
    options = {"ftol": 1e-10, "maxiter": 200}
    minimum = minimize(cost, start, method="SLSQP", constraints=rule, options=options)
    assert minimum.success
    assert cost(1e3 * best.strut_m[0, free]) == pytest.approx(minimum.fun, rel=1e-3)
    np.testing.assert_allclose(best.pointing_rad[0], wanted, atol=1e-12)
    np.testing.assert_array_equal(best.strut_m[0, list(goal.locked_at)], 0.0)


@pytest.mark.long
def test_the_error_of_a_constant_jacobian_grows_quadratically():
    """A spiral ten times as large has a hundred times the error, ten times the relative one."""
    small, large = (excess("constant", circle(radius)) for radius in (1e-4, 1e-3))
    assert large / small == pytest.approx(10, rel=0.05)


def test_one_gauss_newton_step_a_tick_stays_at_the_optimum():
    """The present Jacobian does so for the least |l| as well: then L = J_m(x)^T lambda."""
    path = circle(1e-2)[::20]
    others = excess("constant", path), excess("analytic", path)
    assert excess("relinearized", path) < 1e-4 * min(others)
    own = GOALS["W_a"]
    assert excess("analytic", path, own) < 1e-4 * excess("constant", path, own)


@pytest.mark.long
@pytest.mark.parametrize("name", ["W_d", "W_e"])
def test_incremental_displacements_drift_by_the_area_that_is_encircled(name):
    """The unmeasured motion does not return to zero: two turns drift twice as far."""
    incremental = variant("incremental", GOALS[name])

    def drift(path: np.ndarray) -> float:
        visited = follow(incremental, np.vstack([path, np.zeros((3, 2))]))
        np.testing.assert_allclose(visited.pointing_rad[-1], 0, atol=1e-10)
        return visited.secondary[-1, 0]

    once = drift(circle(1e-3))
    assert np.abs(once) > 1e-7  # gamma, in rad
    assert drift(circle(1e-3, turns=2)) == pytest.approx(2 * once, rel=0.02)
    assert drift(circle(1e-3) * [1, -1]) == pytest.approx(-once, rel=0.02)
    assert drift(circle(2e-3)) == pytest.approx(4 * once, rel=0.02)
    for steady in ("constant", "analytic", "relinearized"):
        visited = follow(variant(steady, GOALS[name]), np.vstack([circle(1e-3), np.zeros((9, 2))]))
        assert np.abs(visited.strut_m[-1]).max() < 1e-9


def test_all_forms_are_equal_with_a_constant_jacobian():
    """A single step without relinearization is exact up to the square of the tilt."""
    goal, pointing = GOALS["W_e"], np.array([3e-5, -2e-5])
    absolute = StrutMapping(machine(), goal, "constant")
    gauss_newton = StrutMapping(machine(), goal, "constant", form="gauss_newton")
    incremental = StrutMapping(machine(), goal, "constant", form="incremental")
    wanted = absolute.displacements(pointing, NOMINAL)
    before = absolute.displacements(np.array([1e-5, 1e-5]), NOMINAL)
    pose = absolute.estimate(before, NOMINAL)
    again = gauss_newton.displacements(pointing, pose, commanded=before)
    np.testing.assert_allclose(again, wanted, rtol=1e-5)
    last = PreviousCommand(np.array([1e-5, 1e-5]), before, np.zeros(6))
    further = incremental.displacements(pointing, NOMINAL, last=last)
    np.testing.assert_allclose(further, wanted, atol=1e-18)
    for form, missing in ((incremental, "last"), (gauss_newton, "commanded")):
        with pytest.raises(ValueError, match=f'{missing} must be given with form "{form.form}"'):
            form.displacements(pointing, NOMINAL)


def test_the_loop_gain_error_is_the_slope_of_pointing_by_command():
    constant = variant("constant")
    strut_m = np.random.default_rng(5).uniform(-3e-3, 3e-3, (1, 6))
    step = 1e-7 * constant.major_gain().T
    ahead, behind = (forward_kinematics(machine(), strut_m + each) for each in (step, -step))
    slope = (pointing_angles(ahead.rotation) - pointing_angles(behind.rotation)) / 2e-7
    error = np.linalg.norm(slope.T - np.eye(2), 2)
    # Rates of the two angles are those of the twist up to the tilt squared.
    assert loop_gain_error(constant, strut_m) == pytest.approx(error, rel=0.2)
    assert loop_gain_error(constant, np.zeros((1, 6))) < 1e-12


def test_a_scaled_machine_differs_only_in_strokes_and_coils():
    testbed = nominal_testbed()
    scaled, model = testbed.scaled(stroke=100, spiral=300), testbed.model
    assert scaled.bench.spiral_radius_urad == 300 * testbed.bench.spiral_radius_urad
    assert scaled.bench.amplifier_limit_a == 100 * testbed.bench.amplifier_limit_a
    np.testing.assert_array_equal(scaled.model.jnt_stiffness, model.jnt_stiffness)
    plant = Plant(scaled.model)
    plant.step(0.01 * np.eye(6)[0], 1.0)
    assert plant.displacements()[0] == pytest.approx(0.01, rel=0.01)
    assert model.jnt_range[model.actuator_trnid[0, 0], 1] < 1e-3  # the original is unchanged


@pytest.mark.parametrize(
    ("row", "column", "value", "word"),
    [
        (0, "closure_residual_max_m", 2e-8, "closure residual over the size of the spiral"),
        (-4, "static_extra_percent", 1.0, "of geometry and floor is 0.87"),
    ],
)
def test_an_invalid_loop_fails_a_check(jacobian_study, row, column, value, word):
    names = "tried", "variation", "runs", "costs"
    tables = {name: pd.DataFrame(jacobian_study[name]) for name in names}
    runs = tables["runs"]
    runs.loc[runs.index[row], column] = value
    (sentence,) = [str(check) for check in checks(tables, 0.0) if not check.passed]
    assert word in sentence
