"""A flight of any robot as recordings show it, from its arrays and what is stated beside them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

import argument_checks as check
from experiments.recording import Array
from experiments.recording.hexapod import BODIES, FIXTURES, factor_of, hexapod_mover
from experiments.recording.machine import (
    Motion,
    exaggerated,
    exaggeration_of,
    motion_of,
    stills,
)
from experiments.recording.marks import SOUND, Belief, Mark
from experiments.recording.shown import Shown, Ticks
from experiments.rig.bodies import body_name
from experiments.rig.units import ROWS
from sim import NOMINAL

_SOON_S = 1e-9


def of_robot(
    arrays: Mapping[str, Array], stated: Mapping[str, Any], model: mujoco.MjModel
) -> Shown:
    """A flight from its arrays, as of `Run.arrays`, and what :func:`.flight.stated_of` says of it.

    Raises:
        ValueError: An array is missing, has another shape, or is not finite; or a LookupError or
            TypeError: something else is stated.
    """
    actuators, units = tuple(map(str, stated["actuators"])), tuple(map(str, stated["units"]))
    rows, n = [int(row) for row in stated["major"]], len(actuators)
    its_bodies = {body_name(model, k) for k in range(model.nbody)} | {None}
    if not set(stated["bodies"]) <= its_bodies or not set(rows) <= set(range(len(ROWS))):
        raise ValueError("bodies and major must be those of the robot")
    input_units, own_units = (
        tuple(map(str, stated.get(name, ["rad"] * n))) for name in ("input_units", "actuator_units")
    )
    limits = _limits(stated.get("limits", [[None] * n] * 2))
    if {len(each) for each in (*limits, input_units, own_units, stated["bodies"])} != {n}:
        raise ValueError(f"limits, units and bodies must be of {n} actuators")
    time_s = check.finite("time_s", arrays["time_s"])
    if time_s.ndim != 1 or len(time_s) < 2 or (np.diff(time_s) <= 0).any():
        raise ValueError("time_s must ascend")
    widths = dict.fromkeys(("desired", "true", "measured"), len(units))
    widths |= {"task": len(ROWS), "inputs": n, "displacement": n, "qpos": model.nq}
    # Samples of sensors may be missing.
    whole = {key: arrays[key] for key in widths} | {"measured": np.nan_to_num(arrays["measured"])}
    its = {key: check.exactly(key, whole[key], len(time_s), widths[key]) for key in widths}
    rest = [row for row in range(len(ROWS)) if row not in rows]
    names = [f"{ROWS[row]} [{'urad' if row < len(ROWS) // 2 else 'um'}]" for row in rest]
    marks, beliefs, others = _happened(stated, actuators)
    is_hexapod = not stated.get("model_file", "of another file")
    bodies = tuple(() if body is None else (str(body),) for body in stated["bodies"])
    qpos, task = its["qpos"], its["task"]
    moves = mover(model, is_hexapod, qpos[0])

    def moved(ticks: Ticks, factor: float) -> Motion:
        return moves(task[ticks], qpos[ticks], factor)

    return Shown(
        robot=str(stated["robot"]),
        model=model,
        time_s=time_s,
        rows=tuple(ROWS[row] for row in rows),
        row_units=units,
        desired=its["desired"],
        true=its["true"],
        measured=arrays["measured"],
        actuators=actuators,
        input_units=input_units,
        inputs=its["inputs"],
        limits=limits,
        units=own_units,
        displacement=its["displacement"],
        bodies=BODIES if is_hexapod else bodies,
        secondary=(names, 1e6 * task[:, rest]),
        estimated=None,
        closure_m=check.exactly("closure_residual_m", arrays["closure_residual_m"], len(time_s)),
        motion=moved,
        factor=factor_of(task)
        if is_hexapod
        else exaggeration_of(motion_of(model, qpos[stills(time_s)]), motion_of(model, qpos[:1])),
        marks=marks,
        beliefs=beliefs,
        happenings=others,
        status=str(stated.get("status", "")),
        colored=is_hexapod,
        fixtures=FIXTURES if is_hexapod else (),
    )


def mover(
    model: mujoco.MjModel, is_hexapod: bool, start: Array
) -> Callable[[Array, Array, float], Motion]:
    """Of displacements (T, 6) of the task frame, qpos (T, nq) and a factor: the motion, magnified.

    The hexapod's follows from the displacements, that of other robots from qpos, from its start on.
    """
    if is_hexapod:
        moved = hexapod_mover(model)
        return lambda task, _, factor: moved(NOMINAL.moved(factor * task))
    nominal = motion_of(model, start[None])
    return lambda _, qpos, factor: exaggerated(motion_of(model, qpos), nominal, factor)


def _limits(stated: Sequence[Sequence[float | None]]) -> tuple[Array, Array]:
    lower, upper = stated
    low = np.array([-np.inf if each is None else float(each) for each in lower])
    return low, np.array([np.inf if each is None else float(each) for each in upper])


def _happened(
    stated: Mapping[str, Any], actuators: Sequence[str]
) -> tuple[list[Mark], list[Belief], list[tuple[float, str]]]:
    """What failed with its first diagnosis since, all diagnoses, and what happened elsewhere."""
    beliefs = list[Belief]()
    for found in stated["diagnoses"]:
        number = actuators.index(found["actuator"])
        beliefs.append(Belief(number, float(found["time_s"]), str(found["kind"])))
        if (back_s := found.get("withdrawn_s")) is not None:
            beliefs.append(Belief(number, float(back_s), SOUND))
    beliefs.sort(key=lambda one: one.time_s)
    marks, others = dict[tuple[int, float], Mark](), list[tuple[float, str]]()
    for each in (*stated["failures"], *stated.get("events", ())):
        name, kind, at_s = each["actuator"], str(each.get("kind", each.get("name"))), each["time_s"]
        if not 0.0 <= float(at_s) < np.inf:
            raise ValueError(f"times of failures must be from 0 on, got {at_s}")
        if name is None:
            others.append((float(at_s), kind))
            continue
        mark = _marked(actuators, actuators.index(name), kind, float(at_s), beliefs)
        marks.setdefault((mark.actuator, mark.failed_s), mark)  # an event may be a failure
    return sorted(marks.values(), key=lambda mark: mark.failed_s), beliefs, others


def _marked(
    actuators: Sequence[str], number: int, kind: str, at_s: float, beliefs: Sequence[Belief]
) -> Mark:
    """A failure, and as what its actuator was first named since."""
    words = f"{actuators[number]} {kind}"
    for found in beliefs:
        since = found.actuator == number and found.time_s >= at_s - _SOON_S
        if since and found.kind != SOUND:
            said = f"{words}, named {found.kind}"
            return Mark(number, at_s, words, found.time_s, said, kind, found.kind)
    return Mark(number, at_s, words, kind=kind)
