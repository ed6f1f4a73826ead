"""The other mechanisms of the paper: each file closes, moves, locks and lets go as it says."""

import mujoco
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from experiments import systems
from sim import MODELS, Jacobians, Plant, jacobians, load_model
from sim.mjcf import joint_stiffness, mass_matrix
from tests.project.test_docs import THEORY, markdown_row, unmarked

PERIOD_S = 1e-3
STROKE = 1e-3
"""Size of the motions, [m] or [rad]."""
CLOSURE_LIMIT_M = 1e-7


MECHANISMS = {mechanism.name: mechanism for mechanism in systems.MECHANISMS}
LOOPS = [name for name, it in MECHANISMS.items() if load_model(it.path).neq > len(it.conditions[0])]
"""Those with more equalities than a lock for each actuator."""
EACH = pytest.mark.parametrize("name", MECHANISMS)
EACH_ACTUATOR = pytest.mark.parametrize(
    ("name", "k"),
    [(name, k) for name, it in MECHANISMS.items() for k in range(len(it.conditions[0]))],
)


@pytest.fixture(scope="module")
def models() -> dict[str, mujoco.MjModel]:
    return {name: load_model(it.path) for name, it in MECHANISMS.items()}


def nominal(model: mujoco.MjModel) -> tuple[Jacobians, np.ndarray]:
    """Jacobians at the nominal pose, and an orthonormal basis of its closed motions."""
    jac = jacobians(model, mujoco.MjData(model), "payload", "base")
    return jac, scipy.linalg.null_space(jac.J_C) if len(jac.J_C) else np.eye(model.nv)


def admissible(model: mujoco.MjModel, seed: int) -> np.ndarray:
    """Random displacements of the motors that the loops allow, the largest STROKE."""
    jac, motions = nominal(model)
    free = motions[jac.active] @ np.random.default_rng(seed).normal(size=motions.shape[1])
    return STROKE * free / np.abs(free).max()


def swing(plant: Plant, command: np.ndarray, seconds: float) -> float:
    """Follow the command as a sine of 2 Hz; the largest closure residual on the way."""
    worst = 0.0
    for _ in range(round(seconds / PERIOD_S)):
        plant.step(command * np.sin(4 * np.pi * plant.data.time), PERIOD_S)
        worst = max(worst, plant.closure_residual_m())
    return worst


@EACH
def test_every_number_of_the_file_says_where_it_comes_from(name):
    assert unmarked(MECHANISMS[name].path.read_text()) == []


@EACH
def test_the_nominal_pose_is_closed_and_the_posture_is_baked_in(models, name):
    """Loops closed to round-off, actuated joints at zero, payload axes along those of the base."""
    model, data = models[name], mujoco.MjData(models[name])
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max(initial=0.0) < 1e-12
    np.testing.assert_array_equal(model.qpos0[model.jnt_qposadr[model.actuator_trnid[:, 0]]], 0.0)
    # The wrist angles of the arm are written with thirteen decimals of a degree.
    np.testing.assert_allclose(data.site("payload").xmat, data.site("base").xmat, atol=1e-14)


@EACH
def test_the_mechanism_has_the_freedoms_that_the_theory_page_says(models, name):
    """Freedoms are velocities less the rank of the closures; the motors rule them all."""
    model, task = models[name], MECHANISMS[name].task
    velocities, actuators, freedoms = map(int, markdown_row(THEORY, f"`{name}.xml`")[1].split(","))
    jac, motions = nominal(model)
    assert (model.nv, len(jac.active)) == (velocities, actuators)
    assert {len(condition) for condition in MECHANISMS[name].conditions} == {actuators}
    assert motions.shape[1] == freedoms
    assert np.linalg.matrix_rank(motions[jac.active]) == freedoms
    reach = jac.J_T @ motions
    assert np.linalg.matrix_rank(reach) == len(task)
    np.testing.assert_allclose(np.delete(reach, task, axis=0), 0.0, atol=1e-15)


@pytest.mark.parametrize("name", LOOPS)
def test_no_torque_failure_of_a_loop_leaves_self_motion(models, name):
    """With any one motor limp the others, held, still hold everything, and not by a hair."""
    jac, motions = nominal(models[name])
    for k in range(len(jac.active)):
        held = motions[np.delete(jac.active, k)]
        assert np.linalg.svd(held, compute_uv=False)[-1] > 0.05


def test_the_arm_points_whichever_joint_fails(models):
    """Any one lock leaves both pointing rows; any but the elbow's leaves all six."""
    J = nominal(models["arm"])[0].J_T
    for k in range(7):
        rest = np.delete(J, k, axis=1)
        assert np.linalg.svd(rest[:2], compute_uv=False)[-1] > 0.5
        assert np.linalg.matrix_rank(rest, tol=1e-3) == (5 if k == 3 else 6)


