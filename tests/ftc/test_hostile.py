"""Hostile arguments of `ftc` give one error message or finite numbers."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import control
import numpy as np

import ftc
from ftc import Goal, GuardedController, Supervisor, fdi, tracking
from ftc import control as loops
from ftc.control.anti_windup import tracking_gain
from ftc.control.geometry import MechanismGeometry
from ftc.fdi import Cost, Diagnosis, Dither, Fault, NominalModel, Uncertainty, fault_model, monitor
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.fault_model import resting_displacements, static_gain
from tests.ftc.small_stage import (
    DESIRED,
    GOAL,
    LIMITS,
    LOADED,
    PERIOD_S,
    READ,
    SHAPE,
    STILL,
    J,
    Stage,
    Still,
    simulate,
    stage,
)
from tests.hostile import Package, one_by_one, public, two_at_once

M1, N = J.shape[0] - 1, J.shape[1]
AT_REST: dict[str, Any] = {"reference": DESIRED, "measurement": READ}


def monitor_step(state: Any, measured: Any, commanded: Any) -> Any:
    """Return residuals and commands of a monitor after steps with these arguments."""
    fdi_monitor = stage().fdi_monitor
    for _ in range(3 * fdi_monitor.ticks):
        state = fdi_monitor.step(state, measured, commanded)
    return state.observer.residual, state.last_commanded


def nominal_model_of(lower: Any, drive: Any, C: Any) -> Any:
    """Return the response of a model given by matrices; translate errors of python-control."""
    try:
        rows = [np.eye(N, 2 * N, N), np.asarray(lower)]
        plant = control.ss(np.vstack(rows), np.vstack([np.zeros((N, N)), drive]), C, 0)
    except Exception:
        raise ValueError("lower, drive and C must be of a plant") from None
    try:
        return broken(NominalModel(**(stage().model | {"plant": plant})))
    except ValueError as error:
        raise ValueError(f"lower, drive and C: {error}") from None


def friction_model(push: Any, rows: Any, limit: Any, softness: Any, rate: Any) -> Any:
    """Return a model with friction given by arrays."""
    return NominalModel(**stage().model, friction=(push, rows, limit, softness, rate))


def goal_of(joint_weight: Any, secondary_weight: Any, locked_at: Any, effectiveness: Any) -> Any:
    """Return a goal given by numbers."""
    return Goal(joint_weight, secondary_weight, {0: locked_at}, effectiveness={1: effectiveness})


def tracking_of(A: Any, B: Any, C_twist: Any, C_active: Any) -> Any:
    """Return tracking with a linear model given by matrices."""
    linear = SimpleNamespace(A=A, B=B, C_twist=C_twist, C_active=C_active)
    return tracking(**{**package().special["tracking"], "linear": linear})


TRUSTED = {
    # Made only by loops and controllers.
    *("LoopRun", "NestedState", "Sensors", "Sensors.after", "Sensors.sentence"),
    *("SupervisorState", "Diagnosis", "Fault.of"),
    # Used by `fjh` or `tracking` with checked arguments.
    *("Stage", "steps", "one_tick", "mapping_for", "Tracking", "explanation"),
    *("deciding_sentence", "is_possible", "SensorCheck.start", "SensorCheck.step", "Cost.limits"),
    # Called by controllers with checked arguments.
    *(f"LocalGeometry.{name}" for name in ("jacobians", "twist", "moved")),
    *(f"MechanismGeometry.{name}" for name in ("jacobians", "twist", "moved")),
    *("PrioritizedMapping.displacements", "PrioritizedMapping.tick", "PrioritizedMapping.followed"),
    *("PrioritizedMapping.major_motion", "PrioritizedMapping.reached", "PrioritizedMapping.split"),
    *("PrioritizedMapping.estimate", "PrioritizedMapping.at"),
    *("DirectDrive.inputs", "DirectDrive.displacements"),
}
TARGETS = public(
    *(ftc, loops.sensitivity_peak, loops.circle_margin, tracking_gain, monitor_step),
    *(resting_displacements, FdiConfig, Diagnosis, Dither, MechanismGeometry, Fault, NominalModel),
    *(fault_model, monitor, Uncertainty, fdi.separations, Cost, fdi.designed_dither, static_gain),
    *(fdi.ranked_sensors, fdi.static_share, nominal_model_of, goal_of, tracking_of, friction_model),
    trusted=TRUSTED,
)


def equal_weights(kinematics: Any) -> Any:
    """Return another allocation for the mechanism of these tests."""
    return kinematics.velocity_mapping([0, 1], [2])


def after_some_samples(config: FdiConfig) -> Any:
    """Return residuals and estimates of a monitor after some samples of zeros."""
    fdi_monitor = monitor(stage().nominal, config=config)
    state = fdi_monitor.start()
    for _ in range(min(3 * fdi_monitor.ticks, 100)):
        state = fdi_monitor.step(state, np.zeros(M1), STILL)
    return state.observer.residual, state.observer.parameters.mean, state.last_commanded


def broken(nominal: NominalModel) -> Any:
    """Return models with and without failures."""
    faulty = fault_model(nominal, [Fault(0, "locked"), Fault(1, "free")])
    faulty = replace(faulty, dry_friction=None)
    return fault_model(nominal), faulty, nominal.noise, nominal.displacement


def mapped(mapping: Any) -> Any:
    """Return gains and displacements of a mapping."""
    gain = mapping.major_gain()
    return gain, mapping.displacements(np.full(gain.shape[1], 0.1), STILL, STILL)


def on_three(geometry: Any) -> Any:
    """Return the pose for three displacements."""
    return geometry.moved(geometry.nominal, STILL), geometry.system.J_T


def separated(result: Any) -> Any:
    return result.distance, result.from_none, result.between_actuators


@cache
def package() -> Package:
    """Return valid arguments of the small stage by parameter name."""
    s = stage()
    gained = control.ss(s.plant.A, s.plant.B @ s.plain.mapping.major_gain(), s.plant.C, 0)
    sampled, C = control.c2d(gained, PERIOD_S), np.asarray(s.plant.C)
    faults, known = [Fault(0, "weak", 0.5)], [Diagnosis.known(Fault(0, "locked"), 1e-3)]
    sinusoid = Dither(1e-3, 20.0, (1.0, -1.0, 1.0))
    linear = {"A": s.A, "B": s.B, "C_twist": np.hstack([J, 0 * J]), "C_active": np.eye(N, 2 * N)}
    tracked: dict[str, Any] = {"model": Stage(), "linear": SimpleNamespace(**linear)}
    tracked |= {"major": [0, 1], "noise": np.full(M1, 1e-3), "period_s": PERIOD_S}
    tracked |= {"step_s": PERIOD_S, "goal": GOAL, "crossover_hz": 5.0}
    cost = {"largest_displacement": 1e-3, "task": C, "largest_task_motion": np.array([1e-4, 1e-3])}
    state, swinging = s.supervisor.start(), Supervisor(**s.supervised, dither=sinusoid)
    oracle = ftc.OracleController(**s.oracle)

    learned, machine = swinging.start(), Still()
    for _ in range(900):
        learned = swinging.step(learned, 0 * DESIRED, machine.measure())

    def stepped(**given: Any) -> Any:
        return s.supervisor.step(**{"state": state, **AT_REST, **given}).inputs

    good = {
        **AT_REST,
        **{"secondary_reference": STILL, "unused_reference": STILL, "retained": STILL},
        **{"feedforward": DESIRED, "lost_displacements": STILL, "acting": STILL, "secondary": [2]},
        **{"state": s.plain.start(), "loops": [s.loop] * M1, "mapping": s.mapping(limits=LIMITS)},
        **{"drives": ftc.DirectDrive(), "handover_s": 0.1, "demand_limit": 1.0},
        **{"anti_windup": True, "reference_feedforward": True},
        **{"name": "own", "task": s.task, "factory": lambda task: s.plain},
        **{"goal": GOAL, "path": np.ones((4, 2)), "estimate": lambda *_: DESIRED},
        "diagnosis_outputs": lambda read, *_: read.output,
        **{"sensor_check": ftc.SensorCheck(PERIOD_S), "dither": sinusoid, "diagnoses": known},
        **{"time_s": 0.5, "nominal": s.nominal, "faults": faults, "fault": faults[0]},
        **{"machine": machine, "geometry": s.geometry},
        **{"major": [0, 1], "form": "gauss_newton", "limits": LIMITS, "when_limited": "scaled"},
        **{"allocate": equal_weights, "model": Stage(), "plant": s.channel, "shape": SHAPE},
        **{"period_s": PERIOD_S, "system": s.system, "actuator": 0},
        **{"kind": "weak", "effectiveness": 0.5, "gain": s.plain.mapping.major_gain()},
        **{"commanded": STILL, "channel": s.loop},
        **{"L": control.c2d(s.channel, PERIOD_S) * s.loop.discrete, "C": C},
        **{"noise": s.nominal.noise, "compensators": [s.loop] * M1, "amplitude": 1.0},
        **{"frequency_hz": 20.0, "direction": np.ones(N), "offset": np.ones(N)},
        **{"freedom": np.eye(N)[:, :1], "frequencies_hz": np.array([8.0]), "cost": Cost(**cost)},
        **{"lower": s.lower, "drive": s.drive, "candidates": {"one": (np.eye(2 * N)[0], 1e-5)}},
        **{"measured": np.zeros(M1), "uncertainty": Uncertainty(gain=0.03, delay_s=1e-3)},
        **{"joint_weight": (1.0,) * N, "secondary_weight": (1.0,)},
        **{"actuators": N, "displacement": 1e-3},
        **dict(zip(("push", "rows", "limit", "softness", "rate"), LOADED["friction"], strict=True)),
    }
    special: dict[str, dict[str, Any]] = {
        "PrioritizedMapping": {"task": lambda pose: pose},
        "Measurement": vars(READ),
        "GuardedController.step": {"state": s.guarded.start()},
        "OracleController": s.oracle,
        "OracleController.step": {"self": oracle, "state": oracle.start()},
        "Supervisor": s.supervised | {"task": s.nominal, "unused": "locked"},
        "Supervisor.step": {"state": state},
        "Supervisor.calibrated": {"state": learned},
        "Supervisor.transfer of a supervisor's": {"state": state},
        "Supervisor.secondary": {"self": swinging},
        "run_loop": {"controller": s.plain, "log": lambda state: state.inputs}
        | dict.fromkeys(("reference", "feedforward"), np.ones((3, M1))),
        "LoopShape": vars(SHAPE),
        "ControlTask": vars(s.task),
        "Goal": {"locked_at": {0: 1e-3}, "effectiveness": {1: 0.5}},
        "goal_of": {"joint_weight": np.ones(N), "secondary_weight": np.ones(1), "locked_at": 1e-3},
        "MechanismGeometry": {"free": (0,)},
        "NominalModel": s.model | LOADED | {"names": [f"motor{k}" for k in range(N)]},
        "NominalModel without loads": s.model,
        "tracking": tracked | {"sense": "task"},
        "tracking with options": {"limits": LIMITS, "springs": False, "sense": "joints"}
        | {"noise": np.ones(N), "unused": "free", "feedforward": True}
        | {name: tracked[name] for name in tracked if name != "noise"},
        "tracking_of": linear,
        "sensitivity_peak": {"L": sampled * control.append(s.loop.discrete, s.loop.discrete)},
        "circle_margin": {"plant": sampled},
        "monitor_step": {"state": s.fdi_monitor.start()},
        "FdiConfig": vars(fdi.DEFAULT_CONFIG) | {"dither_hz": 20.0},
        "SensorCheck": {"limits": np.ones(2)},
        "Uncertainty": dict.fromkeys(vars(Uncertainty()), 0.1) | {"delay_s": 1e-3},
        "Cost": cost,
    }
    objects = {
        **{"PrioritizedController": s.plain, "GuardedController": s.guarded, "Dither": sinusoid},
        **{"Supervisor": s.supervisor, "Tracking": tracking(**tracked), "NominalModel": s.nominal},
        "Goal": Goal(free=(1,)),
    }
    steps = [f"{name}.step" for name in (*objects, "OracleController")]
    uses = {
        **dict.fromkeys(steps, lambda state: state.inputs),
        "PrioritizedController.transfer": lambda state: s.plain.step(state, **AT_REST).inputs,
        "Supervisor.transfer": lambda state: stepped(state=state),
        "Measurement": lambda read: stepped(measurement=read),
        **dict.fromkeys(("PrioritizedController", "GuardedController"), simulate),
        **dict.fromkeys(("OracleController", "Supervisor"), simulate),
        "ControlTask": lambda task: simulate(GuardedController("own", lambda _: s.plain, task)),
        "Goal.of": vars,
        "Goal": lambda goal: (s.mapping(goal).major_gain(), simulate(s.make_controller(goal))),
        **{"PrioritizedMapping": mapped, "LocalGeometry": on_three, "MechanismGeometry": on_three},
        "LoopShape": lambda shape: ftc.compensator(s.channel, shape, PERIOD_S),
        **{"Margins": lambda result: result.phase_margin_deg, "NominalModel": broken},
        "Tracking": lambda made: (made.loops, made.nominal.noise, simulate(made.controller(GOAL))),
        "Manipulability": lambda report: report.worst_gain,
        "LoopRun": lambda run: (run.measured, run.inputs),
        "Fault": lambda fault: fault_model(s.nominal, [fault]),
        "FdiConfig": after_some_samples,
        "Monitor": lambda result: result.start().last_commanded,
        "SensorCheck": lambda check: check.step(check.start(2), None, STILL).unusable_ticks,
        **{"Dither": lambda dither: dither.at(0.1), "Separations": separated},
        "DitherDesign": lambda design: separated(design.separations),
        "Uncertainty": lambda u: separated(fdi.separations(s.nominal, sinusoid, 0.1, u)),
        "Cost": lambda cost: separated(
            fdi.designed_dither(s.nominal, good["freedom"], [8.0], cost, 0.5).separations
        ),
        "ranked_sensors": lambda ranked: [separated(each.separations) for each in ranked],
    }
    gaps = {"Measurement": ("output", "displacement"), "GuardedController.step": ("measurement",)}
    gaps |= {"Supervisor.step": ("measurement",)}
    gaps["nominal_model_of"] = ("lower", "drive", "C")  # numpy removes the masks
    return Package(
        callables=TARGETS,
        good=good,
        special=special,
        objects=objects,
        uses=uses,
        gaps=gaps,
        unsolvable=(ftc.TaskLost, loops.NoResponse, loops.UnstableLoop),
        excluded={"tracking with options": [name for name in tracked if name != "noise"]},
        slow=("tracking", "tracking with options", "tracking_of", "FdiConfig", "Uncertainty"),
    )


test_a_hostile_argument_is_reported_or_harmless = one_by_one(package, TARGETS)
test_two_hostile_arguments_are_reported_or_harmless = two_at_once(package)
