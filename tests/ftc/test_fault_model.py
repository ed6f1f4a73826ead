"""Models of the plant with failed actuators, against MuJoCo and mechanics."""

from dataclasses import replace
from functools import partial

import control
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from fjh.rig.hexapod.rig import hexapod_rig
from ftc import WEAKEST
from ftc.fdi import KINDS, Fault, NominalModel, fault_model, monitor, static_share
from ftc.fdi.fault_model import resting_displacements, static_gain
from ftc.fdi.uncertainty import UncertainModel, side_by_side, uncertain_model
from ftc.reconfiguration import used_share
from sim import Failure, Plant, assemble, load_model
from tests import models
from tests.ftc.carts import carts, carts_with_friction, random_walk, servo_carts
from tests.profiles import examples

kinds = pytest.mark.parametrize("kind", KINDS)


def simulate(
    plant: Plant, nominal: NominalModel, fault: Fault | None, onset: int, sent: np.ndarray
):
    """Return displacements (N, n) of MuJoCo's plant and of its model, failing at a tick."""
    model, x, moved, expected = fault_model(nominal), np.zeros(nominal.plant.nstates), [], []
    for tick, command in enumerate(sent):
        if fault is not None and tick == onset:
            model = fault_model(nominal, [fault])
            x = model.onset @ x
            if fault.kind == "weak":
                plant.weaken(fault.actuator, fault.effectiveness)
            else:
                (plant.lock if fault.kind == "locked" else plant.release)(fault.actuator)
        plant.step(command, nominal.period_s)
        x = model.step(x, command)
        moved.append(plant.displacements())
        expected.append(nominal.displacement @ x)
    return np.array(moved), np.array(expected)


@kinds
@pytest.mark.parametrize("strut", range(6))
def test_the_model_of_a_failed_strut_moves_as_in_mujoco(strut, kind, model):
    """The model is that of the healthy machine; a lock stops by an impact and stays locked."""
    nominal, rng = hexapod_rig().nominal, np.random.default_rng(strut)
    time_s = np.arange(240)[:, None] * nominal.period_s
    waves = [np.sin(2 * np.pi * (hz * time_s + rng.uniform(size=6))) for hz in (0.5, 5, 20, 35)]
    sent = 1e-6 * (np.sum(waves, axis=0) - np.sum(waves, axis=0)[0])
    moved, expected = simulate(Plant(model), nominal, Fault(strut, kind, 0.4), 120, sent)
    close = 2e-3 if kind == "locked" else 2e-4  # MuJoCo's lock is a soft one
    assert np.abs(moved - expected).max() < close * np.abs(moved).max()
    assert kind != "locked" or np.ptp(expected[120:, strut]) < 1e-15


def test_a_loose_strut_is_the_plant_that_is_linearized_without_its_spring(model):
    """The rates of the strut without force and spring agree with MuJoCo's own linearization."""
    nominal, broken, k = hexapod_rig().nominal, Plant(model), 6
    healthy = broken.linear()
    broken.break_loose(4)
    without = broken.linear()
    assert nominal.spring is not None and nominal.preload is not None
    A = nominal.plant.A[k:] + np.outer(nominal.plant.B[k:, 4], nominal.spring[4])
    # The weight that the spring no longer carries turns with the flexures: 1e-4 of the stiffness.
    moved = np.linalg.solve(healthy.C_twist[:, :k], without.C_twist[:, :k])
    expected, tiny = moved @ without.A[k:, :k], 2e-4 * np.abs(A).max()
    np.testing.assert_allclose(A[:, :k] @ moved, expected, atol=tiny)
    with pytest.raises(ValueError, match="must have a spring for strut"):
        fault_model(replace(nominal, spring=None), [Fault(4, "loose")])


