"""Physics of the plant, its task frame, and failures as text."""

import _thread
import copy
import itertools
import threading
import time
from functools import cache, partial
from typing import Any, get_args

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.controller import nominal_loops
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.study.workers import in_parallel
from sim import (
    MODELS,
    Body,
    Failure,
    ModelError,
    Plant,
    SimulationDiverged,
    jacobians,
    linearize,
    load_model,
)
from sim.plant import FailureKind
from tests.closed_form import closed_form, modes_of
from tests.models import model_of
from tests.sim.machines import SHIPPED, mode_shapes, pole_of, ring_down, settled

PERIOD_S = 1e-3
HEXAPOD = str(MODELS / "fjh")


def drive_sinusoid(plant: Plant, seconds: float) -> list[float]:
    """Drive all struts by 20 um at 0.5 Hz with different phases; return residuals by tick."""
    residuals = []
    for _ in range(round(seconds / PERIOD_S)):
        time_s = plant.data.time
        fade_in = min(1.0, time_s / 0.5)
        plant.step(2e-5 * fade_in * np.sin(np.pi * time_s + np.arange(6)), PERIOD_S)
        residuals.append(plant.closure_residual_m())
    return residuals


def some(first: tuple, others: tuple) -> list:
    """Parametrize some values in short runs and all in long ones."""
    return [*first, *(pytest.param(value, marks=pytest.mark.long) for value in others)]


MODES = STRUTS = some((0, 3), (1, 2, 4, 5))


@cache
def after_oscillation() -> tuple[Plant, list[float]]:
    """Return the hexapod after 0.8 s of oscillation, and its closure residuals."""
    plant = Plant(load_model())
    return plant, drive_sinusoid(plant, 0.8)


@pytest.mark.parametrize("seconds", some((0.25,), (2.0,)))
def test_preload_holds_the_payload_at_the_nominal_pose_against_gravity(seconds):
    plant = copy.deepcopy(settled(seconds))
    assert np.abs(plant.pose().translation_m).max() < 1e-7
    assert np.abs(plant.displacements()).max() < 1e-7


def test_the_centre_of_mass_of_payload_and_tips_is_the_payload_origin(model):
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ids = [model.body("payload").id, *(model.body(f"tip{k}").id for k in range(1, 7))]
    mass = model.body_mass[ids]
    centre = mass @ data.xipos[ids] / mass.sum()
    np.testing.assert_allclose(centre, data.site("payload").xpos, atol=1e-9)


def payload_displacement(model: mujoco.MjModel, wrench: np.ndarray) -> np.ndarray:
    """Return the static displacement of the payload under a wrench [torque; force], world axes."""
    plant = Plant(model, base=None)
    plant.push(wrench)
    plant.settle(1.5)
    return world_displacement(plant)


