"""Rig of the testbed's hexapod: loops, diagnosis and plant."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fjh.rig.hexapod.closed_form import Hexapod, hexapod
from fjh.rig.hexapod.columns import COLUMNS, MAJOR
from fjh.rig.hexapod.controller import StrutMapping, controller_for, nominal_loops, task_coordinates
from fjh.rig.hexapod.fault_tolerance import (
    DITHER,
    STRUTS,
    UNUSED,
    elastic_system,
    nominal_model,
    with_suspension,
)
from fjh.rig.hexapod.machine import HexapodMachine
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.options import JacobianChoice
from fjh.rig.rig import Rig
from ftc import (
    ControlTask,
    Goal,
    PrioritizedController,
    SensorCheck,
    Supervisor,
    Unused,
    is_possible,
)
from ftc.control import Compensator, DisplacementForm, Margins
from ftc.fdi import DEFAULT_CONFIG, Dither, Fault, NominalModel, by_kind, monitor, of_actuators
from prioritized import ConstrainedSystem, Manipulability
from sim import NOMINAL, Array, Plant, Pose, load_model

_BEYOND = 2.0
"""Multiple of the detector's range beyond which a reading is implausible."""


@dataclass(frozen=True)
class HexapodControl:
    """Control loops of the hexapod, and models of its diagnosis.

    Attributes:
        testbed: Model of the controllers, constants of the testbed, compensators.
        goal: Goal without failures.
        nominal: Linear model from strut displacements to (alpha, beta).
        elastic: Healthy mechanism with its springs.
        jacobian: Jacobian of the controllers' mapping, "analytic" or "constant".
        form: How eq. (41) becomes a displacement.
        feedforward: Whether controllers add the demands of the inverse linear model; in the paper
            they do not.
        limits: Limits of the mapping; None: there are none.
        unused: Behavior of struts without force: held by the springs of the suspensions.
    """

    testbed: Testbed
    goal: Goal
    nominal: NominalModel
    elastic: ConstrainedSystem
    jacobian: JacobianChoice = "constant"
    form: DisplacementForm = "absolute"
    feedforward: bool = False
    limits: tuple[Array, Array] | None = field(default=None, init=False)
    unused: Unused = field(default=UNUSED, init=False)

    @property
    def diagnosis_model(self) -> NominalModel:
        """Linear model to the measurements of the diagnosis: the detector alone."""
        return self.nominal

    @property
    def loops(self) -> tuple[Compensator, Compensator]:
        """Compensators of alpha and beta."""
        return self.testbed.loops

    @property
    def margins(self) -> list[Margins]:
        """Stability margins of both loops; empty if the compensators have none."""
        return [loop for loop in self.testbed.loops if isinstance(loop, Margins)]

    def mapping(self, goal: Goal) -> StrutMapping:
        """Return the closed-form mapping for a goal, with the Jacobian of the nominal pose."""
        return StrutMapping(self._geometry, goal, "constant", self.testbed.stiffness)

    @cached_property
    def _geometry(self) -> Hexapod:
        return hexapod(self.testbed.model)

    def controller(self, goal: Goal) -> PrioritizedController[Pose]:
        """Return the controller for a goal, with the Jacobian and form of this object."""
        options = {"jacobian": self.jacobian, "form": self.form, "feedforward": self.feedforward}
        return controller_for(self.testbed, goal, **options)

    def supervisor(self, *, dither: Dither | None) -> Supervisor:
        """Return a controller whose diagnosis uses the detector alone."""
        bench = self.testbed.bench
        range_rad = bench.detector_half_width_m / bench.focal_length_m
        check = SensorCheck(bench.control_period_s, limits=(_BEYOND * range_rad,) * len(MAJOR))
        hz = None if dither is None else dither.frequency_hz
        return Supervisor(
            self.goal,
            self.controller,
            monitor(self.diagnosis_model, config=replace(DEFAULT_CONFIG, dither_hz=hz)),
            self._can,
            self.nominal,
            self.unused,
            dither,
            sensor_check=check,
        )

    def _can(self, faults: Sequence[Fault]) -> bool:
        return is_possible(self.classified(faults))

    def classified(self, faults: Sequence[Fault]) -> Manipulability:
        """Return the manipulability of the pointing task with these faults, springs included."""
        faults = of_actuators(faults, len(STRUTS))
        loose = {fault.actuator: 0.0 for fault in faults if fault.kind == "loose"}
        elastic = with_suspension(self.elastic, loose)
        return elastic.with_failures(**by_kind(faults)).kinematics().manipulability(MAJOR)


def nominal_testbed(bench: TestbedConfig | None = None) -> Testbed:
    """Return the paper's machine with these constants, and compensators designed for them."""
    model, around = load_model(), TestbedConfig() if bench is None else bench
    return Testbed(model, around, nominal_loops(model, around))


def pursuing(rig: Rig, goal: Goal, **control: Any) -> Rig:
    """Return a hexapod that shares the plant of another, with another goal of its controllers.

    `control` is `jacobian`, `form` or `feedforward` of :class:`HexapodControl`.
    """
    own, task = replace(rig.control, goal=goal, **control), replace(rig.task, goal=goal)
    return replace(rig, control=own, task=task)


def hexapod_rig(
    testbed: Testbed | None = None,
    goal: Goal = COLUMNS[0].goal,
    *,
    size: float | None = None,
    start_m: Array | None = None,
    floor_m_per_s2: Array | None = None,
    **control: Any,
) -> Rig:
    """Return the hexapod with a plant that equals the controllers' model.

    Args:
        testbed: Machine and constants; None is the paper's.
        goal: Goal without failures; W_a by default.
        size: Radius of the default path, [rad]; None is that of the testbed's spiral.
        start_m: Strut displacements at the start, as for :class:`HexapodMachine`.
        floor_m_per_s2: Acceleration of the floor, as for :class:`HexapodMachine`.
        control: `jacobian`, `form` and `feedforward` of :class:`HexapodControl`.
    """
    testbed = nominal_testbed() if testbed is None else testbed
    model, bench, drives = testbed.model, testbed.bench, testbed.amplifier()
    radius_rad, full = bench.spiral_radius_urad * 1e-6, np.full(model.nu, 100.0)
    nominal = nominal_model(model, bench)
    return Rig(
        title="University of Wyoming hexapod",
        model=model,
        actuators=tuple(own for own, _ in STRUTS),
        aliases=tuple((other,) for _, other in STRUTS),
        bodies=tuple(f"stem{k}" for k in range(1, 7)),
        units=("m",) * len(STRUTS),
        major=tuple(MAJOR),
        size=radius_rad if size is None else size,
        noise=bench.detector_noise_m / bench.focal_length_m,
        encoder_noise=bench.strut_sensor_noise_m,
        travel=Plant(model).limits(),
        task=ControlTask(
            nominal=nominal,
            J=np.linalg.inv(hexapod(model).posture(NOMINAL).inverse_jacobian),
            major=tuple(MAJOR),
            goal=goal,
            drives=drives,
            limits=(drives.displacements(-full), drives.displacements(full)),
            reference_limit=np.full(len(MAJOR), radius_rad),
        ),
        warnings=(),
        payload_body=int(model.site("payload").bodyid[0]),
        control=HexapodControl(testbed, goal, nominal, elastic_system(model), **control),
        machine=HexapodMachine(testbed, start_m=start_m, floor_m_per_s2=floor_m_per_s2),
        coordinates=task_coordinates,
        dither=DITHER,
    )
