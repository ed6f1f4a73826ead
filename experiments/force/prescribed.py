"""A prescribed wrench: what the coils do not exert, and where the payload goes for want of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import scipy.linalg

from experiments.force.cases import LEVERED, Aims
from experiments.force.rig import Readings, hold
from experiments.hexapod.goal import MAJOR, SECONDARY
from experiments.hexapod.springs import elastic_system, strut_and_payload_stiffness
from prioritized import Failures
from sim import NOMINAL, Array, Failure, hexapod, load_model


@dataclass(frozen=True)
class Held:
    """Prescribed wrenches against one set of torques, one a row.

    Attributes:
        mapping: Where the torques come from. "rigid" knows no springs, and eq. (9) forbids what a
            free strut would have to bear; "elastic" leaves that to the strut's spring.
        torques: Of the coils, shape (D, 6), [N].
        lacking: What neither they nor a lock exert, [moment; force], shape (D, 6).
        readings: Of the simulation, a load for each wrench.
        predicted: Displacement at which all springs together balance what is lacking, shape (D, 6).
        unheld: Displacement if they had to balance all of it, shape (D, 6).
    """

    mapping: str
    torques: Array
    lacking: Array
    readings: Readings
    predicted: Array
    unheld: Array

    @property
    def simulated(self) -> Array:
        """Displacement [rotation; translation] of the payload at rest, shape (D, 6)."""
        return self.readings.displacement[:, -1]


def hold_prescribed(
    model: mujoco.MjModel,
    failures: Sequence[Failure],
    told: Failures,
    aims: Aims,
    mapping: str,
    torques: Array,
) -> Held:
    """Push the payload back with all of the aims.

    Args:
        model: The plant, from :func:`with_fixture`.
        failures: What is broken; not a strut's spring.
        told: What the prediction knows of it.
        aims: The wrenches.
        mapping: Where the torques come from, see :class:`Held`.
        torques: Of the coils, shape (D, 6), [N].
    """
    sound, locked = load_model(), sorted(told.locked)
    A, K = hexapod(sound).inverse_jacobian(NOMINAL), payload_stiffness(sound)
    # A lock leaves five directions to move in, and bears what comes across them.
    Z = scipy.linalg.null_space(A[locked]) if locked else np.eye(6)
    give = Z @ np.linalg.inv(Z.T @ K @ Z) @ Z.T
    missing = aims.wrench - torques @ A
    return Held(
        mapping=mapping,
        torques=torques,
        lacking=missing @ Z @ Z.T,
        readings=hold(model, failures, torques, aims.wrench),
        predicted=-missing @ give,
        unheld=-aims.wrench @ give,
    )


def elastic_torques(told: Failures, aims: Aims) -> Array:
    """Torques (D, 6) of a mapping that reckons with the springs, closest to the aims."""
    kin = elastic_system(load_model()).with_failures(told.locked, told.free).kinematics()
    mapping = kin.force_mapping(MAJOR, SECONDARY, secondary_weight=LEVERED)
    return kin.expand(mapping(aims.major, secondary_force=aims.secondary))


def payload_stiffness(model: mujoco.MjModel) -> Array:
    """K of all springs against the payload's displacement in base axes, shape (6, 6)."""
    of_struts_and_payload = strut_and_payload_stiffness(model)
    A = hexapod(model).inverse_jacobian(NOMINAL)
    return A.T @ of_struts_and_payload[:6, :6] @ A + of_struts_and_payload[6:, 6:]
