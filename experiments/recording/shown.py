"""A run of the hexapod as recordings show it: its signals, its 3D view, its scales, its notes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.recording import Array, views
from experiments.recording.file import at_most, log_series, time_column
from experiments.recording.hexapod import Picture, log_hexapod
from experiments.recording.marks import Mark
from experiments.recording.mechanism import exaggeration, sized_entity, sizes, stills
from experiments.recording.views import Plot, Square, Task
from experiments.rig.hexapod.metrics import closure_residual_max_m, pointing_rms_urad
from experiments.rig.hexapod.simulation import Trajectory
from sim import NOMINAL, Pose

INPUTS = [f"strut {k} [%]" for k in range(1, 7)]
SECONDARY = ["gamma [urad]", "t_x [um]", "t_y [um]", "t_z [um]"]

_TWO_LINES = 1.7
"""Side of the square over the extent of the curves where the label has two lines."""


@dataclass(frozen=True)
class Shown:
    """A run with the marks of its failing struts, and plots beside those that every run has."""

    run: Trajectory
    marks: Sequence[Mark] = ()
    extras: Sequence[Plot] = ()


@dataclass(frozen=True)
class Scales:
    """The scales of one or several runs, the same for all of them."""

    factor: int  # exaggerates the payload's motion
    full_percent: float  # the input with the deepest colours
    square_urad: Square  # the part of the detector that is shown
    error_urad: Square  # the part of the plane of errors
    bounds: dict[str, float]  # largest absolute value of each plotted signal, by its entity

    @property
    def loads(self) -> str:
        """What the colours of the struts mean."""
        return f"struts -{self.full_percent:g} % blue, +{self.full_percent:g} % red"


def scales_of(runs: Sequence[Trajectory]) -> Scales:
    """Scales on which all of the runs can be seen."""
    angles = [max(np.abs(r.true_rad).max(), np.abs(r.secondary[:, 0]).max()) for r in runs]
    distances = [np.abs(run.secondary[:, 1:]).max() for run in runs]
    signals = [signals_of(run) for run in runs]
    bounds = {
        entity: max(np.abs(one[entity][1]).max() for one in signals)
        for entity in ("pointing/error", "strut/input", "secondary/true", "closure/residual")
    }
    curves = [curve for run in runs for curve in (run.desired_rad, run.measured_rad)]
    return Scales(
        factor=exaggeration(float(max(angles)), float(max(distances))),
        full_percent=float(max(1.0, np.ceil(bounds["strut/input"]))),
        # The first half of a spiral lies within the second.
        square_urad=views.square_around(*(1e6 * curve[len(curve) // 2 :] for curve in curves)),
        error_urad=views.square_around(
            *(one["pointing/error"][1] for one in signals), margin=_TWO_LINES
        ),
        bounds=bounds,
    )


def log_shown(
    recording: rr.RecordingStream,
    under: str,
    model: mujoco.MjModel,
    shown: Shown,
    scales: Scales,
    rate_hz: float,
) -> None:
    """Log a run below an entity: signals, and the hexapod of this MJCF in both sizes."""
    run = shown.run
    log_signals(recording, under, run, rate_hz)
    for size in sizes(scales.factor):
        picture = picture_of(shown, size, scales.full_percent)
        log_hexapod(recording, sized_entity(f"{under}hexapod", size), model, picture)
    views.log_plots(recording, shown.extras, under)


def log_detector(recording: rr.RecordingStream, run: Trajectory, scales: Scales) -> None:
    """Log the desired angles and the detector's reading of a run by itself."""
    task = Task(("alpha", "beta"), "urad", 1e6 * run.desired_rad, 1e6 * run.measured_rad)
    views.log_plane(recording, "detector", run.time_s, task, scales.square_urad)


def log_error_plane(
    recording: rr.RecordingStream, entity: str, run: Trajectory, scales: Scales
) -> None:
    """Log the error of beta over that of alpha, with their RMS, beside the desired zero.

    On the detector of many runs the desired and the true angles would be one line.
    """
    _, error_urad = signals_of(run)["pointing/error"]
    said = "RMS {:.2f}, {:.2f} urad".format(*pointing_rms_urad(run))
    task = Task(("alpha", "beta error"), "urad", np.zeros_like(error_urad), error_urad, said)
    views.log_plane(recording, entity, run.time_s, task, scales.error_urad)


