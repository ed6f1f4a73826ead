"""Physics of the plant, one sentence each."""

import copy

import mujoco
import numpy as np
import pytest
import scipy.linalg

from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.controller import nominal_loops
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.study.workers import in_parallel
from sim import HEXAPOD_MJCF, ModelError, Plant, SimulationDiverged, linearize, load_model
from tests.closed_form import closed_form, modes_of

PERIOD_S = 1e-3
STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


def swing(plant: Plant, seconds: float) -> list[float]:
    """Drive all struts by 20 um at 0.5 Hz, each at its own phase; closure residuals by tick."""
    residuals = []
    for _ in range(round(seconds / PERIOD_S)):
        time_s = plant.data.time
        fade_in = min(1.0, time_s / 0.5)
        plant.step(2e-5 * fade_in * np.sin(np.pi * time_s + np.arange(6)), PERIOD_S)
        residuals.append(plant.closure_residual_m())
    return residuals


def edited(*replacements: tuple[str, str]) -> mujoco.MjModel:
    """The hexapod with its MJCF text changed: how a check is shown to fail."""
    text = HEXAPOD_MJCF.read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    return mujoco.MjModel.from_xml_string(text)


def test_preload_holds_the_payload_at_the_nominal_pose_against_gravity(model):
    plant = Plant(model)
    plant.settle(2.0)
    assert np.abs(plant.pose().translation_m).max() < 1e-7
    assert np.abs(plant.displacements()).max() < 1e-7
    # It can fail: without preload the payload hangs low.
    limp = Plant(edited(('springref="1.4939740e-4"', 'springref="0"')))
    limp.settle(2.0)
    assert np.abs(limp.pose().translation_m).max() > 1e-4


def test_the_preload_in_the_file_is_the_one_that_static_balance_asks_for(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    strut = [model.joint(f"strut{k}") for k in range(1, 7)]
    slides = np.zeros((model.nv, 6))
    slides[[joint.dofadr[0] for joint in strut], range(6)] = 1.0
    J_C = data.efc_J.reshape(-1, model.nv)
    forces = np.hstack([slides, J_C.T])
    balance = np.linalg.lstsq(forces, data.qfrc_bias, rcond=None)[0]
    np.testing.assert_allclose(forces @ balance, data.qfrc_bias, atol=1e-10)
    stiffness = model.jnt_stiffness[[joint.id for joint in strut]]
    preload = model.qpos_spring[[joint.qposadr[0] for joint in strut]]
    np.testing.assert_allclose(preload, balance[:6] / stiffness, rtol=1e-7)


def test_the_centre_of_mass_of_payload_and_tips_is_the_payload_origin(model):
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ids = [model.body("payload").id, *(model.body(f"tip{k}").id for k in range(1, 7))]
    mass = model.body_mass[ids]
    centre = mass @ data.xipos[ids] / mass.sum()
    np.testing.assert_allclose(centre, data.site("payload").xpos, atol=1e-9)


def payload_displacement(model: mujoco.MjModel, wrench: np.ndarray) -> np.ndarray:
    """Where the payload comes to rest under a wrench [torque; force] at its origin, world axes."""
    plant = Plant(model)
    payload = model.body("payload").id
    # MuJoCo applies the force at the centre of mass of the body.
    lever = plant.data.xipos[payload] - plant.data.xpos[payload]
    torque = wrench[:3] - np.cross(lever, wrench[3:])
    plant.data.xfrc_applied[payload] = [*wrench[3:], *torque]
    plant.settle(1.5)
    change = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, change, 1.0, model.qpos0, plant.data.qpos)
    moved = change[model.joint("payload").dofadr[0] :][:6]
    return np.concatenate([moved[3:], moved[:3]])