def test_a_failure_becomes_one_fault():
    assert Fault.of(Failure(2, "weak", effectiveness=0.3)) == Fault(2, "weak", 0.3)
    assert Fault.of(Failure(1, "loose", effectiveness=0.3)) == Fault(1, "loose")
    with pytest.raises(TypeError, match="actuator must be a number here"):
        Fault.of(Failure("strut1", "free"))


def test_a_plant_without_positions_and_velocities_is_rejected():
    plant = control.ss(np.eye(6), np.ones((6, 3)), np.ones((3, 6)), 0)
    with pytest.raises(ValueError, match=r"\[q; q_dot\]"):
        replace(carts(0, n=3), plant=plant)


@kinds
@pytest.mark.parametrize("n", [2, 5])
def test_the_model_of_a_failed_servo_moves_by_newtons_law(n, kind):
    """Onset, released load and later commands agree to rounding."""
    plant, sent = servo_carts(n, n), random_walk(n, 400, np.random.default_rng(0))
    fault = Fault(1, kind, 0.4 * (kind == "weak"))
    before, after = fault_model(plant.nominal()), fault_model(plant.nominal(), [fault])
    states = before.states(sent[:100])
    states = np.vstack([states[:-1], after.states(sent[100:], after.onset @ states[-1])])[:-1]
    np.testing.assert_allclose(states[:, :n], plant.run(fault, 100, sent), atol=1e-12)


def test_a_weak_servo_rests_where_its_forces_balance():
    """Static equilibrium of springs and servos against loads: K x = kp remaining u + load."""
    plant, u = servo_carts(3, 4), np.array([1e-3, -2e-3, 5e-4])
    remaining = np.array([1.0, 0.4, 1.0])
    stiffness = plant.structure + np.diag(remaining * plant.kp)
    expected = np.linalg.solve(stiffness, remaining * plant.kp * u + (remaining - 1) * plant.load)
    result = resting_displacements(plant.nominal(), [Fault(1, "weak", 0.4)], u)
    assert result is not None
    np.testing.assert_allclose(result, expected, rtol=1e-9)
    falls = replace(plant, structure=np.zeros((3, 3))).nominal()
    assert resting_displacements(falls, [Fault(0, "free")], u) is None
    assert resting_displacements(falls, [Fault(0, "weak", 0.1)], u) is not None


@kinds
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(1, 8))]
)
def test_a_failed_servo_is_isolated_despite_model_errors(seed, kind):
    """Masses, springs and servos have errors of some percent; runs end at the confirmation."""
    n = 2 + seed % 4
    model, rng = servo_carts(n, seed), np.random.default_rng(seed)
    wrong = {
        name: getattr(model, name) * (1 + 0.02 * rng.standard_normal(n))
        for name in ("mass", "kp", "kv")
    }
    plant = replace(model, structure=model.structure * (1 + 0.02 * rng.standard_normal()), **wrong)
    fault = Fault(int(rng.integers(n)), kind, rng.uniform(0.2, 0.7) * (kind == "weak"))
    sent = random_walk(n, 900, rng)
    y = plant.run(fault, 600, sent) + 2e-5 * rng.standard_normal((900, n))
    fdi_monitor, diagnoses = monitor(model.nominal()), []
    state, late = fdi_monitor.start(), np.vstack([0 * sent[:1], sent[:-1]])  # previous commands
    for measured, u in zip(y, late, strict=True):
        state = fdi_monitor.step(state, measured, u)
        diagnoses += [state.diagnosis] if state.diagnosis else []
        if diagnoses and diagnoses[-1].confirmed:
            break
    assert diagnoses and not state.unexplained
    assert {each.fault.actuator for each in diagnoses} == {fault.actuator}
    assert kind in diagnoses[-1].kinds


def model_of(plant: Plant, noise: float, period_s: float) -> NominalModel:
    """Return a plant's linear model to the displacements."""
    linear = plant.linear()
    return NominalModel(
        control.ss(linear.A, linear.B, linear.C_active, 0),
        linear.C_active,
        np.full(len(plant.drives), noise),
        period_s,
        float(plant.model.opt.timestep),
        feedback=linear.feedback,
        holding=linear.holding,
        implicit_damping=plant.implicit_damping,
        friction=linear.friction,
    )


