"""What is as sudden as a failure, and none: null models of a bank of hypotheses."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from argument_checks import Array
from ftc.fdi.fault_model import at_rest
from ftc.fdi.uncertainty import UncertainModel, Uncertainty


@dataclass(frozen=True)
class Cause:
    """What changes the outputs suddenly and is no failure that asks for another mapping.

    Attributes:
        kind: An actuator works from another zero, which may move; all commands do more or less than
            before; all sensors show more or less.
        actuator: Which one, of an offset.
    """

    kind: Literal["offset", "supply", "scale"]
    actuator: int = -1


def causes_of(left: Array, beside: Uncertainty) -> list[Cause]:
    """What may happen that is no failure; what all actuators share needs two of them."""
    working = np.flatnonzero(left).tolist()
    causes = [Cause("offset", k) for k in working if beside.command > 0]
    causes += [Cause("supply")] if beside.supply > 0 and len(working) > 1 else []
    return causes + ([Cause("scale")] if beside.scale > 0 else [])


def own_drives(
    believed: UncertainModel,
    cause: Cause,
    inputs: Array,
    beside: Uncertainty,
    sample_s: float,
) -> Array:
    """[M; N] of the two parameters of its own, one standard deviation each, (2, s + p, s + r)."""
    driven, s = np.vstack([believed.M[0], believed.N[0]]), len(believed.A)
    own, k = np.zeros((2, *driven.shape)), cause.actuator
    if cause.kind == "offset":
        own[0, :, -1] = inputs[k] * driven[:, s + k]
        own[1, :, -1] = sample_s * own[0, :, -1]
    if cause.kind == "supply":
        own[0, :, s:-1] = beside.supply * driven[:, s:-1]
    if cause.kind == "scale":
        own[0] = beside.scale * driven
    return own


def seen(believed: UncertainModel, n: int) -> Array:
    """By how much a constant unit command moves the outputs in the end, shape (n,)."""
    s = len(believed.A)
    B, D = believed.M[0, :, s : s + n], believed.N[0, :, s : s + n]
    return np.linalg.norm(believed.C @ at_rest(believed.A, B) + D, axis=0)
