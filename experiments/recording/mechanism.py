"""One mechanism in several conditions, moving as it is told: no flight."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco

from experiments.recording import Array
from experiments.recording.file import RecordingInfo
from experiments.recording.machine import (
    Picture,
    exaggerated,
    exaggeration_of,
    motion_of,
    stills,
)
from experiments.recording.marks import Mark
from experiments.recording.scene import Scene
from experiments.recording.screens import scenes_file, side_by_side
from experiments.recording.signals import Plot
from experiments.recording.views import Task


@dataclass(frozen=True)
class Driven:
    """A mechanism in one condition, at evenly spaced times (N,).

    `qpos` are the positions of all its joints, (N, nq); the task, if any, is drawn in a plane.
    `nominal` is the pose (nq,) that motion is exaggerated about; None is `qpos0`. Each
    mark is at the body that its actuator moves.
    """

    time_s: Array
    qpos: Array
    plots: Sequence[Plot]
    task: Task | None = None
    nominal: Array | None = None
    marks: Sequence[tuple[str, Mark]] = ()


def write_mechanism(
    path: Path, about: RecordingInfo, model: mujoco.MjModel, conditions: Mapping[str, Driven]
) -> None:
    """Write one mechanism in several conditions as an `.rrd` file.

    Motions too small to be seen are exaggerated, by a factor that the title of the view states.
    """
    scenes = {name: _scene(model, one) for name, one in conditions.items()}
    with scenes_file(path, about, scenes, side_by_side(scenes, pages=False)):
        pass


def _scene(model: mujoco.MjModel, one: Driven) -> Scene:
    nominal = motion_of(model, (model.qpos0 if one.nominal is None else one.nominal)[None])
    at = stills(one.time_s)
    motion = motion_of(model, one.qpos[at])
    factor = exaggeration_of(motion, nominal)
    moved, failing = exaggerated(motion, nominal, factor), [((body,), m) for body, m in one.marks]
    panels = [plot for plot in one.plots if not plot.is_constant]
    return Scene(
        Picture(model, one.time_s[at], moved, factor, failing),
        one.plots,
        panels,
        {plot.entity: plot.range for plot in panels},
        one.task and ("{1} over {0}", one.task),
        one.task and one.task.square,
    )
