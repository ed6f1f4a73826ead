"""One closed-loop run: plant, sensors, controller; arrays come back, files are made elsewhere."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from experiments.bench import Bench
from experiments.compensator import Loop, design
from experiments.controller import Controller
from experiments.goal import Goal
from experiments.mapping import DisplacementForm, JacobianChoice, StrutMapping
from sim import (
    Array,
    Failure,
    Plant,
    hexapod,
    linearize,
    pointing_angles,
    secondary_motion,
)


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
        secondary: (N, 4) true [gamma_rad, t_x_m, t_y_m, t_z_m], relative to the settled pose.
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
    """The compensators, designed once on the sound plant with W_a and J_0.

    Raises:
        sim.ModelError: The machine is not a hexapod, or its pointing loops cannot be closed.
    """
    equal = StrutMapping(hexapod(model), Goal(joint_weight=(1.0,) * 6), "constant")
    sound = Plant(model)
    return design(linearize(sound.model, sound.data), equal.pointing_gain(), bench)


def track_spiral(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    goal: Goal,
    *,
    failures: Sequence[Failure] = (),
    reconfigured: Goal | None = None,
    stiffness: Array | None = None,
    jacobian: JacobianChoice = "analytic",
    form: DisplacementForm = "absolute",
    seed: int = 0,
    duration_s: float | None = None,
    start_m: Array | None = None,
    lead_in_s: float = 0.0,
    floor_m_per_s2: Array | None = None,
) -> Trajectory:
    """Track the spiral with the given secondary goal.

    Args:
        model: The machine; plant and controller each make their own of it.
        bench: Constants around the plant.
        loops: Compensators from :func:`nominal_loops`.
        goal: Weights, and the failures that the controller knows of from the start.
        failures: What happens to the plant, whether the controller knows or not.
        reconfigured: Goal that the controller goes over to at the first failure; None: it goes on.
        stiffness: Of the struts and the payload, for a goal with free struts; see
            :func:`experiments.springs.strut_and_payload_stiffness`.
        jacobian: Where the mapping takes its Jacobian from.
        form: How eq. (41) becomes a displacement.
        seed: Of the detector noise.
        duration_s: Only the first seconds of the spiral; None is all of it.
        start_m: Strut displacements (6,) that the coils hold when the run begins; None is no
            current. A failure at time 0 strikes there: this is how a strut locks off centre.
        lead_in_s: So long the closed loop points at zero before the spiral starts, failures of
            time 0 behind it and the floor at rest; it is not kept.
        floor_m_per_s2: Acceleration of the floor in base axes, held for a tick each, at least as
            long as the spiral, shape (N, 3); None is a floor at rest.

    Raises:
        ValueError: The floor's acceleration has not three columns, or ends before the spiral.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    time_s = bench.time_s(bench.duration_s if duration_s is None else duration_s)
    floor = None if floor_m_per_s2 is None else floor_m_per_s2[: len(time_s)]
    if floor is not None and floor.shape != (len(time_s), 3):
        raise ValueError(
            f"floor_m_per_s2 must have 3 columns and at least {len(time_s)} rows, "
            f"got the shape {floor.shape}"
        )
    desired_rad = bench.desired_rad(time_s)
    plant = Plant(model)
    amplifier = bench.amplifier(newton_per_m=float(model.actuator_gainprm[0, 0]))
    geometry = hexapod(model)

    def controller(goal: Goal) -> Controller:
        mapping = StrutMapping(geometry, goal, jacobian, stiffness, form)
        return Controller(loops, mapping, amplifier)

    before = controller(goal)
    after = before if reconfigured is None else controller(reconfigured)
    plant.settle(bench.settling_s, start_m)
    rng = np.random.default_rng(seed)
    lead_in = round(lead_in_s / bench.control_period_s)
    path = _Path(
        time_s=_after_rest(lead_in, time_s),
        desired_rad=_after_rest(lead_in, desired_rad),
        floor_m_per_s2=None if floor is None else _after_rest(lead_in, floor),
    )
    ticks = list(_ticks(plant, before, after, failures, bench, path, rng))
    return _trajectory(time_s, desired_rad, ticks[lead_in:])


class _Path(NamedTuple):
    """What drives a run, tick by tick; time stands still while the loop points at zero.

    A floor at rest is None.
    """

    time_s: Array
    desired_rad: Array
    floor_m_per_s2: Array | None


def _after_rest(ticks: int, signal: Array) -> Array:
    return np.concatenate([np.zeros((ticks, *signal.shape[1:])), signal])


class _Tick(NamedTuple):
    """What is kept of one control tick; angles are worked out afterwards, all at once."""

    rotation: Array
    translation_m: Array
    rotation_estimated: Array
    translation_estimated_m: Array
    measured_rad: Array
    strut_input_percent: Array
    strut_displacement_m: Array
    closure_residual_m: Array


def _ticks(
    plant: Plant,
    controller: Controller,
    reconfigured: Controller,
    failures: Sequence[Failure],
    bench: Bench,
    path: _Path,
    rng: np.random.Generator,
) -> Iterator[_Tick]:
    detector, state = bench.detector(), controller.start()
    to_come = sorted(failures, key=lambda failure: failure.time_s)
    ticks = zip(path.time_s, path.desired_rad, strict=True)
    for tick, (now, desired) in enumerate(ticks):
        while to_come and to_come[0].time_s <= now:
            to_come.pop(0).strike(plant)
            controller = reconfigured
        if path.floor_m_per_s2 is not None:
            plant.shake(path.floor_m_per_s2[tick])
        pose = plant.pose()
        measured = detector.read(pose.rotation, rng)
        state = controller.step(state, desired, measured)
        yield _Tick(
            rotation=pose.rotation,
            translation_m=pose.translation_m,
            rotation_estimated=state.pose.rotation,
            translation_estimated_m=state.pose.translation_m,
            measured_rad=measured,
            strut_input_percent=state.input_percent,
            strut_displacement_m=plant.strut_displacement_m(),
            closure_residual_m=np.asarray(plant.closure_residual_m()),
        )
        command_m = controller.amplifier.displacement_m(state.input_percent)
        plant.step(command_m, bench.control_period_s)


def _trajectory(time_s: Array, desired_rad: Array, ticks: list[_Tick]) -> Trajectory:
    kept = _Tick(*map(np.array, zip(*ticks, strict=True)))
    settled = kept.rotation[0].T
    return Trajectory(
        time_s=time_s,
        desired_rad=desired_rad,
        true_rad=pointing_angles(kept.rotation),
        measured_rad=kept.measured_rad,
        strut_input_percent=kept.strut_input_percent,
        strut_displacement_m=kept.strut_displacement_m,
        secondary=secondary_motion(
            kept.rotation @ settled, kept.translation_m - kept.translation_m[0]
        ),
        secondary_estimated=secondary_motion(kept.rotation_estimated, kept.translation_estimated_m),
        closure_residual_m=kept.closure_residual_m,
    )
