"""A run of the hexapod as recordings show it: its signals, its picture, its scales."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from experiments.recording.file import at_most, log_series, time_column
from experiments.recording.hexapod import Picture
from experiments.recording.machine import exaggeration
from experiments.recording.marks import Mark
from experiments.recording.plane import Square, log_plane, square_around
from experiments.recording.series import Plot
from experiments.run import Trajectory
from sim import Pose

PICTURES_HZ = 25
INPUTS = [f"strut {k} [%]" for k in range(1, 7)]
SECONDARY = ["gamma [urad]", "t_x [um]", "t_y [um]", "t_z [um]"]


@dataclass(frozen=True)
class Shown:
    """A run and what is to be pointed out in it.

    Attributes:
        run: The run.
        marks: Struts that fail, and when that was found.
        extras: Plots beside those that every run has.
    """

    run: Trajectory
    marks: Sequence[Mark] = ()
    extras: Sequence[Plot] = ()


def log_signals(recording: rr.RecordingStream, under: str, run: Trajectory, rate_hz: float) -> None:
    """Log every signal as float64, below an entity; at most so many values a second."""
    every = at_most(rate_hz, run.time_s)
    time = time_column(run.time_s[every])
    angles, struts = ["alpha [urad]", "beta [urad]"], [f"strut {k} [um]" for k in range(1, 7)]
    for entity, names, values in (
        ("pointing/desired", angles, 1e6 * run.desired_rad),
        ("pointing/true", angles, 1e6 * run.true_rad),
        ("pointing/measured", angles, 1e6 * run.measured_rad),
        ("pointing/error", angles, 1e6 * (run.desired_rad - run.true_rad)),
        ("strut/input", INPUTS, run.strut_input_percent),
        ("strut/displacement", struts, 1e6 * run.strut_displacement_m),
        ("secondary/true", SECONDARY, 1e6 * run.secondary),
        ("secondary/estimated", SECONDARY, 1e6 * run.secondary_estimated),
        ("closure/residual", ["closure [nm]"], 1e9 * run.closure_residual_m[:, None]),
    ):
        log_series(recording, time, f"{under}{entity}", names, values[every])


def log_detector(
    recording: rr.RecordingStream, entity: str, run: Trajectory, square: Square
) -> None:
    """Log the desired spiral and the detector's reading."""
    desired, measured = 1e6 * run.desired_rad, 1e6 * run.measured_rad
    names = "alpha", "beta"
    log_plane(recording, entity, run.time_s, desired, measured, names, "urad", square)


def square_urad(runs: Sequence[Trajectory]) -> Square:
    """The part of the detector that the second halves of all runs need: the first lead there."""
    curves = [curve for run in runs for curve in (run.desired_rad, run.measured_rad)]
    return square_around(*(1e6 * curve[len(curve) // 2 :] for curve in curves))


def picture_of(shown: Shown, factor: int, full_percent: float) -> Picture:
    """A run as the hexapod is drawn, the payload's motion so many times as large.

    Takes alpha, beta, gamma as a rotation vector: good to the second order of the angles.
    """
    run = shown.run
    every = at_most(PICTURES_HZ, run.time_s)
    gamma_rad, translation_m = run.secondary[every, :1], run.secondary[every, 1:]
    angles = np.concatenate([run.true_rad[every], gamma_rad], axis=1)
    pose = Pose(Rotation.from_rotvec(factor * angles).as_matrix(), factor * translation_m)
    load = run.strut_input_percent[every]
    return Picture(run.time_s[every], pose, load, full_percent, shown.marks)


def exaggeration_of(runs: Sequence[Trajectory]) -> int:
    """A round factor that makes the payload's motion visible in all runs."""
    angles = [max(np.abs(r.true_rad).max(), np.abs(r.secondary[:, 0]).max()) for r in runs]
    ways = [np.abs(run.secondary[:, 1:]).max() for run in runs]
    return exaggeration(float(max(angles)), float(max(ways)))


def full_scale_percent(runs: Sequence[Trajectory]) -> float:
    """Strut input of the deepest colours: the largest there is, rounded up."""
    return float(max(1.0, np.ceil(max(np.abs(run.strut_input_percent).max() for run in runs))))


def loads_name(full_percent: float) -> str:
    """What the colours of the struts mean."""
    return f"struts -{full_percent:g} % blue, +{full_percent:g} % red"


def bounds(runs: Sequence[Trajectory]) -> dict[str, float]:
    """Largest pointing error [urad], strut input [%], secondary motion [urad or um], gap [nm]."""
    return {
        "pointing/error": max(1e6 * np.abs(run.desired_rad - run.true_rad).max() for run in runs),
        "strut/input": max(np.abs(run.strut_input_percent).max() for run in runs),
        "secondary/true": max(1e6 * np.abs(run.secondary).max() for run in runs),
        "closure/residual": max(1e9 * run.closure_residual_m.max() for run in runs),
    }
