"""The plant with failed actuators, derived from the one without, against MuJoCo and mechanics."""

from dataclasses import replace

import control
import numpy as np
import pytest

from fjh.rig.hexapod.fault_tolerance import fault_text, nominal_model
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc.fdi import KINDS, Fault, NominalModel, fault_model
from sim import Failure, LinearPlant, Plant, linearize, load_model
from sim.plant import failed_plant
from tests.cart_runs import outputs_of

MODEL, BENCH = load_model(), TestbedConfig()
ANGLES = nominal_model(MODEL, BENCH)
GAUGES = nominal_model(MODEL, BENCH, strut_sensors=True)

failures = pytest.mark.parametrize("kind", KINDS)
struts = pytest.mark.parametrize("strut", range(6))


def stepped(plant: LinearPlant) -> tuple[np.ndarray, np.ndarray]:
    """A and B of a control tick, step by step of the physics, from its continuous model."""
    h, k = MODEL.opt.timestep, len(plant.A) // 2
    A, B = np.eye(2 * k), np.zeros((2 * k, 6))
    for _ in range(round(BENCH.control_period_s / h)):
        A[k:], B[k:] = A[k:] + h * plant.A[k:] @ A, B[k:] + h * (plant.A[k:] @ B + plant.B[k:])
        A[:k], B[:k] = A[:k] + h * A[k:], B[:k] + h * B[k:]
    return A, B


@failures
@struts
def test_the_failed_machine_is_that_of_the_failed_simulation(strut, kind):
    """Derived from the sound machine alone, it moves like MuJoCo's with the strut really failed."""
    plant = failed_plant(MODEL, [Failure(strut, kind, effectiveness=0.4)])
    real = linearize(plant.model, plant.data)
    A, B = stepped(real)
    sound = Plant(MODEL)
    machine = fault_model(ANGLES, [Fault(strut, kind, 0.4)])
    driven = [k for k in range(6) if kind != "locked" or k != strut]  # a lock bears its own coil
    for hz in (0.5, 5.0, 20.0, 35.0):
        z = np.exp(2j * np.pi * hz * ANGLES.period_s)
        expected = real.C_twist @ np.linalg.solve(z * np.eye(len(A)) - A, B)[:, driven]
        found = np.linalg.solve(z * np.eye(12) - machine.A, machine.B)[:, driven]
        found = linearize(sound.model, sound.data).C_twist @ found
        assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()


@struts
def test_a_strut_that_locks_stops_and_stays(strut):
    """The impact takes its speed, and never adds energy; afterwards it does not move by a hair."""
    machine = fault_model(ANGLES, [Fault(strut, "locked")])
    rng = np.random.default_rng(strut)
    x = rng.normal(size=12) * 1e-6
    c = ANGLES.displacement[strut]
    after = machine.onset @ x
    assert abs(c[:6] @ after[6:]) < 1e-18
    np.testing.assert_array_equal(after[:6], x[:6])
    # A coil pushes along M^-1 c^T, and so does the impact.
    along = ANGLES.plant.B[6:, strut]
    change = after[6:] - x[6:]
    np.testing.assert_allclose(change, along * (along @ change) / (along @ along), atol=1e-18)
    stands = c @ after
    for _ in range(2000):
        after = machine.A @ after + machine.B @ (rng.normal(size=6) * 1e-6)
    assert c @ after == pytest.approx(stands, abs=1e-15)


def test_a_failure_leaves_one_fault_behind():
    assert Fault.of(Failure(2, "weak", effectiveness=0.3)) == Fault(2, "weak", 0.3)
    assert Fault.of(Failure(1, "loose", effectiveness=0.3)) == Fault(1, "loose")
    assert fault_text(Fault(2, "weak", 0.3)) == "strut 3 weak to 30 %"
    assert fault_text(Fault(0, "locked")) == "strut 1 locked" and fault_text(None) == "sound"
    with pytest.raises(TypeError, match="actuator must be a number here"):
        Fault.of(Failure("strut1", "free"))


def test_a_loose_strut_is_the_plant_that_is_linearized_without_its_spring():
    """Force and spring gone: the same rates as in MuJoCo's own linearization."""
    nominal = nominal_model(load_model(), TestbedConfig())
    broken = Plant(load_model())
    sound = broken.linear()
    broken.break_loose(4)
    without = broken.linear()  # about the same pose, which it is about to leave
    assert nominal.spring is not None and nominal.preload is not None
    k = 6
    A = nominal.plant.A[k:] + np.outer(nominal.plant.B[k:, 4], nominal.spring[4])
    # The weight that the spring no longer carries turns with the flexures: 1e-4 of the stiffness.
    moved = np.linalg.solve(sound.C_twist[:, :k], without.C_twist[:, :k])  # of their coordinates
    np.testing.assert_allclose(
        A[:, :k] @ moved, moved @ without.A[k:, :k], atol=2e-4 * np.abs(A).max()
    )
    with pytest.raises(ValueError, match="needs a model with its spring"):
        fault_model(replace(nominal, spring=None), [Fault(4, "loose")])


def bench_of_springs(n: int = 3) -> NominalModel:
    """Three carts on springs, pushed by an actuator each; all are measured, in millimetres."""
    rng = np.random.default_rng(0)
    mass, coupling = np.diag(rng.uniform(1, 2, n)), rng.normal(size=(n, n))
    stiffness = 400 * np.eye(n) + 20 * coupling @ coupling.T
    lower = -np.linalg.solve(mass, np.hstack([stiffness, 0.1 * stiffness]))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [lower]])
    B = np.vstack([np.zeros((n, n)), 400 * np.linalg.inv(mass)])
    displacement = np.eye(n, 2 * n)
    plant = control.ss(A, B, 1e3 * displacement, 0)
    return NominalModel(plant, displacement, np.full(n, 0.01), period_s=2e-3, step_s=1e-3)


def test_several_sequences_of_commands_at_once_give_what_each_gives():
    commanded = np.random.default_rng(0).standard_normal((20, 6, 2))
    model = fault_model(GAUGES, [Fault(2, "locked")])
    together = outputs_of(model, commanded)
    for c in range(2):
        np.testing.assert_allclose(
            together[..., c], outputs_of(model, commanded[..., c]), atol=1e-6
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"plant": np.eye(2)}, "plant must be"),
        ({"plant": control.ss(np.eye(6), np.ones((6, 3)), np.ones((3, 6)), 0)}, r"\[q; q_dot\]"),
        ({"displacement": np.zeros((2, 6))}, "displacement must have shape"),
        ({"noise": np.array([1.0, 0.0, 1.0])}, "noise must be"),
        ({"period_s": 0.0}, "period_s must be"),
        ({"step_s": 1.0}, "step_s must not exceed period_s"),
    ],
)
def test_a_model_of_another_shape_is_refused_by_the_name_of_its_part(change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        replace(bench_of_springs(), **change)


@pytest.mark.parametrize("wrong", [(-1, "locked"), (0, "broken"), (0, "weak", 1.5)])
def test_a_fault_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match=r"^(actuator|kind|effectiveness) must"):
        Fault(*wrong)