@pytest.mark.long
def test_payload_stiffness_is_that_of_the_springs_through_the_jacobian(model):
    """A small wrench moves the payload by (A^T k A)^-1 w; flexures add 0.5 %."""
    oracle = closed_form(model)
    springs = oracle.A.T @ oracle.A * model.joint("strut1").stiffness[0]
    unloaded = payload_displacement(model, np.zeros(6))
    size = np.array([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    moved = [payload_displacement(model, wrench) - unloaded for wrench in np.diag(size)]
    measured = np.linalg.inv(np.array(moved).T / size)
    # The strut's length converts rotation and translation to one unit.
    unit = np.diag([1 / 0.4064] * 3 + [1.0] * 3)
    measured, springs, full = (unit @ K @ unit for K in (measured, springs, oracle.K))
    assert np.linalg.norm(measured - springs) < 5e-3 * np.linalg.norm(springs)
    assert np.linalg.norm(measured - full) < 1e-3 * np.linalg.norm(full)


def test_modes_of_the_linearized_plant_are_those_of_the_closed_form(model):
    plant = Plant(model)
    frequency, damping = modes_of(linearize(plant.model, plant.data).A)
    expected_frequency, expected_damping = closed_form(model).modes()
    # Both differ by 0.05 %.
    np.testing.assert_allclose(frequency, expected_frequency, rtol=1e-3)
    np.testing.assert_allclose(damping, expected_damping, rtol=1e-3)


@pytest.mark.parametrize("mode", MODES)
def test_a_simulated_ring_down_shows_the_damping_of_the_closed_form(model, mode):
    """The integrator changes the damping by less than 1 %."""
    frequency, damping = closed_form(model).modes()
    pole = pole_of(ring_down(model, mode_shapes()[mode], 0.3), model.opt.timestep)
    assert abs(pole) / (2 * np.pi) == pytest.approx(frequency[mode], rel=0.01)
    assert -pole.real / abs(pole) == pytest.approx(damping[mode], rel=0.01)


@pytest.mark.parametrize("seconds", some((0.25,), (2.0,)))
@pytest.mark.parametrize("mode", MODES)
def test_without_damping_energy_is_conserved_at_every_step(model, mode, seconds):
    """Energy of each mode stays within 1 % of its initial value."""
    plant = copy.deepcopy(settled(seconds))
    undamped, data = plant.model, plant.data
    undamped.dof_damping[:] = 0.0
    undamped.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data.qvel[:] = 0.0
    mujoco.mj_forward(undamped, data)
    energy_at_rest = data.energy[0]
    shape, momentum = mode_shapes()[mode], np.empty(model.nv)
    mujoco.mj_mulM(undamped, data, momentum, shape)
    # The shapes of equal modes are arbitrary; the initial energy is not.
    data.qvel[:] = shape * np.sqrt(2.0 * 5e-6 / (shape @ momentum))

    energy = []
    for _ in range(round(seconds / undamped.opt.timestep)):
        before = data.qvel.copy()
        mujoco.mj_step(undamped, data)  # data.energy[0] belongs to the previous position
        centred = (before + data.qvel) / 2
        # Positions and velocities of semi-implicit Euler differ by half a step.
        mujoco.mj_mulM(undamped, data, momentum, centred)
        energy.append(data.energy[0] - energy_at_rest + centred @ momentum / 2)
    np.testing.assert_allclose(energy, energy[0], rtol=0.01)
    assert energy[0] == pytest.approx(5e-6, rel=0.01)


@pytest.mark.night
def test_halving_the_time_step_changes_no_rms_error_by_a_hundredth_percent(model, table1):
    columns = [c for c in COLUMNS if c.name in ("W_a", "W_e", "W_a_uncorrected")]
    half = copy.copy(model)
    half.opt.timestep /= 2
    testbed = Testbed(half, TestbedConfig(), nominal_loops(model, TestbedConfig()))
    # The constant Jacobian is faster, and changes no RMS by more than 5e-5 urad.
    rig, path = hexapod_rig(testbed), testbed.bench.spiral_rad()
    calls = [
        {"controller": rig.controller(c.goal), "path": path, "failures": c.failures}
        for c in columns
    ]
    runs = in_parallel(rig.fly, calls, lambda done, total: None)
    for column, run in zip(columns, runs, strict=True):
        assert run.closure_max_m < CLOSURE_LIMIT_M
        published = table1["by_name"][column.name]
        whole = [published[f"{angle}_rms_urad"] for angle in ("alpha", "beta")]
        np.testing.assert_allclose(1e6 * run.rms(), whole, rtol=1e-4)
        # Other time steps must give different runs.
        assert np.abs(1e6 * run.rms() - whole).min() > 0


@pytest.mark.parametrize("strut", STRUTS)
def test_a_strut_locked_in_motion_stays_and_the_loops_stay_closed(strut):
    plant, residuals = copy.deepcopy(after_oscillation())
    plant.lock(strut)
    where = plant.displacements()[strut]
    assert abs(where) > 1e-6, "the lock must be off centre to be a test"
    for _ in range(300):
        residuals += drive_sinusoid(plant, PERIOD_S)
        assert abs(plant.displacements()[strut] - where) < 1e-7
    assert max(residuals) < CLOSURE_LIMIT_M


def test_stops_hold_the_struts_within_their_stroke(model):
    """Twice the force of the suspension at full stroke moves no strut past it."""
    plant = Plant(model)
    payload = model.body("payload").id
    plant.data.xfrc_applied[payload, 2] = -600.0
    plant.settle(1.0)
    assert np.abs(plant.displacements()).max() == pytest.approx(0.000635, rel=3e-5)
    assert plant.closure_residual_m() < CLOSURE_LIMIT_M


def test_soft_loops_have_residuals_and_a_machine_without_loops_has_none(model):
    plant = Plant(model_of(HEXAPOD, ('solref="2.5e-4 1"', 'solref="0.02 1"')))
    assert max(drive_sinusoid(plant, 0.2)) > 100 * CLOSURE_LIMIT_M
    cut = copy.copy(model)
    cut.eq_active0[:] = False
    plant = Plant(cut)
    plant.step(np.zeros(6), PERIOD_S)
    assert plant.closure_residual_m() == 0.0


def test_each_of_mujocos_warnings_of_a_non_finite_state_ends_the_run(model):
    """A single warning is enough, since the state may stay finite for some time."""
    for kind in ("BADQPOS", "BADQVEL", "BADQACC"):
        plant = Plant(model)
        plant.data.warning[getattr(mujoco.mjtWarning, f"mjWARN_{kind}")].number = 1
        with pytest.raises(SimulationDiverged):
            plant.step(np.zeros(6), PERIOD_S)


@pytest.mark.parametrize("flag", ['autoreset="disable"', ""])
def test_a_plant_that_turns_non_finite_stops_with_its_time_and_state(flag):
    """MuJoCo's automatic reset in a file, which would lose the state, is disabled."""
    # An explicit step of a millisecond is unstable with these dampers.
    too_fast = (('timestep="1.25e-4"', 'timestep="1e-3"'), ('damping="110"', 'damping="2000"'))
    plant = Plant(model_of(HEXAPOD, ('autoreset="disable"', flag), *too_fast))
    with pytest.raises(SimulationDiverged) as caught:
        drive_sinusoid(plant, 1.0)
    assert 0.001 < caught.value.time_s < 1.0
    assert caught.value.state[0] == pytest.approx(caught.value.time_s - PERIOD_S, abs=1e-9)
    assert np.isfinite(caught.value.state).all()


def test_a_control_period_must_be_whole_physics_steps(model):
    with pytest.raises(ModelError, match=r"does not divide the period of 0\.00033 s"):
        Plant(model).step(np.zeros(6), 3.3e-4)


def turning() -> Plant:
    arm = model_of("rubbing_arm", add_locks=True)
    arm.opt.gravity[:] = 0.0
    return Plant(arm, base=None)


@pytest.mark.parametrize("ask", [Plant.settle, lambda plant, s: plant.step(np.zeros(2), s)])
def test_an_endless_period_is_rejected(ask):
    with pytest.raises(
        ValueError, match=r"^(period_s|seconds) must be at most 1e\+07 physics steps, here 10000 s"
    ):
        ask(turning(), 1e6)


def test_a_long_period_ends_within_a_second_of_ctrl_c():
    plant, after_s = turning(), 0.1
    timer = threading.Timer(after_s, _thread.interrupt_main)
    began_s = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        plant.settle(9e3)  # some 10 s of computing
    assert time.monotonic() - began_s < after_s + 1.0
    assert 0.0 < plant.data.time < 9e3


def test_a_period_in_parts_is_the_same_to_the_last_bit(model):
    """The period has more physics steps than the interval between checks for Ctrl-C."""
    once, often = Plant(model), Plant(model)
    command, period_s = np.full(6, 1e-5), 7 * 100 * model.opt.timestep
    once.step(command, period_s)
    for _ in range(7):
        often.step(command, 100 * model.opt.timestep)
    np.testing.assert_array_equal(once.data.qpos, often.data.qpos)


def with_turned_sites(name: str, seed: int) -> mujoco.MjModel:
    """Load a machine of this repository with base and payload in any orientation."""
    model, rng = load_model(MODELS / f"{name}.xml"), np.random.default_rng(seed)
    for site in ("base", "payload"):
        q = rng.normal(size=4)
        model.site(site).quat = q / np.linalg.norm(q)
        model.site(site).sameframe = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    return model


def world_displacement(plant: Plant) -> np.ndarray:
    """Return the displacement of the payload's body from nominal in world axes."""
    nominal = mujoco.MjData(plant.model)
    mujoco.mj_forward(plant.model, nominal)
    body = int(plant.model.site("payload").bodyid[0])
    before, after = (d.body(body).xmat.reshape(3, 3) for d in (nominal, plant.data))
    shift = plant.data.site("payload").xpos - nominal.site("payload").xpos
    return np.concatenate([Rotation.from_matrix(after @ before.T).as_rotvec(), shift])


ON_ARM = Body("link2")
"""Site on the second link of the arm."""


@pytest.mark.parametrize(
    ("name", "base"), [("arm", ON_ARM), *itertools.product(SHIPPED, ["base", None])]
)
def test_motion_of_the_payload_is_measured_from_its_nominal_pose(name, base):
    """The motion is that of the body in axes of the base, for any orientation of the sites."""
    for seed in range(3):
        plant = Plant(with_turned_sites(name, seed), base=base)
        nominal = plant.data.site("payload").xpos.copy()
        np.testing.assert_allclose(plant.displacement(), 0.0, atol=5e-15)
        np.testing.assert_allclose(plant.pose().rotation, np.eye(3), atol=5e-15)
        R, payload = (plant.data.site(s).xmat.reshape(3, 3) for s in ("base", "payload"))
        assert Rotation.from_matrix(R.T @ payload).magnitude() > 0.1
        size = 0.1 if base == ON_ARM else 1e-4
        plant.step(size * np.cos(np.arange(plant.model.nu)), 0.02)
        axes = np.eye(3)
        if base:
            frame = plant.data.body("link2") if base == ON_ARM else plant.data.site("base")
            axes = frame.xmat.reshape(3, 3)
        expected = (world_displacement(plant).reshape(2, 3) @ axes).ravel()
        np.testing.assert_allclose(plant.displacement(), expected, atol=1e-13)
        assert np.abs(expected).max() > 1e-6
        plant.axes[:], plant.origin_m[:] = 7.0, 7.0
        np.testing.assert_allclose(plant.axes, axes, atol=1e-15)
        np.testing.assert_allclose(plant.origin_m, nominal, atol=1e-15)


@pytest.mark.parametrize("base", ["base", None])
def test_small_motion_and_pushes_are_those_of_the_jacobian(base):
    """Virtual work: at rest the joint torques are J^T times the wrench in base axes."""
    model, wrench = with_turned_sites("arm", 3), np.random.default_rng(4).normal(size=6)
    jac = jacobians(model, mujoco.MjData(model), "payload", axes=base)
    plant = Plant(model, base=base)
    plant.step(1e-5 * np.array([0.3, -0.4, 0.5, 0.2, -0.3, 0.1, 0.4]), 0.2)
    expected = jac.J_T[:, jac.active] @ plant.displacements()
    np.testing.assert_allclose(plant.displacement(), expected, atol=1e-3 * np.abs(expected).max())
    plant = Plant(model, base=base)
    plant.push(wrench)
    mujoco.mj_forward(plant.model, plant.data)
    np.testing.assert_allclose(plant.data.qfrc_smooth, jac.J_T.T @ wrench, atol=1e-12)
    plant.shake(np.array([1.0, 2.0, 3.0]))
    axes = plant.axes @ [1.0, 2.0, 3.0]
    np.testing.assert_allclose(plant.model.opt.gravity, model.opt.gravity - axes, atol=1e-12)


@given(
    st.text(min_size=1).filter(lambda name: not name.isdecimal()) | st.integers(0, 10**9 - 1),
    st.sampled_from(get_args(FailureKind)),
    st.floats(0, 1e9),
)
def test_a_failure_is_read_back_from_its_text(actuator, kind, time_s):
    failure = Failure(actuator, kind, time_s)
    assert Failure.parse(str(failure)) == failure


@pytest.mark.parametrize(
    "text", ["", "a", "a:locked", "a@1", ":locked@1", "a:locked@-1", "a:locked@nan", "a: locked@1"]
)
def test_an_invalid_failure_text_is_quoted_with_the_expected_form(text):
    with pytest.raises(
        ValueError, match=r"^text must be NAME:KIND@SECONDS, .*locked.*, got"
    ) as error:
        Failure.parse(text)
    assert repr(text) in str(error.value)


@pytest.mark.parametrize("actuator", [-1, 6, 0.0, True, [0]])
def test_an_invalid_actuator_is_rejected_by_a_failure(model, actuator):
    plant = Plant(model)
    weaken: Any = partial(plant.weaken, effectiveness=0.5)
    for fail in (plant.lock, plant.release, plant.break_loose, weaken):
        with pytest.raises(ValueError, match=r"^actuator must"):
            fail(actuator)
    np.testing.assert_array_equal(plant.model.actuator_gainprm, model.actuator_gainprm)


def test_an_invalid_failure_is_rejected_by_name():
    wrongs: list[dict[str, Any]] = [{"actuator": -1}, {"time_s": -1.0}, {"kind": "broken"}]
    for wrong in wrongs:
        with pytest.raises(ValueError, match=f"^{next(iter(wrong))} must"):
            Failure(**{"actuator": 0, "kind": "weak"} | wrong)
