"""One closed-loop run: plant, sensors, controller; arrays come back, files are made elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.bench import Bench
from experiments.compensator import Loop, design
from experiments.controller import Controller
from experiments.mapping import Goal, JacobianChoice, StrutMapping
from sim import (
    Array,
    Plant,
    hexapod,
    linearize,
    pointing_angles,
    secondary_motion,
)

SETTLING_S = 0.5
"""Rest before a run: fifteen periods of the slowest mode, for the last nanometres of sag."""


@dataclass(frozen=True)
class Trajectory:
    """What happened, at every control tick.

    Attributes:
        time_s: (N,).
        desired_rad: (N, 2) spiral (alpha, beta).
        true_rad: (N, 2) pointing of the payload.
        measured_rad: (N, 2) the detector's reading.
        strut_input_percent: (N, 6) normalized current sent from this tick on.
        strut_displacement_m: (N, 6) true strut extensions.
        secondary: (N, 4) true [gamma_rad, t_x_m, t_y_m, t_z_m], from the settled pose.
        secondary_estimated: (N, 4) the same as the controller estimates it.
        closure_residual_m: (N,) largest gap of a closed loop.
    """

    time_s: Array
    desired_rad: Array
    true_rad: Array
    measured_rad: Array
    strut_input_percent: Array
    strut_displacement_m: Array
    secondary: Array
    secondary_estimated: Array
    closure_residual_m: Array


def nominal_loops(model: mujoco.MjModel, bench: Bench) -> tuple[Loop, Loop]:
    """The compensators, designed once on the sound plant with W_a and J_0."""
    sound = Plant(model)
    equal = StrutMapping(hexapod(model), Goal(joint_weight=(1.0,) * 6), "constant")
    return design(linearize(sound.model, sound.data), equal.pointing_gain(), bench)


def track_spiral(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    goal: Goal,
    *,
    locked: Sequence[int] = (),
    jacobian: JacobianChoice = "analytic",
    seed: int = 0,
    duration_s: float | None = None,
) -> Trajectory:
    """Track the spiral with the given secondary goal.

    Args:
        model: The machine; plant and controller each make their own of it.
        bench: Constants around the plant.
        loops: Compensators from :func:`nominal_loops`.
        goal: Weights, and the failures that the controller knows of.
        locked: Struts 0..5 that lock at the start, whether the controller knows or not.
        jacobian: Where the mapping takes its Jacobian from.
        seed: Of the detector noise.
        duration_s: Only the first seconds of the spiral; None is all of it.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    plant, detector = Plant(model), bench.detector()
    amplifier = bench.amplifier()
    controller = Controller(loops, StrutMapping(hexapod(model), goal, jacobian), amplifier)
    rng = np.random.default_rng(seed)
    state = controller.start()
    plant.settle(SETTLING_S)
    for strut in locked:
        plant.lock(strut)

    time_s = bench.time_s(bench.duration_s if duration_s is None else duration_s)
    desired_rad = bench.desired_rad(time_s)
    ticks = []
    for desired in desired_rad:
        pose = plant.pose()
        measured = detector.read(pose.rotation, rng)
        state = controller.step(state, desired, measured)
        ticks.append(
            (
                pose.rotation,
                pose.translation_m,
                state.pose.rotation,
                state.pose.translation_m,
                measured,
                state.input_percent,
                plant.strut_displacement_m(),
                plant.closure_residual_m(),
            )
        )
        command = amplifier.displacement_m(state.input_percent)
        plant.step(command, bench.control_period_s)
    R, t, R_estimated, t_estimated, *signals = map(np.array, zip(*ticks, strict=True))
    measured_rad, strut_input_percent, strut_displacement_m, closure_residual_m = signals
    return Trajectory(
        time_s=time_s,
        desired_rad=desired_rad,
        true_rad=pointing_angles(R),
        measured_rad=measured_rad,
        strut_input_percent=strut_input_percent,
        strut_displacement_m=strut_displacement_m,
        secondary=secondary_motion(R, t - t[0]),
        secondary_estimated=secondary_motion(R_estimated, t_estimated),
        closure_residual_m=closure_residual_m,
    )
