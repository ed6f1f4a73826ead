"""The hexapod as fault detection and isolation takes it, and its faults in words."""

from typing import Any

import control
import mujoco
import numpy as np

from experiments.hexapod.columns import MAJOR
from experiments.hexapod.testbed import Bench
from ftc.fdi.fault_model import KINDS, Fault, NominalModel
from sim import Failure, Plant, linearize


def nominal_model(
    model: mujoco.MjModel, bench: Bench, *, strut_sensors: bool = False
) -> NominalModel:
    """The linear model of the machine without failures.

    Args:
        model: The machine.
        bench: Periods and noise.
        strut_sensors: Whether the outputs are (alpha, beta) and then the six gauges beside the
            struts, or (alpha, beta) alone.
    """
    plant = Plant(model)
    linear = linearize(plant.model, plant.data)
    rows = [linear.C_twist[MAJOR]]
    noise = [np.full(2, bench.detector_noise_m / bench.focal_length_m)]
    if strut_sensors:
        rows.append(linear.C_active)
        noise.append(np.full(len(linear.C_active), bench.strut_sensor_noise_m))
    return NominalModel(
        plant=control.ss(linear.A, linear.B, np.vstack(rows), 0),
        displacement=linear.C_active,
        noise=np.concatenate(noise),
        period_s=bench.control_period_s,
        step_s=float(model.opt.timestep),
    )


def fault_of(failure: Failure) -> Fault:
    """The fault that a failure leaves behind: what there is to find.

    Raises:
        ValueError: A strut that breaks loose is not among the kinds that are looked for.
    """
    if failure.kind == "loose":
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {failure.kind}")
    return Fault(failure.strut, failure.kind, failure.strength if failure.kind == "weak" else 0.0)


def fault_text(fault: Fault | None) -> str:
    """A fault in words, its strut 1 to 6; None is no fault."""
    if fault is None:
        return "sound"
    left = f" to {100 * fault.effectiveness:.0f} %" if fault.kind == "weak" else ""
    return f"strut {fault.actuator + 1} {fault.kind}{left}"


def fault_entry(fault: Fault) -> dict[str, Any]:
    """A fault ready for JSON, its strut 1 to 6."""
    left = {"strength": fault.effectiveness} if fault.kind == "weak" else {}
    return {"strut": fault.actuator + 1, "kind": fault.kind} | left
