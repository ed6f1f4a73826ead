"""Recording of `fjh force`: the hexapod holds wrenches, sound and with strut 1 failed."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.force.aims import PRESCRIBED
from experiments.force.rig import Readings
from experiments.force.runs import Examination, Trial
from experiments.force.tables import checks, tables
from experiments.recording.file import RecordingInfo, rgb, time_column
from experiments.recording.layout import entity_of, scenes_file
from experiments.recording.machine import FIXTURES, Picture, body_entity, load_colors
from experiments.recording.motion import BODIES, hexapod_mover, magnification
from experiments.recording.properties import checked, constants
from experiments.recording.scene import Scene, axes_of
from experiments.recording.signals import Plot
from experiments.study.palette import GREEN, ORANGE
from experiments.study.provenance import version_properties
from sim import NOMINAL, Array, load_model

_WRENCH = ["m_x [N m]", "m_y [N m]", "m_z [N m]", "f_x [N]", "f_y [N]", "f_z [N]"]
_STRUTS = [f"strut {k} [N]" for k in range(1, 7)]
_MOTION = ["alpha [urad]", "beta [urad]", "gamma [urad]", "t_x [um]", "t_y [um]", "t_z [um]"]
_DONE = "The hexapod holds prescribed wrenches, sound and with strut 1 failed."
_ROBOT = "University of Wyoming hexapod"
_M_PER_N, _M_PER_N_M = 0.01, 0.07
"""Lengths of arrows."""
_ABOVE_M = 0.17
"""Of the payload's origin: where the arrows begin, in sight."""


def write_force(examinations: list[Examination], summary: dict[str, Any], folder: Path) -> None:
    """Write the `.rrd`: prescribed wrenches, one after another, a column for each condition."""
    shown = [one for one in examinations if one.condition.strut == 0]
    held = [_yielding(one) for one in shown]
    moved = np.concatenate([one.displacement.reshape(-1, 6) for one in held])
    factor = magnification(moved[:, :3], moved[:, 3:])
    full_n = float(np.ceil(max(np.abs(one.strut_n).max() for one in held)))
    model = load_model()
    properties = {"seed": summary["seed"]}
    properties |= {f"model_sha256_{name}": sha for name, sha in summary["model_sha256"].items()}
    properties |= version_properties(summary) | summary["bench"]
    notes = _notes(summary, properties)
    failures = "; ".join(str(one.condition) for one in shown)
    found = {"study": "force", "robot": _ROBOT, "failures": failures}
    found |= {"verdict": _DONE, "checks": checked(checks(summary))}
    about = RecordingInfo(f"force-seed{summary['seed']}", "force mapping", notes, properties, found)
    scenes = {str(one.condition): _scene(model, one, factor, full_n) for one in shown}
    with scenes_file(folder / summary["recording"], about, scenes, pages=False) as recording:
        for k, one in enumerate(shown):
            _log_wrench(recording, f"{entity_of(k)}machine", model, one.trial(PRESCRIBED))


def _yielding(one: Examination) -> Readings:
    """The payload under all that was asked for, where that was tried."""
    return one.prescribed[0].readings if one.prescribed else one.trial(PRESCRIBED).held


def _scene(model: mujoco.MjModel, one: Examination, factor: int, full_n: float) -> Scene:
    held, plots = _yielding(one), _plots(one)
    pose = NOMINAL.moved(factor * held.displacement.reshape(-1, 6))
    colors = {}
    for names, load in zip(BODIES, held.strut_n.reshape(-1, 6).T, strict=True):
        colors |= dict.fromkeys(names, load_colors(load, full_n))
    failing = [(BODIES[0], [(0.0, str(one.condition))])] if one.condition.failures else []
    motion, words = hexapod_mover(model)(pose), f"struts -{full_n:g} N blue, +{full_n:g} N red"
    picture = Picture(model, held.time_s.ravel(), motion, factor, failing, colors, FIXTURES, words)
    return Scene(picture, plots, axes_of(plots))


def _log_wrench(
    recording: rr.RecordingStream, entity: str, model: mujoco.MjModel, trial: Trial
) -> None:
    """The wrench that is held, as two arrows on the payload."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    to_world = data.site("base").xmat.reshape(3, 3)
    wrench = trial.answer.wrench.reshape(-1, 2, 3) @ to_world.T
    arrows = wrench * [[_M_PER_N_M], [_M_PER_N]]
    path = f"{body_entity(entity, 'payload')}/wrench"
    style = rr.Arrows3D.from_fields(
        colors=[rgb(GREEN), rgb(ORANGE)], radii=[0.008], origins=[[0, 0, _ABOVE_M]] * 2
    )
    recording.log(path, style, static=True)
    columns = rr.Arrows3D.columns(vectors=arrows.reshape(-1, 3)).partition([2] * len(arrows))
    recording.send_columns(path, [time_column(trial.held.time_s[:, 0])], columns)


def _plots(one: Examination) -> list[Plot]:
    trial = one.trial(PRESCRIBED)
    pressed, held = trial.pressed, trial.held

    def plot(entity: str, title: str, names: list[str], read: Readings, values: Array) -> Plot:
        # Pressing is over sooner than holding: each load is shown beside itself.
        time_s = read.time_s * held.time_s[-1, -1] / read.time_s[-1, -1]
        return Plot(entity, title, names, time_s.ravel(), values.reshape(-1, len(names)))

    plots = [
        plot("fixture", "Wrench on the fixture [N m], [N]", _WRENCH, pressed, pressed.fixture),
        plot("struts", "Struts, holding [N]", _STRUTS, held, held.strut_n),
    ]
    if one.condition.kind == "locked":
        lock_n = held.lock_n[..., 0]
        predicted_n = np.broadcast_to(trial.answer.strut[:, :1], lock_n.shape)
        both, names = np.stack([lock_n, predicted_n], axis=-1), ["lock [N]", "predicted [N]"]
        plots.append(plot("lock", "Reaction of the lock [N]", names, held, both))
    for way in one.prescribed:
        title = f"Payload, {way.mapping} mapping [urad], [um]"
        moved = 1e6 * way.readings.displacement
        plots.append(plot(f"payload/{way.mapping}", title, _MOTION, way.readings, moved))
    return plots


def _notes(summary: dict[str, Any], properties: dict[str, Any]) -> str:
    """The tables, shown beside the views."""
    lines = [
        f"# Static force mappings\n\nSeed {summary['seed']}. Each load is a step.",
        "On the payload: the moment held is green, the force orange.",
        "The wrench on the fixture is stretched in time: pressing rests sooner.\n",
        *(f"## {table.title}\n\n{table.markdown()}\n" for table in tables(summary)),
    ]
    return "\n".join([*lines, *constants(properties)])
