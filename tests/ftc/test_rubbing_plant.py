"""The model with dry friction moves as MuJoCo's plant does, step for step."""

from dataclasses import replace

import control
import numpy as np
import pytest

from ftc.fdi import Fault, NominalModel, fault_model
from sim import Plant
from tests.sim.machines import plant_of

PERIOD_S = 2e-3


def nominal_of(plant: Plant) -> NominalModel:
    """Its linear model to the displacements, with what rubs."""
    linear = plant.linear()
    assert linear.friction is not None
    return NominalModel(
        control.ss(linear.A, linear.B, linear.C_active, 0),
        linear.C_active,
        np.full(2, 1e-6),
        PERIOD_S,
        plant.model.opt.timestep,
        feedback=linear.feedback,
        holding=linear.holding,
        implicit_damping=plant.implicit_damping,
        friction=linear.friction,
    )


@pytest.mark.parametrize("integrator", ["implicitfast", "Euler"])
@pytest.mark.parametrize("fault", [None, Fault(1, "locked"), Fault(1, "free")])
def test_the_model_moves_as_the_plant(tmp_path, integrator, fault):
    """Sticking, slipping and creeping alike, before and after a failure; the lock is a soft one."""
    plant = plant_of(tmp_path, integrator)
    nominal = nominal_of(plant)
    before, after = fault_model(nominal), fault_model(nominal, [fault] if fault else [])
    frictionless = fault_model(replace(nominal, friction=None))
    x, smooth, moved, expected, left_out = np.zeros(4), np.zeros(4), [], [], []
    for tick in range(300):
        if tick == 150 and fault is not None:
            x = after.onset @ x
            plant.lock(1) if fault.kind == "locked" else plant.release(1)
        command = 1e-3 * np.array([np.sin(0.03 * tick), 1 - np.cos(0.05 * tick)])
        plant.step(command, PERIOD_S)
        x = (before if tick < 150 else after).step(x, command)
        smooth = frictionless.step(smooth, command)
        moved.append(plant.displacements())
        expected.append(nominal.displacement @ x)
        left_out.append(nominal.displacement @ smooth)
    size = np.abs(moved).max()
    assert np.abs(np.subtract(moved, expected)).max() < 0.02 * size
    assert (
        np.abs(np.subtract(moved[:150], expected[:150])).max() < 3e-3 * size
    )  # Euler makes the dampers of joints alone implicit
    assert np.abs(np.subtract(moved[:150], left_out[:150])).max() > 0.1 * size
