"""The rig of the testbed's own machine."""

from collections.abc import Sequence

from experiments.hexapod.columns import COLUMNS, MAJOR
from experiments.hexapod.controller import StrutMapping, controller_for, nominal_loops
from experiments.hexapod.fault_tolerance import STILL, elastic_system, nominal_model, supervisor
from experiments.hexapod.other_controller import control_task
from experiments.hexapod.simulation import simulated
from experiments.hexapod.testbed import Testbed, TestbedConfig
from experiments.robot.rig import Rig
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, by_kind
from ftc.goal import Goal
from ftc.supervisor import Supervisor, reconfigured_goal
from prioritized import Manipulability
from sim import hexapod, load_model


def hexapod_rig(size: float | None) -> Rig:
    """The testbed's own machine: detector, amplifiers, closed-form kinematics, goal W_a.

    `size` is the radius of its path, [rad]; None is that of the testbed's spiral.
    """
    model, bench = load_model(), TestbedConfig()
    loops = nominal_loops(model, bench)
    testbed, goal = Testbed(model, bench, loops), COLUMNS[0].goal
    geometry, elastic = hexapod(model), elastic_system(model)
    nominal = nominal_model(model, bench)

    def classified(faults: Sequence[Fault]) -> Manipulability:
        return elastic.with_failures(**by_kind(faults)).kinematics().manipulability(MAJOR)

    def supervised(dither: Dither | None) -> Supervisor:
        return supervisor(testbed, goal, dither=STILL if dither is None else dither)

    return Rig(
        title="University of Wyoming hexapod",
        model=model,
        actuators=tuple(f"strut{k}" for k in range(1, 7)),
        aliases=tuple((f"coil{k}",) for k in range(1, 7)),
        bodies=tuple(f"stem{k}" for k in range(1, 7)),
        major=tuple(MAJOR),
        goal=goal,
        nominal=nominal,
        watched=nominal,
        loops=loops,
        margins=loops,
        limits=None,
        feedforward=False,
        size=bench.spiral_radius_urad * 1e-6 if size is None else size,
        noise=bench.detector_noise_m / bench.focal_length_m,
        encoder_noise=bench.strut_sensor_noise_m,
        mapping=lambda known: StrutMapping(geometry, known, "constant"),
        controller=lambda known: controller_for(testbed, known, jacobian="constant"),
        supervisor=supervised,
        bench=lambda time_s, failures, seed: simulated(
            testbed, time_s, failures, seed, keep_qpos=True
        ),
        classified=classified,
        told=_told,
        task=control_task(testbed, goal),
    )


def _told(goal: Goal, fault: Fault, displacement: float) -> Goal:
    return reconfigured_goal(goal, [Diagnosis.told(fault, displacement)])
