"""Tests of the study `force`: forces on a fixture, and against external loads."""

from functools import cache

import mujoco
import numpy as np
import pytest

from experiments import force
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from prioritized import force_mapping
from sim import HEXAPOD_MJCF, NOMINAL, Plant, load_model


@pytest.fixture(scope="module")
def tables(study):
    return study.tables


@pytest.fixture(scope="module")
def data(study):
    return study.arrays("force.npz")


@cache
def rig() -> mujoco.MjModel:
    return force.with_fixture(HEXAPOD_MJCF)


@pytest.fixture(scope="module")
def lines():
    """Matrix A of l_dot = A v in closed form: rows are the struts' lines, f = A^T strut forces."""
    return hexapod(load_model()).inverse_jacobian(NOMINAL)


def test_the_fixture_measures_the_wrench_on_the_payload():
    """The gauge is tested with a known wrench, without torques."""
    plant, wrench = Plant(rig()), np.array([1.0, -2.0, 3.0, 10.0, 20.0, -15.0])
    plant.data.eq_active[plant.model.equality(force.FIXTURE).id] = True
    gauges = force.Gauges(plant)
    plant.settle(0.05)
    before = gauges.read()[:6]
    plant.push(wrench)
    plant.step(np.zeros(6), 0.05)
    # The payload moves by nanometres, and the springs bear this share.
    np.testing.assert_allclose(gauges.read()[:6] - before, wrench, rtol=2e-4)


@pytest.mark.long
def test_strut_forces_balance_the_external_wrench_with_and_without_coils(lines):
    """Six forces along six lines balance a load uniquely, by springs or coils."""
    wrench = np.array([[1.0, -2.0, 0.5, 10.0, 5.0, -15.0]])
    by_springs = force.simulate_load(rig(), (), np.zeros((1, 6)), wrench).strut_n[:, -1]
    by_coils = force.simulate_load(rig(), (), np.linalg.solve(lines.T, wrench.T).T, wrench).strut_n[
        :, -1
    ]
    # The payload moves against springs, and the flexures bear 0.2 %.
    np.testing.assert_allclose(by_springs @ lines, wrench, rtol=5e-3)
    np.testing.assert_allclose(by_coils @ lines, wrench, rtol=1e-4)


def test_simulated_forces_equal_those_of_the_mapping(tables):
    theorems = tables["theorems"]
    assert list(theorems.kind.fillna("healthy").unique()) == ["healthy", "locked", "free", "loose"]
    assert list(theorems.theorem) == 4 * [7, 8, 9]
    assert theorems.pressed_off_percent.max() < 0.02
    assert theorems.held_off_percent.max() < 0.002
    assert theorems.moved_percent.max() < 0.005
    assert theorems[theorems.kind != "locked"].pressed_major_off_percent.max() < 0.005
    loads = tables["prescribed"].set_index("condition").loc[["healthy", "strut 1 locked"]]
    missing = loads[["lacking_force_n", "lacking_major_n_m"]]
    np.testing.assert_allclose(missing, 0, atol=1e-12)  # all components of its wrench act


def test_a_locked_strut_bears_the_force_along_it_which_no_torque_affects(data, lines):
    """The reaction under load is J_1^T f; on the fixture, both share the coils' wrench."""
    system, unseen = force.failed_system(force.Condition("locked")), None
    for theorem in (7, 8, 9):
        part = f"strut_1_locked_theorem_{theorem}"
        torques, wrench, strut = (data[f"{part}_{k}"] for k in ("torques_n", "wrench", "strut_n"))
        reaction = data[f"{part}_held_lock_n"][:, -1, 0]
        np.testing.assert_allclose(strut[:, 0], wrench @ np.linalg.inv(lines)[:, 0])
        np.testing.assert_allclose(reaction, strut[:, 0], atol=1e-3)
        assert np.abs(reaction).max() > 5.0
        assert (torques[:, 0] == 0).all()
        unseen = np.eye(6) - force.solve_theorem(system, theorem, data["asked_wrench"]).span
        np.testing.assert_allclose(lines[0] @ unseen, lines[0], atol=1e-12)
        assert np.trace(unseen) == pytest.approx(1.0)
        fixture, lock = (data[f"{part}_pressed_{k}"][:, -1] for k in ("fixture", "lock_n"))
        np.testing.assert_allclose(fixture - lock[:, :1] * lines[0], torques @ lines, atol=5e-3)
        assert np.abs(lock[:, 0] - strut[:, 0]).max() > 3.0


