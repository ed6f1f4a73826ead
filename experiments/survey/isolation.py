"""Which failures can be told apart, as numbers, a table and sentences."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from experiments.rig.conditions import listed
from experiments.rig.dither import CONDITIONS
from experiments.rig.units import by_unit, sizes_said
from experiments.study.tables import Column, Table, tabulate
from experiments.survey.alike import Columns
from experiments.survey.sensors import Sensed, Sensors
from experiments.survey.survey import Subject
from ftc.fdi.fault_model import KINDS, Fault

_ERRORS = ("gain", "stiffness", "damping", "inertia", "delay_s")
"""Of the model, that change signatures."""
_SENSES = {"task": "a sensor of the task", "joints": "encoders", "both": "both"}


def isolation_entry(subject: Subject, found: Sensors | Columns | str) -> dict[str, Any]:
    """What can be told apart, ready for JSON; `refused` is a sentence where nothing can be said."""
    if isinstance(found, str):
        return {"refused": found}
    if isinstance(found, Columns):
        names = subject.actuators
        return {
            "isolable": [names[k] for k in found.isolable(len(names))],
            "alike": [[names[k] for k in group] for group in found.groups],
            "without_effect": [names[k] for k in found.unseen],
            "nearest": None if found.nearest is None else [names[k] for k in found.nearest],
            "smallest_angle_deg": found.angle_deg,
        }
    of_task, of_encoders = found.noise
    rows = [subject.row_units[row] for row in subject.major]
    known = asdict(CONDITIONS.uncertainty)
    return {
        "measuring_time_s": CONDITIONS.time_s,
        "model_uncertainty": {name: known[name] for name in _ERRORS},
        **by_unit("path_size", found.size, rows),
        **by_unit("sensor_noise", of_task, rows),
        **by_unit("encoder_noise", of_encoders, subject.units),
        "actuators": list(found.actuators),
        "failures": len(KINDS) * len(found.actuators),
        "with": {each.sense: _entry(each, found.actuators) for each in found.sensed},
    }


def _entry(sensed: Sensed, names: tuple[str, ...]) -> dict[str, Any]:
    apart, dither = sensed.separations, sensed.design.dither

    def entries(faults: tuple[Fault, ...]) -> list[dict[str, str]]:
        return [{"actuator": names[each.actuator], "kind": each.kind} for each in faults]

    return {
        "isolable": entries(apart.isolable()),
        "isolable_with_exact_model": sensed.exactly,
        "alike": [[names[k] for k in group] for group in apart.alike_actuators()],
        "undetected": entries(apart.undetected()),
        "least_separation": apart.least,
        "dither_hz": dither.frequency_hz,
        "dither_amplitude": dither.amplitude,
        "dither_direction": list(dither.direction),
        "further_sensors": [vars(each) for each in sensed.added],
    }


def isolation_tables(entry: dict[str, Any]) -> list[Table]:
    """One row for each set of sensors of a robot; of a matrix there is none."""
    if "with" not in entry:
        return []
    columns = (
        Column("sensors", lambda each: _SENSES[each["sense"]]),
        Column("told apart", lambda each: f"{len(each['isolable'])} of {entry['failures']}"),
        Column("exact model", "isolable_with_exact_model"),
        Column("dither, Hz", "dither_hz", "g"),
        Column("further sensors", lambda each: _further(each) or "-"),
    )
    rows = [{"sense": sense} | each for sense, each in entry["with"].items()]
    legend = (
        "told apart: single failures (each actuator locked, free, half weak) that look like no "
        f"failure of another actuator and not like none, in {entry['measuring_time_s']:g} s of the "
        "dither. exact model: the same without errors of the model. further sensors: the best "
        "ones, one after another, and how many are told apart with them; -: none helps."
    )
    return [tabulate("Failures that sensors tell apart", columns, rows, legend)]


def _further(each: dict[str, Any], joined: str = ", ") -> str:
    return joined.join(f"{one['name']} ({one['isolable']})" for one in each["further_sensors"])


def _not_isolable(each: dict[str, Any], entry: dict[str, Any]) -> str:
    """Failures that are not isolable, by their kinds."""
    isolable = {(one["actuator"], one["kind"]) for one in each["isolable"]}
    left = {kind: [k for k in entry["actuators"] if (k, kind) not in isolable] for kind in KINDS}
    return "; ".join(f"{listed(names)} {kind}" for kind, names in left.items() if names)


def isolation_sentences(entry: dict[str, Any]) -> list[str]:
    """The same for a reader, from the entry alone."""
    if "refused" in entry:
        said = entry["refused"]
        return [f"Which failures sensors tell apart is not said: {said.removesuffix('.')}."]
    if "with" not in entry:
        return list(_of_columns(entry))
    return list(_of_sensors(entry))


def _of_columns(entry: dict[str, Any]) -> Iterator[str]:
    if entry["without_effect"]:
        yield f"No sensor of the effects sees a failure of {listed(entry['without_effect'], 'or')}."
    for group in entry["alike"]:
        yield (
            f"No sensor of the effects tells failures of {listed(group)} apart, because their "
            "columns are parallel: one sensor at each of them but one would."
        )
    if entry["nearest"] is not None:
        other = "other " if entry["alike"] else ""
        yield (
            f"Sensors of all effects can tell failures of any {other}two inputs apart; the nearest "
            f"are {listed(entry['nearest'])}, {entry['smallest_angle_deg']:.3g} degrees from each "
            "other with each effect in units of its row's norm."
        )


def _of_sensors(entry: dict[str, Any]) -> Iterator[str]:
    total, found = entry["failures"], entry["with"]
    isolable = {sense: len(each["isolable"]) for sense, each in found.items()}
    parts = [f"{isolable[sense]} with {words}" for sense, words in _SENSES.items()]
    yield (
        f"Of the {total} single failures (each actuator locked, free or with half its force) can "
        f"be told apart: {', '.join(parts[:-1])} and {parts[-1]}."
    )
    for sense, words in _SENSES.items():
        if further := _further(found[sense], ", then "):
            yield f"Besides {words}, these would separate more: {further}."
    if isolable["both"] < total:
        yield f"With both, these are not told apart: {_not_isolable(found['both'], entry)}."
        if not found["both"]["further_sensors"]:
            yield (
                "No further sensor of the task, of an actuator or of a joint separates more; with "
                f"an exact model {found['both']['isolable_with_exact_model']} are told apart."
            )
    known = entry["model_uncertainty"]
    yield (
        f"That is in {entry['measuring_time_s']:g} s of a dither that the major task does not "
        f"feel, by the linear model at the start, whose forces are known to {known['gain']:.0%}, "
        f"stiffness to {known['stiffness']:.0%}, damping to {known['damping']:.0%} and delay to "
        f"{1e3 * known['delay_s']:g} ms (standard deviations). {sizes_said(entry)}"
    )