def signals_of(run: Trajectory) -> dict[str, tuple[Sequence[str], Array]]:
    """Names with units, and values (N, k), of every signal, by its entity."""
    angles, struts = ["alpha [urad]", "beta [urad]"], [f"strut {k} [um]" for k in range(1, 7)]
    return {
        "pointing/desired": (angles, 1e6 * run.desired_rad),
        "pointing/true": (angles, 1e6 * run.true_rad),
        "pointing/measured": (angles, 1e6 * run.measured_rad),
        "pointing/error": (angles, 1e6 * (run.desired_rad - run.true_rad)),
        "strut/input": (INPUTS, run.strut_input_percent),
        "strut/displacement": (struts, 1e6 * run.strut_displacement_m),
        "secondary/true": (SECONDARY, 1e6 * run.secondary),
        "secondary/estimated": (SECONDARY, 1e6 * run.secondary_estimated),
        "closure/residual": (["closure [nm]"], 1e9 * run.closure_residual_m[:, None]),
    }


def log_signals(recording: rr.RecordingStream, under: str, run: Trajectory, rate_hz: float) -> None:
    """Log every signal as float64, below an entity; at most so many values a second."""
    every = at_most(rate_hz, run.time_s)
    time = time_column(run.time_s[every])
    for entity, (names, values) in signals_of(run).items():
        log_series(recording, time, f"{under}{entity}", names, values[every])


def picture_of(shown: Shown, factor: int, full_percent: float) -> Picture:
    """A run as the hexapod is drawn, the payload's motion multiplied by a factor."""
    run = shown.run
    every = stills(run.time_s)
    pose, load = magnified(run, every, factor), run.strut_input_percent[every]
    return Picture(run.time_s[every], pose, load, full_percent, shown.marks)


def magnified(run: Trajectory, ticks: slice | Sequence[int], factor: float) -> Pose:
    """Poses of the payload at some ticks of a run, its motion multiplied by a factor.

    Takes alpha, beta, gamma as a rotation vector: correct to the second order of the angles.
    """
    return NOMINAL.moved(factor * np.concatenate([run.true_rad, run.secondary], axis=1)[ticks])


def run_notes(
    title: str,
    said: Sequence[str],
    run: Trajectory,
    beside: Mapping[str, tuple[float | None, float | None]],
    properties: Mapping[str, Any],
) -> str:
    """The notes beside a run, as Markdown: what was done, results, every parameter.

    Arguments as of :func:`experiments.recording.keep.record_run`.
    """
    rms = {"here": pointing_rms_urad(run), **beside}
    gamma, *translation = 1e6 * np.abs(run.secondary).max(axis=0)
    inputs = np.abs(run.strut_input_percent).max(axis=0)
    peaks = {
        "strut inputs 1 to 6, %": ", ".join(f"{peak:.2f}" for peak in inputs),
        "gamma, urad": f"{gamma:.3f}",
        "t_x, t_y, t_z, um": ", ".join(f"{peak:.3f}" for peak in translation),
        "closure residual, nm": f"{1e9 * closure_residual_max_m(run):.2f}",
    }
    lines = [f"# {title}", "", *said, "", "| RMS, urad | alpha | beta |", "| --- | --- | --- |"]
    lines += [f"| {name} | {_number(pair[0])} | {_number(pair[1])} |" for name, pair in rms.items()]
    lines += ["", "| peak | |", "| --- | --- |"]
    lines += [f"| {name} | {value} |" for name, value in peaks.items()]
    return "\n".join([*lines, "", *constants(properties)])


def constants(properties: Mapping[str, Any]) -> list[str]:
    """All parameters as a table in Markdown; units are in their names."""
    rows = [f"| {name} | {value} |" for name, value in properties.items()]
    return ["| parameter | value |", "| --- | --- |", *rows]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"