def test_a_free_strut_bears_no_force_and_the_missing_force_moves_the_payload(tables, data, lines):
    """The secondary deficit of eq. (9) translates the payload; the elastic mapping rotates it."""
    for theorem in (7, 8, 9):
        part = f"strut_1_free_theorem_{theorem}"
        along = data[f"{part}_wrench"] @ np.linalg.inv(lines)[:, 0]
        np.testing.assert_allclose(along, 0, atol=1e-12)
        np.testing.assert_allclose(data[f"{part}_held_strut_n"][:, -1, 0], 0, atol=1e-3)
    loads = tables["prescribed"].set_index(["condition", "mapping"]).loc["strut 1 free"]
    rigid, elastic = loads.loc["rigid"], loads.loc["elastic"]
    assert (rigid.lacking_major_n_m < 1e-12).all()
    assert (rigid.simulated_translation_um > 20).all()
    assert (rigid.simulated_pointing_urad < 0.5).all()
    assert (elastic.simulated_pointing_urad > 50).all()
    for mapping in ("rigid", "elastic"):
        part = f"strut_1_free_prescribed_{mapping}"
        simulated = data[f"{part}_displacement"][:, -1]
        np.testing.assert_allclose(simulated, data[f"{part}_predicted"], atol=0.5e-6)


def test_without_eq_9_a_free_strut_changes_the_major_force(data):
    """Theorem 8 as printed is applied to a mechanism with self-motion, which section 3 excludes."""
    condition, targets = force.Condition("free", 0), data["asked_wrench"][:, MAJOR]
    kin = force.failed_system(condition).kinematics()
    printed = force_mapping(kin.J, MAJOR, SECONDARY, np.array(force.W3_HOT)[kin.actuators])
    torques = kin.expand(printed(targets))
    off = force.simulate_load(rig(), condition.failures, torques).fixture[:, -1, MAJOR] - targets
    difference_percent = 100 * np.linalg.norm(off, axis=1) / np.linalg.norm(targets, axis=1)
    assert [round(difference_percent.min()), round(difference_percent.max())] == [39, 96]


def test_the_platform_uses_internal_force_and_exerts_the_same_wrench(tables, data):
    """The cost grows with other internal forces, and without one."""
    kin = force.healthy_system(force.PLATFORM_MJCF, force.PLATFORM_TASK).kinematics()
    C = kin.active_constraint[0]
    weights = dict(enumerate(np.ones((4, 4)) + (force.HOT - 1) * np.eye(4)))
    uses = {f"motor_{k + 1}_hot": (W3, np.zeros(4)) for k, W3 in weights.items()}
    for name, (W3, near) in (
        uses | {"squeezed": (np.ones(4), force.SQUEEZE_N * np.sign(C))}
    ).items():
        best = data[f"platform_{name}_used_torques_n"] - near
        for eta in np.linspace(-60, 60, 25):
            cost = [np.linalg.norm(tau * W3, axis=1) for tau in (best, best + eta * C)]
            assert (cost[0] <= cost[1] + 1e-9).all()
        fixtures = (f"platform_{name}_{case}_fixture" for case in ("without", "used"))
        np.testing.assert_allclose(*(data[case][:, -1] for case in fixtures), atol=1e-3)
    by_use = tables["internal_force"].set_index("internal_force")
    without, used = (by_use.loc[case].set_index("name") for case in ("without", "used"))
    assert (without.internal_rms_n < 1e-9).all()
    np.testing.assert_allclose(used.internal_simulated_rms_n, used.internal_rms_n, rtol=1e-4)
    assert (used.weighed_rms_n < 0.9 * without.weighed_rms_n).all()
    assert (used.hot_motor_rms_n / without.hot_motor_rms_n).max() < 0.5
    assert without.least_squeeze_n["squeezed"] < 0 < used.least_squeeze_n["squeezed"]