@EACH
def test_servos_are_fast_and_near_critical_damping(models, name):
    """Modes of the closed mechanism on its servos between 10 and 30 Hz, damping 0.5 to 1.5."""
    model = models[name]
    jac, motions = nominal(model)
    gain, damper = np.zeros((2, model.nv))
    gain[jac.active] = model.actuator_gainprm[:, 0]
    damper[jac.active] = -model.actuator_biasprm[:, 2]
    mass = motions.T @ mass_matrix(model, mujoco.MjData(model)) @ motions
    squares, shapes = scipy.linalg.eigh(motions.T @ np.diag(gain) @ motions, mass)
    omega = np.sqrt(squares)
    assert np.all((omega > 2 * np.pi * 10) & (omega < 2 * np.pi * 30))
    damping = np.einsum("ij,i,ij->j", motions @ shapes, damper, motions @ shapes) / (2 * omega)
    assert np.all((damping > 0.5) & (damping < 1.5))


@EACH
@pytest.mark.parametrize("seed", range(3))
def test_the_servos_reach_an_admissible_displacement_with_the_loops_closed(models, name, seed):
    """Settled after 0.3 s; the loops curve by STROKE^2, a thousandth of the motion."""
    plant, command = Plant(models[name]), admissible(models[name], seed)
    for _ in range(300):
        plant.step(command, PERIOD_S)
        assert plant.closure_residual_m() < CLOSURE_LIMIT_M
    assert np.abs(plant.displacements() - command).max() < 0.01 * STROKE


@EACH
def test_the_payload_goes_where_the_jacobians_say(models, name):
    """Displacement of the payload against J_T along the closed motion, to its curvature."""
    model = models[name]
    plant, command = Plant(model), admissible(model, seed=3)
    plant.step(command, 0.3)
    jac, motions = nominal(model)
    rates = np.linalg.lstsq(motions[jac.active], command, rcond=None)[0]
    expected = jac.J_T @ motions @ rates
    pose = plant.pose()
    moved = np.concatenate([Rotation.from_matrix(pose.rotation).as_rotvec(), pose.translation_m])
    for part in (slice(0, 3), slice(3, 6)):
        error = np.linalg.norm(moved[part] - expected[part])
        assert error < 0.02 * np.linalg.norm(expected[part])


@EACH_ACTUATOR
def test_a_joint_locked_in_flight_stays_where_it_is(models, name, k):
    """To a thousandth of the motion, whatever the other servos do."""
    plant, command = Plant(models[name]), admissible(models[name], seed=4)
    swing(plant, command, 0.06)
    plant.lock(k)
    where = plant.displacements()[k]
    for _ in range(100):
        assert swing(plant, command, PERIOD_S) < CLOSURE_LIMIT_M
        assert abs(plant.displacements()[k] - where) < 1e-6


@EACH_ACTUATOR
def test_a_released_joint_feels_no_force(models, name, k):
    """Neither motor nor spring nor damper, while the others work."""
    plant, command = Plant(models[name]), admissible(models[name], seed=5)
    swing(plant, command, 0.06)
    plant.release(k)
    assert swing(plant, command, 0.1) < CLOSURE_LIMIT_M
    dof = nominal(models[name])[0].active[k]
    assert plant.coil_force_n()[k] == plant.data.qfrc_actuator[dof] == 0.0
    assert np.all(np.delete(plant.coil_force_n(), k) != 0.0)
    np.testing.assert_array_equal(plant.data.qfrc_passive, 0.0)
    np.testing.assert_array_equal(joint_stiffness(plant.model), 0.0)


@pytest.mark.parametrize("k", range(7))
def test_a_released_joint_of_the_arm_coasts(models, k):
    """With all others locked its momentum is kept: the locks give way by nanometres only."""
    plant = Plant(models["arm"])
    plant.release(k)
    for other in set(range(7)) - {k}:
        plant.lock(other)
    plant.data.qvel[k] = 1.0
    plant.step(np.zeros(7), 0.2)
    assert plant.data.qvel[k] == pytest.approx(1.0, abs=1e-5)
    assert plant.displacements()[k] == pytest.approx(0.2, abs=1e-5)


def test_the_humanoid_has_29_joints_on_a_floating_base_and_is_its_own_mirror_image():
    model = load_model(MODELS / "humanoid.xml")
    assert (model.nv, model.nu) == (35, 29)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for site in ("foot", "hand"):
        left, right = (data.site(f"{side}_{site}").xpos for side in ("left", "right"))
        np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-12)
    np.testing.assert_allclose(data.subtree_com[0, 1], 0, atol=1e-15)