@pytest.mark.parametrize(
    ("integrator", "eulerdamp", "damping", "kv", "implicit"),
    [
        ("Euler", "disable", 0.2, 1.0, False),
        ("Euler", "enable", 4.0, 0.0, True),
        ("implicitfast", "disable", 0.2, 1.0, True),
    ],
)
def test_dampers_are_stepped_as_the_integrator_steps_them(
    integrator, eulerdamp, damping, kv, implicit
):
    """Step responses of a healthy plant and of one without a servo agree to 1 %."""
    lifted = models.model_of(
        "lifted",
        ('timestep="1e-4" integrator="Euler"', f'timestep="1e-3" integrator="{integrator}"'),
        ('eulerdamp="disable"', f'eulerdamp="{eulerdamp}"'),
        ('damping="0.2"', f'damping="{damping}"'),
        ('kv="1.0"', f'kv="{kv}"'),
    )
    plant = Plant(lifted, base=None, start=assemble(lifted))
    assert plant.implicit_damping == implicit
    nominal = model_of(plant, 1.0, period_s=2e-3)
    moved, expected = simulate(plant, nominal, Fault(0, "free"), 8, np.tile([2e-4, -1e-4], (16, 1)))
    error = np.abs(moved - expected).max(axis=1)
    assert (error < 0.01 * np.abs(moved).max(axis=1)).all()


MASS, LIMIT, SOFTNESS, RATE = 2.0, 0.5, 0.05, 100.0
STEP_S = 1e-3


@pytest.mark.parametrize("force", [0.1, 0.4, 0.9, -2.0])
def test_a_block_sticks_below_the_limit_and_slips_above_it(force):
    """Sticking it creeps at force times softness over rate; slipping it is slowed by the limit."""
    plant = control.ss([[0, 1], [0, 0]], [[0], [1 / MASS]], [[1, 0]], 0)
    one, seen = np.ones(1), np.array([[1.0, 0.0]])
    friction = np.eye(1) / MASS, np.eye(1), LIMIT * one, SOFTNESS * one, RATE * one
    block = NominalModel(plant, seen, one, STEP_S, STEP_S, friction=friction)
    x = fault_model(block).states(np.full((1000, 1), force))[-1]
    slips = np.sign(force) * (abs(force) - LIMIT) / MASS
    creeps = force * SOFTNESS / RATE
    assert x[1] == pytest.approx(slips if abs(force) > LIMIT else creeps, rel=0.02)


@pytest.mark.parametrize("seed", range(5))
def test_friction_forces_are_those_of_least_energy_within_the_limits(seed):
    """Forces f minimize f'K f / 2 + f'c: bounded least squares with a coupled random K."""
    rng, n = np.random.default_rng(seed), 4
    root, nominal = rng.normal(size=(n, n)), servo_carts(n, seed).nominal()
    M = root @ root.T + np.eye(n)
    limit = rng.uniform(0.01, 0.1, n)
    friction_arrays = M, np.eye(n), limit, rng.uniform(0.1, 1, n), np.ones(n)
    model = fault_model(replace(nominal, period_s=STEP_S, friction=friction_arrays))
    x, u = 1e-3 * rng.normal(size=2 * n), 1e-3 * rng.normal(size=n)
    free = fault_model(replace(nominal, period_s=STEP_S)).step(x, u)
    friction = model.dry_friction
    assert friction is not None
    c = friction.E @ x + friction.D @ [*u, 1.0]
    L = np.linalg.cholesky(friction.K)
    best = lsq_linear(L.T, -np.linalg.solve(L, c), (-limit, limit), tol=1e-14)
    np.testing.assert_allclose(model.step(x, u), free + friction.G @ best.x, atol=1e-9)
    assert (np.abs(best.x) > 0.99 * limit).any()


