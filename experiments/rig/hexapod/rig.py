"""The rig of the testbed's own machine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import argument_checks as check
from experiments.rig.dither import dither_of
from experiments.rig.hexapod.bench import settled, simulated
from experiments.rig.hexapod.choices import STRUTS
from experiments.rig.hexapod.columns import COLUMNS, MAJOR
from experiments.rig.hexapod.compiled_loop import begun
from experiments.rig.hexapod.controller import StrutMapping, controller_for, nominal_loops
from experiments.rig.hexapod.fault_tolerance import (
    DITHER,
    UNUSED,
    elastic_system,
    nominal_model,
    with_suspension,
)
from experiments.rig.hexapod.mismatch import ALL, mismatched
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.mismatch import EXACT, Known, Mismatch, sizes_of
from experiments.rig.rig import Rig
from experiments.rig.run import after_rest
from ftc.control.compensator import Margins
from ftc.control_task import ControlTask
from ftc.controller import PrioritizedController
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, by_kind, of_actuators
from ftc.goal import Goal
from ftc.loop import LoopRun
from ftc.sensor_check import SensorCheck
from ftc.sensors import SensorChecks
from ftc.supervisor import Supervisor, supervisor_for
from ftc.tracking import is_possible
from prioritized import ConstrainedSystem, Manipulability
from sim import (
    NOMINAL,
    Array,
    Bench,
    Failure,
    Hexapod,
    Plant,
    Pose,
    hexapod,
    load_model,
    pointing_angles,
)

_BEYOND = 2.0
"""Times the detector's range: it cannot read so much."""


@dataclass(frozen=True, repr=False)
class HexapodRig(Rig):
    """The hexapod.

    Attributes:
        testbed: The machine, the constants around it, compensators.
        elastic: The machine with its springs, without failures.
        start_m: Strut displacements (6,) that the coils hold when a flight begins; None is no
            current.
        floor_m_per_s2: Acceleration of the floor at each tick of a flight's path, shape (N, 3), at
            rest before it; None is a floor at rest.
    """

    testbed: Testbed
    elastic: ConstrainedSystem
    start_m: Array | None = None
    floor_m_per_s2: Array | None = None

    def drawn(self, mismatch: Known | Mismatch, seed: int) -> "HexapodRig":
        """The same with a plant that differs so; floor and hysteresis included."""
        sizes = sizes_of(mismatch, ALL, ("drift_per_s", "steps"))
        testbed, seed = replace(self.testbed, inexact=None), check.index("seed", seed)
        if sizes != EXACT:
            testbed = mismatched(testbed, sizes, seed)
        return replace(self, testbed=testbed)

    def mapping(self, goal: Goal) -> StrutMapping:
        """In closed form, with the constant Jacobian."""
        return StrutMapping(self._geometry, self._goal(goal), "constant")

    @cached_property
    def _geometry(self) -> Hexapod:
        return hexapod(self.model)

    def controller(self, goal: Goal | None = None) -> PrioritizedController[Pose]:
        """With the constant Jacobian."""
        how = {"jacobian": "constant", "feedforward": self.feedforward}
        return controller_for(self.testbed, self._goal(goal), **how)

    def supervisor(
        self, dither: str | Dither | None = "default", goal: Goal | None = None
    ) -> Supervisor:
        """By detector alone, whose heave finds failures sooner."""
        bench = self.testbed.bench
        range_rad = bench.detector_half_width_m / bench.focal_length_m
        check = SensorCheck(self.period_s, limits=(_BEYOND * range_rad,) * len(self.major))
        return supervisor_for(
            self._goal(goal),
            self.controller,
            self.watched,
            self._can,
            self.nominal,
            unused=self.unused,
            dither=dither_of(self, dither, DITHER),
            sensor_checks=SensorChecks(check),
        )

    def _can(self, faults: Sequence[Fault]) -> bool:
        return is_possible(self.classified(faults))

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """The machine, settled."""
        time_s, seed = check.series("time_s", time_s), check.index("seed", seed)
        floor = self.floor_m_per_s2
        if floor is not None:
            floor = after_rest(len(time_s) - len(floor), floor)
        around = {"start_m": self.start_m, "floor_m_per_s2": floor}
        return simulated(self._settled, time_s, failures, seed, events=events, **around)

    def begun(
        self,
        bench: Bench,
        pilot: Any,
        reference: Array,
        feedforward: Array | None,
        on_tick: Callable[[int], None] | None,
    ) -> LoopRun[Any] | None:
        """In compiled code."""
        return begun(bench, pilot, reference, feedforward, on_tick)

    @cached_property
    def _settled(self) -> Testbed:
        """Flights begin with copies of its rest, if they begin without current."""
        known = self.testbed.machine.rest is not None or self.start_m is not None
        return self.testbed if known else settled(self.testbed)

    @property
    def payload_body(self) -> int:
        """Of the site "payload"."""
        return int(self.model.site("payload").bodyid[0])

    def reached(self, pose: Pose) -> Array:
        """Where the payload points, (alpha, beta)."""
        return pointing_angles(check.instance("pose", pose, Pose).rotation)

    def classified(self, faults: Sequence[Fault]) -> Manipulability:
        """What is left, springs included."""
        faults = of_actuators(faults, len(self.actuators))
        loose = {fault.actuator: 0.0 for fault in faults if fault.kind == "loose"}
        elastic = with_suspension(self.elastic, loose)
        return elastic.with_failures(**by_kind(faults)).kinematics().manipulability(MAJOR)


def hexapod_rig(size: float | None = None, feedforward: bool = False) -> HexapodRig:
    """The hexapod on its exact plant, with goal W_a; see :meth:`.Rig.hexapod`."""
    model, bench = load_model(), TestbedConfig()
    testbed = Testbed(model, bench, nominal_loops(model, bench))
    return rig_of(testbed, size=size, feedforward=feedforward)


def rig_of(
    testbed: Testbed,
    goal: Goal = COLUMNS[0].goal,
    *,
    size: float | None = None,
    feedforward: bool = False,
) -> HexapodRig:
    """The rig of a testbed, for W_a or another goal; the rest as of :meth:`.Rig.hexapod`."""
    model, bench, drives = testbed.model, testbed.bench, testbed.amplifier()
    radius_rad, full = bench.spiral_radius_urad * 1e-6, np.full(model.nu, 100.0)
    nominal = nominal_model(model, bench)
    return HexapodRig(
        title="University of Wyoming hexapod",
        model=model,
        actuators=tuple(own for own, _ in STRUTS),
        aliases=tuple((other,) for _, other in STRUTS),
        bodies=tuple(f"stem{k}" for k in range(1, 7)),
        units=("m",) * len(STRUTS),
        major=tuple(MAJOR),
        goal=goal,
        nominal=nominal,
        watched=nominal,
        loops=testbed.loops,
        margins=[each for each in testbed.loops if isinstance(each, Margins)],
        limits=None,
        feedforward=feedforward,
        size=radius_rad if size is None else size,
        noise=bench.detector_noise_m / bench.focal_length_m,
        encoder_noise=bench.strut_sensor_noise_m,
        travel=Plant(model).limits(),
        unused=UNUSED,
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
        part=None,
        testbed=testbed,
        elastic=elastic_system(model),
    )
