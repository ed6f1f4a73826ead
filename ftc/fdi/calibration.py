"""Actuator gains from a commissioning run, so that the model is exact enough for diagnosis."""

import numpy as np

from argument_checks import Array
from ftc.fdi.fault_model import NominalModel, fault_model


def calibrated(nominal: NominalModel, commanded: Array, outputs: Array) -> NominalModel:
    """The model with each actuator's gain fitted to the outputs by linear least squares.

    Args:
        nominal: Before the calibration.
        commanded: Displacements from each tick on, shape (N, n); they must move every actuator on
            its own, combinations that the outputs hardly show included.
        outputs: Whitened, as measured, shape (N, p).
    """
    alone = commanded[:, :, None] * np.eye(nominal.actuators)
    by_actuator = fault_model(nominal).outputs(alone).reshape(outputs.size, nominal.actuators)
    return nominal.with_gains(np.linalg.lstsq(by_actuator, outputs.ravel(), rcond=None)[0])