FRICTION_FAULTS = [[], [Fault(1, "locked")], [Fault(0, "free")]]


def uncertain(nominal: NominalModel, faults: list[Fault], ticks: int = 4) -> UncertainModel:
    """Return the uncertain model with one zero error and limits of 50 % uncertainty."""
    plant = partial(fault_model, nominal)
    return uncertain_model(plant, faults, others=[plant], friction=0.5, ticks=ticks)


def wave(sample: int) -> np.ndarray:
    return 5e-4 * np.array([np.sin(0.2 * sample), np.cos(0.1 * sample), 1.0])


@pytest.mark.parametrize("faults", FRICTION_FAULTS)
def test_a_sample_is_its_ticks_and_its_deviations_are_differences(faults):
    """The model agrees to rounding, a smaller limit exactly, a changed state to first order."""
    ticks, n, nominal = 4, 3, carts_with_friction(2, 0.15)
    truth = fault_model(nominal, faults)
    other = fault_model(carts_with_friction(2, [0.075, 0.15, 0.15]), faults)
    model = uncertain(nominal, faults, ticks)
    assert (len(model.M), model.first_limit) == (2 + n, 2)
    X, runs = np.zeros((2 + n, 2 * n)), np.zeros((3, 2 * n))
    X[1] = 1e-9 * np.random.default_rng(0).normal(size=2 * n)
    runs[1] = X[1]
    for sample in range(60):
        u = wave(sample)
        Y, X = model.step(X, np.array([*u, *u, 1.0]))
        samples = []
        for _ in range(ticks):
            samples.append([truth.C @ x for x in runs])
            runs = np.array(
                [of.step(x, u) for of, x in zip((truth, truth, other), runs, strict=True)]
            )
        x, _, smaller = np.mean(samples, axis=0)
        np.testing.assert_allclose(Y[[0, 2]], [x, x - smaller], atol=1e-6)
        deviation = runs[1] - runs[0]
        np.testing.assert_allclose(X[1], deviation, atol=1e-3 * np.abs(deviation).max())
    np.testing.assert_allclose(X[[0, 2]], [runs[0], runs[0] - runs[2]], atol=1e-12)
    assert np.abs(X[2]).max() > 1e-6


def test_a_batch_of_models_with_friction_equals_each_alone():
    models = [uncertain(carts_with_friction(2, 0.15), faults) for faults in FRICTION_FAULTS]
    alone = [np.zeros((len(model.M), 6)) for model in models]
    X = np.array(alone)[:, None]
    for sample in range(20):
        v = np.array([*wave(sample), *wave(sample), 1.0])
        Y = side_by_side(models).advance(X, v, np.ones((3, 1), dtype=bool), np.ones(1))
        for k, model in enumerate(models):
            seen, alone[k] = model.step(alone[k], v)
            np.testing.assert_array_equal(Y[k, 0], seen)
            np.testing.assert_array_equal(X[k, 0], alone[k])


@pytest.mark.parametrize("integrator", ["implicitfast", "Euler"])
@pytest.mark.parametrize("fault", [None, Fault(1, "locked"), Fault(1, "free")])
def test_the_model_with_friction_moves_as_in_mujoco(tmp_path, integrator, fault):
    """The model sticks, slips and creeps like the plant, before and after a failure."""
    file = models.saved(tmp_path, "rubbing_arm", ("implicitfast", integrator))
    arm = load_model(file, add_locks=True)
    data = mujoco.MjData(arm)
    mujoco.mj_forward(arm, data)
    plant = Plant(arm, start=data)
    nominal = model_of(plant, 1e-6, period_s=2e-3)
    ticks = np.arange(300)
    sent = 1e-3 * np.column_stack([np.sin(0.03 * ticks), 1 - np.cos(0.05 * ticks)])
    moved, expected = simulate(plant, nominal, fault, 150, sent)
    smooth = fault_model(replace(nominal, friction=None)).states(sent)[1:] @ nominal.displacement.T
    size = np.abs(moved).max()
    error, without = np.abs(moved - expected), np.abs(moved - smooth)
    assert error.max() < 0.02 * size
    assert error[:150].max() < 3e-3 * size  # Euler makes only the dampers of joints implicit
    assert without[:150].max() > 0.1 * size


