"""Actuator faults of any sampled linear plant: what each does to its input.

For plants whose states are not positions and velocities, as an aircraft's. An actuator acts through
its column of B alone: free, the column is zero; weak, it is multiplied by what is left; locked,
it stays where the last command before had put it, as a control surface that is stuck.
"""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from ftc.fdi.fault_model import Fault, FaultModel, of_actuators
from ftc.fdi.isolation.bank import HypothesisBank
from ftc.fdi.isolation.hypotheses import bank_of

if TYPE_CHECKING:
    import control


def input_fault_model(
    plant: "control.StateSpace", noise: ArrayLike, faults: Sequence[Fault] = ()
) -> FaultModel:
    """The plant with these faults, states [x; held]: `held` are the last commands, n of them.

    Args:
        plant: Sampled, without feedthrough, with n inputs and p outputs.
        noise: Standard deviation of each output's white noise, shape (p,).
        faults: The faults.

    Raises:
        ValueError, TypeError: Of another shape or kind than that.
    """
    import control  # late, as in ftc.compensator

    check.instance("plant", plant, control.StateSpace)
    if not plant.isdtime(strict=True) or plant.D.any():
        raise ValueError(f"plant must be sampled and without feedthrough, got {check.shown(plant)}")
    sigma = check.all_positive("noise", noise, plant.noutputs)
    n, s = plant.ninputs, plant.nstates
    left, stuck = np.ones(n), np.zeros(n)
    for fault in of_actuators(faults, n):
        k = fault.actuator
        if fault.kind == "locked":
            stuck[k] = 1.0
        else:
            left[k] *= fault.effectiveness if fault.kind == "weak" else 0.0
    B = plant.B * left
    return FaultModel(
        A=np.block([[plant.A, B * stuck], [np.zeros((n, s)), np.diag(stuck)]]),
        B=np.vstack([B * (1 - stuck), np.diag(1 - stuck)]),
        C=np.hstack([plant.C / sigma[:, None], np.zeros((plant.noutputs, n))]),
        onset=np.eye(s + n),
        drift=np.zeros(s + n),
    )


def input_fault_bank(
    plant: "control.StateSpace", noise: ArrayLike, faults: Sequence[Fault] = ()
) -> HypothesisBank:
    """Hypotheses of one more fault beside those that are known.

    Args:
        plant: As of :func:`input_fault_model`.
        noise: Likewise.
        faults: Those known; a weak actuator may still fail.

    Raises:
        ValueError, TypeError: As of that, or no actuator is left that could fail.
    """
    input_fault_model(plant, noise, faults)  # refuses what is wrong
    return bank_of(partial(input_fault_model, plant, noise), plant.ninputs, faults)
