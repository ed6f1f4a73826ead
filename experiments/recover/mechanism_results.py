"""Recovery of any robot as numbers, tables and sentences."""

from typing import Any

from experiments.output.provenance import versions
from experiments.output.results import Check, Results
from experiments.recover.mechanism_flight import MechanismFlown
from experiments.recover.mechanism_tables import counted, notes, tables
from experiments.recover.mechanisms import Mechanisms, Sensed
from experiments.robot.checks import closure_check
from experiments.robot.dither import dither_entry
from ftc.fdi.fault_model import KINDS


def results(outcome: Mechanisms) -> Results:
    """Everything that `fjh recover --model` publishes."""
    summary = summarize(outcome)
    return Results(summary, tables(summary), notes(summary), checks(summary))


def checks(summary: dict[str, Any]) -> list[Check]:
    """Whether the robot's loops stayed closed."""
    return [closure_check(summary)]


def summarize(outcome: Mechanisms) -> dict[str, Any]:
    """All numbers, ready for JSON."""
    rig = next(iter(outcome.sensed.values())).rig
    every = [(each, sensed) for sensed in outcome.sensed.values() for each in sensed.flown]
    flights = [flight_entry(*each) for each in every]
    return {
        "experiment": "recover",
        "seed": outcome.seed,
        "versions": versions(),
        "model_sha256": outcome.model_sha256,
        "robot": rig.title,
        "actuators": list(rig.actuators),
        "major": list(rig.major),
        "path_size": rig.size,
        "sensor_noise": rig.noise,
        "encoder_noise": rig.encoder_noise,
        "control_period_s": rig.period_s,
        "dither": {key: dither_entry(each.dither, rig) for key, each in outcome.sensed.items()},
        "sensed": [
            counted(sense, kind, flights) for sense in outcome.sensed for kind in (*KINDS, "none")
        ],
        "flights": flights,
        "closure_residual_max_m": max(flown.found.closure_residual_max_m for flown, _ in every),
    }


def flight_entry(flown: MechanismFlown, sensed: Sensed) -> dict[str, Any]:
    """One flight; times from the failure, RMS errors in sizes of the path."""
    flight, found, period_s = flown.flight, flown.found, sensed.rig.period_s
    fault, first = flight.fault, found.first if found.failures else None
    struck = found.struck[0] if found.struck else None
    entry: dict[str, Any] = {
        "sense": flight.sense,
        "seed": flight.seed,
        "alarms": len(found.alarm_ticks),
        "unexplained": found.unexplained,
        "sound_named": found.sound_named,
        "task_lost": found.task_lost,
        "lost_rightly": found.lost_rightly,
        "rms_before": flown.rms[0],
    }
    if fault is None or struck is None or flight.failure is None:
        return entry | {"actuator": None, "kind": "none"}
    delays = {
        "alarm_delay_s": found.detected,
        "named_delay_s": None if first is None else first.tick,
    }
    named = {each.fault.actuator: each for each in found.standing}.get(fault.actuator)
    return entry | {
        "actuator": sensed.rig.actuators[fault.actuator],
        "kind": fault.kind,
        "effectiveness": fault.effectiveness if fault.kind == "weak" else None,
        "time_s": flight.failure.time_s,
        "isolable": _isolable(sensed, fault.actuator, fault.kind),
        "alarm_before": found.alarm_before,
        **{key: None if at is None else (at - struck) * period_s for key, at in delays.items()},
        "named": None if first is None else sensed.rig.actuators[first.fault.actuator],
        "right": found.strut_right,
        "kinds": [] if named is None else list(named.kinds),
        "all_right": found.all_right,
        "rms_after": flown.rms[1],
        "rms_informed": flown.rms_informed,
    }


def _isolable(sensed: Sensed, actuator: int, kind: str) -> bool:
    """Whether the dither separates it in half a second, by the uncertain linear model."""
    if sensed.dither is None:
        return False
    isolable = sensed.dither.separations.isolable()
    return any((each.actuator, each.kind) == (actuator, kind) for each in isolable)
