"""The recording of a mechanism in several conditions: for each 3D view, task and plots."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import rerun.blueprint as rrb

from experiments.output.recording import Array
from experiments.output.recording.file import About, recording_file, screen
from experiments.output.recording.machine import (
    exaggerated,
    exaggeration_of,
    log_machine,
    machine_tabs,
    motion_of,
    sized_entity,
    sizes,
    stills,
)
from experiments.output.recording.views import (
    Plot,
    Task,
    log_plane,
    log_plots,
    notes_view,
    plane_view,
    plot_views,
)

_COLUMNS = 3


@dataclass(frozen=True)
class Driven:
    """A mechanism in one condition, at evenly spaced times (N,).

    `qpos` are the positions of all its joints, (N, nq); the task, if any, is drawn in a plane.
    """

    time_s: Array
    qpos: Array
    plots: Sequence[Plot]
    task: Task | None = None


def write_mechanism(
    path: Path, about: About, model: mujoco.MjModel, conditions: Mapping[str, Driven]
) -> None:
    """Write one mechanism in several conditions as an `.rrd` file.

    Motions too small to be seen are exaggerated, by a factor that the title of the view states.
    """
    nominal = motion_of(model, model.qpos0[None])
    motions = {
        name: motion_of(model, one.qpos[stills(one.time_s)]) for name, one in conditions.items()
    }
    factors = {name: exaggeration_of(motion, nominal) for name, motion in motions.items()}
    each = list(enumerate(conditions.items()))
    cells = [_cell(k, name, model, one, factors[name]) for k, (name, one) in each]
    grid = rrb.Grid(*cells, grid_columns=min(_COLUMNS, len(cells)))
    views = rrb.Horizontal(notes_view(), grid, column_shares=[1, 4])
    with recording_file(path, about, screen(views)) as recording:
        for k, (name, one) in each:
            for size in sizes(factors[name]):
                entity = sized_entity(f"{_entity(k)}/machine", size)
                larger = exaggerated(motions[name], nominal, size)
                log_machine(recording, entity, model, larger, one.time_s[stills(one.time_s)])
            log_plots(recording, one.plots, f"{_entity(k)}/")
            if one.task:
                entity = f"{_entity(k)}/task"
                log_plane(recording, entity, one.time_s, one.task, one.task.square)


def _entity(k: int) -> str:
    return f"condition_{k}"


def _cell(k: int, name: str, model: mujoco.MjModel, one: Driven, factor: int) -> rrb.Vertical:
    pictures: list[rrb.View | rrb.Container] = [
        machine_tabs(f"{_entity(k)}/machine", name, model, factor)
    ]
    if task := one.task:
        title = f"{task.names[1]} over {task.names[0]} [{task.unit}]"
        pictures.append(plane_view(f"{_entity(k)}/task", title, task.square))
    return rrb.Vertical(
        rrb.Horizontal(*pictures, column_shares=[3, 2][: len(pictures)]),
        *plot_views(one.plots, f"{_entity(k)}/"),
        row_shares=[2] + [1] * len(one.plots),
    )
