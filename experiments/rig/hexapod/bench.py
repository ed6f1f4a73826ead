"""The hexapod in a loop: the settled plant with detector, gauges, amplifiers, floor, failures."""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, replace
from typing import Any

import mujoco
import numpy as np

from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from sim import Array, Bench, Failure, Plant, Pose, Reading


def settled(testbed: Testbed) -> Testbed:
    """The testbed with its machine settled, once for all runs that begin without current.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    plant = Plant(testbed.machine.model)
    plant.settle(testbed.bench.settling_s)
    return replace(testbed, inexact=replace(testbed.machine, rest=plant.data))


def simulated(
    testbed: Testbed,
    time_s: Array,
    failures: Sequence[Failure],
    seed: int,
    *,
    start_m: Array | None = None,
    floor_m_per_s2: Array | None = None,
    events: object = None,
) -> Bench:
    """The machine in the loop, settled: detector, gauges, amplifiers, and what happens to it.

    Args:
        testbed: The machine and the constants around it.
        time_s: Of each control tick, shape (N,): failures strike at their times.
        failures: What happens.
        seed: Of the noise of all sensors.
        start_m: As in :class:`SpiralRun`.
        floor_m_per_s2: Acceleration of the floor at each tick, shape (N, 3); None is at rest.
        events: What else happens; see :class:`sim.Bench`.
    """
    bench, ticks = testbed.bench, len(time_s)
    period_s, machine = bench.control_period_s, testbed.machine
    plant = Plant(machine.model)
    if machine.rest is not None and start_m is None:
        mujoco.mj_copyData(plant.data, plant.model, machine.rest)
    else:
        plant.settle(bench.settling_s, start_m)
    floors = [f for f in (floor_m_per_s2, machine.floor(ticks, period_s)) if f is not None]
    return Bench(
        plant,
        HexapodSensors(bench, seed, machine.zero_rad(ticks, period_s)),
        time_s=time_s,
        period_s=period_s,
        failures=failures,
        drives=machine.drives(testbed.model, testbed.amplifier().displacements, period_s),
        floor_m_per_s2=np.sum(floors, axis=0) if floors else None,
        delay_ticks=machine.delay_ticks,
        hysteresis=machine.hysteresis,
        keep_qpos=True,
        events=events,
    )


class HexapodSensors:
    """The detector behind the telescope, its zero (N, 2) adrift, and the gauges."""

    def __init__(self, bench: TestbedConfig, seed: int, zero_rad: Array) -> None:
        """Begin at the first tick; the seed is that of all noise."""
        self._detector, self._gauges = bench.detector(), bench.strut_sensors()
        # Sources of their own: whether gauges are read changes nothing of the detector's noise.
        self._detector_rng = np.random.default_rng(seed)
        self._gauge_rng = np.random.default_rng([seed, 1])
        self._zero_rad, self._tick = zero_rad, 0

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Pointing and displacements, with noise."""
        zero_rad, self._tick = self._zero_rad[self._tick], self._tick + 1
        return Reading(
            output=self._detector.read(pose.rotation, self._detector_rng) + zero_rad,
            displacement=self._gauges.read(displacements, self._gauge_rng),
        )

    def detecting(self, ticks: int) -> dict[str, Any]:
        """What the detector's first readings are made of, by names of kernels.h.

        Its optics, noise (N, 2) and zeros (N, 2); nothing is read yet.
        """
        noise = deepcopy(self._detector_rng).standard_normal((ticks, 2))
        return {
            **asdict(self._detector),
            "noise": noise,
            "zeros": np.ascontiguousarray(self._zero_rad),
        }

    def skip(self, ticks: int) -> None:
        """Go on as if so many ticks had been read."""
        self._detector_rng.standard_normal((ticks, 2))
        self._gauge_rng.standard_normal((ticks, 6))
        self._tick += ticks