def test_stiffness_at_the_payload_is_that_of_the_springs_through_the_jacobian(model):
    """A small wrench moves the payload by (A^T k A)^-1 w; flexures add half a per cent."""
    oracle = closed_form(model)
    springs = oracle.A.T @ oracle.A * model.joint("strut1").stiffness[0]
    unloaded = payload_displacement(model, np.zeros(6))
    size = np.array([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    moved = [payload_displacement(model, wrench) - unloaded for wrench in np.diag(size)]
    measured = np.linalg.inv(np.array(moved).T / size)
    # Lengths as of the strut put rotation and translation in one unit.
    unit = np.diag([1 / 0.4064] * 3 + [1.0] * 3)
    measured, springs, full = (unit @ K @ unit for K in (measured, springs, oracle.K))
    assert np.linalg.norm(measured - springs) < 5e-3 * np.linalg.norm(springs)
    assert np.linalg.norm(measured - full) < 1e-3 * np.linalg.norm(full)


def test_modes_of_the_linearized_plant_are_those_of_the_closed_form(model):
    plant = Plant(model)
    frequency, damping = modes_of(linearize(plant.model, plant.data).A)
    expected_frequency, expected_damping = closed_form(model).modes()
    # 0.05 % off, both.
    np.testing.assert_allclose(frequency, expected_frequency, rtol=1e-3)
    np.testing.assert_allclose(damping, expected_damping, rtol=1e-3)


def test_the_strut_mass_term_is_needed(model):
    """Without strut mass in the closed form the modes come out more than 1 % too high."""
    light = copy.copy(model)
    for part in ("housing", "stem"):
        for k in range(1, 7):
            light.body_mass[model.body(f"{part}{k}").id] = 0.0
            light.body_inertia[model.body(f"{part}{k}").id] = 0.0
    assert np.all(closed_form(light).modes()[0] > 1.01 * closed_form(model).modes()[0])


def ring_down(model: mujoco.MjModel, shape: np.ndarray, seconds: float) -> np.ndarray:
    """Free motion after a velocity along one mode, seen along that mode; shape (N,)."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qvel[:] = shape * 1e-3
    samples = []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        change = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, change, 1.0, model.qpos0, data.qpos)
        samples.append(shape @ change)
    return np.array(samples)


ENERGY_J = 5e-6


def mode_shapes(model: mujoco.MjModel) -> np.ndarray:
    """Generalized velocities of the six undamped modes, orthonormal on the loops, shape (6, nv)."""
    plant = Plant(model)
    lin = linearize(plant.model, plant.data)
    stiffness = -lin.A[6:, :6]
    values, vectors = map(np.real, np.linalg.eig(stiffness))
    Z = _null_space(plant)
    order = np.argsort(values)
    return (Z @ vectors[:, order]).T


def _null_space(plant: Plant) -> np.ndarray:
    return scipy.linalg.null_space(plant.data.efc_J.reshape(-1, plant.model.nv))


def pole_of(samples: np.ndarray, dt: float) -> complex:
    """Continuous pole of a decaying oscillation: y[k+1] = a y[k] + b y[k-1] fitted."""
    history = np.column_stack([samples[1:-1], samples[:-2]])
    a, b = np.linalg.lstsq(history, samples[2:], rcond=None)[0]
    return np.log(complex(max(np.roots([1.0, -a, -b]), key=np.imag))) / dt


def test_a_simulated_ring_down_shows_the_damping_of_the_closed_form(model):
    """Damping is the model's: what the integrator adds stays within a per cent."""
    frequency, damping = closed_form(model).modes()
    for k, shape in enumerate(mode_shapes(model)):
        pole = pole_of(ring_down(model, shape, 0.3), model.opt.timestep)
        assert abs(pole) / (2 * np.pi) == pytest.approx(frequency[k], rel=0.01)
        assert -pole.real / abs(pole) == pytest.approx(damping[k], rel=0.01)


def test_the_ring_down_check_sees_the_damping_that_a_discrete_integrator_adds():
    model = edited(('integrator="Euler"', 'integrator="discrete"'))
    _, damping = closed_form(model).modes()
    pole = pole_of(ring_down(model, mode_shapes(model)[3], 0.3), model.opt.timestep)
    assert -pole.real / abs(pole) > 1.1 * damping[3]


def test_all_velocities_are_one_island_so_that_looking_for_islands_changes_no_bit(model):
    """With a strut locked and another without force as well; the file switches the search off."""
    sought = edited((' island="disable"', ""))
    ends = []
    for each in (model, sought):
        plant = Plant(each)
        plant.step(np.linspace(-1e-4, 1e-4, 6), 0.01)
        plant.lock(0)
        plant.release(3)
        plant.step(np.linspace(2e-4, -1e-4, 6), 0.05)
        ends.append(state := np.empty(mujoco.mj_stateSize(plant.model, STATE)))
        mujoco.mj_getState(plant.model, plant.data, state, STATE)
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("mode", range(6))
def test_with_damping_off_energy_is_kept_at_every_step(model, mode):
    """Two seconds of each mode, within one per cent of the energy put in."""
    settled = Plant(model)
    settled.settle(2.0)
    undamped = settled.model
    undamped.dof_damping[:] = 0.0
    undamped.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = settled.data
    data.qvel[:] = 0.0
    mujoco.mj_forward(undamped, data)
    rest = data.energy[0]
    shape, momentum = mode_shapes(model)[mode], np.empty(model.nv)
    mujoco.mj_mulM(undamped, data, momentum, shape)
    # Equal modes have no shape of their own: the energy put in does not depend on the one taken.
    data.qvel[:] = shape * np.sqrt(2.0 * ENERGY_J / (shape @ momentum))

    energy = []
    for _ in range(round(2.0 / undamped.opt.timestep)):
        before = data.qvel.copy()
        mujoco.mj_step(undamped, data)  # data.energy[0] is of the position it started from
        centred = (before + data.qvel) / 2
        # Positions and velocities of semi-implicit Euler stand half a step apart.
        mujoco.mj_mulM(undamped, data, momentum, centred)
        energy.append(data.energy[0] - rest + centred @ momentum / 2)
    np.testing.assert_allclose(energy, energy[0], rtol=0.01)
    assert energy[0] == pytest.approx(ENERGY_J, rel=0.01)


def test_halving_the_time_step_changes_no_rms_error_by_more_than_a_hundredth_of_a_percent(
    model, table1
):
    columns = [c for c in COLUMNS if c.name in ("W_a", "W_e", "W_a_uncorrected")]
    half = copy.copy(model)
    half.opt.timestep /= 2
    testbed = Testbed(half, TestbedConfig(), nominal_loops(model, TestbedConfig()))
    # The constant Jacobian is cheaper, and moves no RMS by more than 5e-5 urad.
    rig, path = hexapod_rig(testbed), testbed.bench.spiral_rad()
    calls = [
        {"controller": rig.controller(c.goal), "path": path, "failures": c.failures}
        for c in columns
    ]
    runs = in_parallel(rig.fly, calls, lambda done, total: None)
    for column, run in zip(columns, runs, strict=True):
        assert run.closure_max_m < CLOSURE_LIMIT_M
        told = table1["by_name"][column.name]
        whole = [told[f"{angle}_rms_urad"] for angle in ("alpha", "beta")]
        np.testing.assert_allclose(1e6 * run.rms(), whole, rtol=1e-4)
        # Another step is another run: the comparison is not one of a run with itself.
        assert np.abs(1e6 * run.rms() - whole).min() > 0


@pytest.mark.parametrize("strut", range(6))
def test_a_strut_locked_in_flight_stays_where_it_is_and_the_loops_stay_closed(model, strut):
    plant = Plant(model)
    residuals = swing(plant, 0.8)
    plant.lock(strut)
    where = plant.displacements()[strut]
    assert abs(where) > 1e-6, "the lock must be off centre to be a test"
    for _ in range(700):
        residuals += swing(plant, PERIOD_S)
        assert abs(plant.displacements()[strut] - where) < 1e-7
    assert max(residuals) < CLOSURE_LIMIT_M


@pytest.mark.parametrize("strut", range(6))
def test_a_coil_switched_off_in_flight_carries_no_current(model, strut):
    plant = Plant(model)
    residuals = swing(plant, 0.7)
    assert abs(plant.coil_force_n()[strut]) > 0.1
    plant.release(strut)
    residuals += swing(plant, 0.7)
    assert plant.coil_force_n()[strut] == 0.0
    others = np.delete(plant.coil_force_n(), strut)
    assert np.all(np.abs(others) > 1e-3)
    # Its suspension holds it near the centre; the flexures let the others pull it a little.
    assert abs(plant.displacements()[strut]) < 1e-6
    assert max(residuals) < CLOSURE_LIMIT_M


def test_a_coil_that_weakens_twice_is_left_with_the_product(model):
    """Force per command; the other coils keep theirs."""
    plant, whole = Plant(model), model.actuator_gainprm[:, 0]
    for effectiveness, left in ((0.5, 0.5), (0.6, 0.3), (0.0, 0.0)):
        plant.weaken(2, effectiveness)
        plant.step(np.full(6, 1e-6), PERIOD_S)
        expected = whole * 1e-6 * np.where(np.arange(6) == 2, left, 1.0)
        np.testing.assert_allclose(plant.coil_force_n(), expected, rtol=1e-12)


def test_a_position_servo_that_weakens_loses_force_and_not_its_target():
    """At any state; with its gain alone reduced it would pull to half the angle commanded."""
    arm = load_model(HEXAPOD_MJCF.with_name("arm.xml"))
    rng, forces = np.random.default_rng(0), []
    state = rng.normal(size=(3, arm.nu))
    for weak in (False, True):
        plant = Plant(arm)
        if weak:
            plant.weaken(3, 0.5)
        plant.data.qpos[:], plant.data.qvel[:], plant.data.ctrl[:] = 1e-3 * state
        mujoco.mj_forward(plant.model, plant.data)
        forces.append(plant.coil_force_n())
    expected = forces[0] * np.where(np.arange(arm.nu) == 3, 0.5, 1.0)
    np.testing.assert_allclose(forces[1], expected, rtol=1e-12)


def test_a_strut_that_breaks_loose_loses_its_own_coil_and_spring_and_no_other(model):
    plant = Plant(model)
    plant.break_loose(4)
    springs = model.jnt_stiffness.copy()
    springs[model.joint("strut5").id] = 0.0
    np.testing.assert_array_equal(plant.model.jnt_stiffness, springs)
    plant.step(np.full(6, 1e-6), PERIOD_S)
    np.testing.assert_array_equal(plant.coil_force_n() == 0.0, np.arange(6) == 4)


def test_a_mechanism_without_loops_has_none_that_could_open(model):
    """Struts hanging from the base, nothing between their ends."""
    cut = copy.copy(model)
    cut.eq_active0[:] = False
    plant = Plant(cut)
    plant.step(np.zeros(6), PERIOD_S)
    assert plant.closure_residual_m() == 0.0


def test_stops_hold_the_struts_within_their_stroke(model):
    """Twice the force that the suspension takes at full stroke moves no strut past it."""
    plant = Plant(model)
    payload = model.body("payload").id
    plant.data.xfrc_applied[payload, 2] = -600.0
    plant.settle(1.0)
    assert np.abs(plant.displacements()).max() == pytest.approx(0.000635, rel=3e-5)
    assert plant.closure_residual_m() < CLOSURE_LIMIT_M


def test_a_softly_closed_loop_is_seen_by_its_closure_residual():
    plant = Plant(edited(('solref="2.5e-4 1"', 'solref="0.02 1"')))
    assert max(swing(plant, 0.2)) > 100 * CLOSURE_LIMIT_M


def test_failures_of_one_plant_leave_another_of_the_same_model_sound(model):
    failed, sound = Plant(model), Plant(model)
    failed.lock(0)
    failed.release(1)
    swing(failed, 0.1)
    swing(sound, 0.1)
    assert np.all(np.abs(sound.coil_force_n()) > 0)
    assert abs(sound.displacements()[0]) > 1e-6


def test_each_of_mujocos_warnings_of_a_non_finite_state_ends_the_run(model):
    """One alone, and at once: the state may look finite for a while yet."""
    for kind in ("BADQPOS", "BADQVEL", "BADQACC"):
        plant = Plant(model)
        plant.data.warning[getattr(mujoco.mjtWarning, f"mjWARN_{kind}")].number = 1
        with pytest.raises(SimulationDiverged):
            plant.step(np.zeros(6), PERIOD_S)


@pytest.mark.parametrize("flag", ['autoreset="disable"', ""])
def test_a_plant_that_turns_non_finite_stops_with_its_time_and_state(flag):
    """Also when the file leaves MuJoCo's automatic reset on, which would forget the state."""
    # Dampers that an explicit step of a millisecond cannot follow.
    too_fast = (('timestep="1.25e-4"', 'timestep="1e-3"'), ('damping="110"', 'damping="2000"'))
    plant = Plant(edited(('autoreset="disable"', flag), *too_fast))
    former = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        with pytest.raises(SimulationDiverged) as caught:
            swing(plant, 1.0)
    finally:
        mujoco.set_mju_user_warning(former)
    assert 0.001 < caught.value.time_s < 1.0
    assert caught.value.state[0] == pytest.approx(caught.value.time_s - PERIOD_S, abs=1e-9)
    assert np.isfinite(caught.value.state).all()


def test_what_a_plant_cannot_do_is_refused_by_name(model):
    plant = Plant(model)
    with pytest.raises(ValueError, match="command_m must be finite"):
        plant.step(np.full(6, np.nan), PERIOD_S)
    with pytest.raises(ValueError, match="command_m must have shape"):
        plant.step(np.zeros(5), PERIOD_S)
    for strut in (-1, 6):
        for fail in (plant.lock, plant.release):
            with pytest.raises(ValueError, match=r"actuator must lie in 0\.\.5"):
                fail(strut)
    crossed = edited(('<joint name="lock1" joint1="strut1"', '<joint name="lock1" joint1="strut2"'))
    with pytest.raises(ModelError, match='"lock1" must lock the joint "strut1" alone'):
        Plant(crossed)


def test_a_control_period_must_be_whole_physics_steps(model):
    with pytest.raises(ModelError, match=r"does not divide the period of 0\.00033 s"):
        Plant(model).step(np.zeros(6), 3.3e-4)