SEEDS, NUMBERS = st.integers(0, 2**16), st.integers(1, 4)
LEFT = st.floats(0.01, 1.0)


@examples(30)
@given(SEEDS, NUMBERS, LEFT)
def test_a_weak_servo_reaches_its_command_within_the_compliance_of_its_load(seed, n, remaining):
    """The share for stiffness e k against a load s is e k / (s + e k), near one if stiff."""
    plant = servo_carts(n, seed)
    for k in range(n):
        others = np.where(np.arange(n) == k, 0.0, plant.kp)
        s, kp = 1 / np.linalg.inv(plant.structure + np.diag(others))[k, k], plant.kp[k]
        expected = remaining * (s + kp) / (s + remaining * kp)
        share = static_share(plant.nominal(), Fault(k, "weak", remaining))
        assert abs(share - expected) < 2e-3


@pytest.mark.parametrize("servo", [False, True])
def test_an_actuator_without_force_moves_nothing_and_a_healthy_one_all(servo):
    """A coil moves in proportion to its remaining force, since its spring is unchanged."""
    assert static_share(carts(0), Fault(0, "weak", 0.3)) == pytest.approx(0.3)
    nominal = servo_carts(2, 0).nominal() if servo else carts(0)
    assert static_share(nominal, Fault(0, "weak", 0.0)) == 0.0
    assert static_share(nominal, Fault(0, "weak", 1.0)) == 1.0
    for kind in ("locked", "free"):
        assert static_share(nominal, Fault(0, kind)) < 1e-6
        assert used_share(nominal, Fault(0, kind)) == 0.0


def test_an_unrestrained_mass_is_moved_by_the_remaining_force():
    """The static response is unbounded, but the ratio has a limit at frequency zero."""
    plant = control.ss([[0.0, 1.0], [0.0, 0.0]], [[0.0], [3.0]], [[1.0, 0.0]], 0)
    floating = NominalModel(plant, np.eye(1, 2), np.ones(1), period_s=2e-3, step_s=1e-3)
    assert abs(static_share(floating, Fault(0, "weak", 0.3)) - 0.3) < 1e-9


@pytest.mark.parametrize("ticks_a_second", [2000, 1000, 500, 250])
def test_a_motion_without_restoring_force_does_not_depend_on_the_control_rate(ticks_a_second):
    """The response is evaluated after a hundred seconds: 3 m/s^2 against a damper of 5 /s."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.diag([0.0, -900.0]), np.diag([-5.0, -30.0])]])
    plant = control.ss(A, np.vstack([np.zeros((2, 2)), np.diag([3.0, 900.0])]), np.eye(1, 4), 0)
    slides = NominalModel(plant, np.eye(2, 4), np.ones(1), 1 / ticks_a_second, step_s=5e-4)
    np.testing.assert_allclose(static_gain(slides), np.diag([3 / 5 / 1e-2, 1.0]), rtol=3e-3)


def test_an_actuator_with_less_than_half_its_displacement_is_not_used():
    coil, servo = carts(0), servo_carts(2, 0).nominal()
    assert used_share(coil, Fault(0, "weak", WEAKEST + 0.01)) > WEAKEST
    assert used_share(coil, Fault(0, "weak", WEAKEST - 0.01)) == 0.0
    assert used_share(servo, Fault(0, "weak", WEAKEST - 0.01)) > 0.8
