"""A plane with two curves, what is desired and what is reached, growing in time."""

from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.output.palette import ORANGE, SKY
from experiments.output.recording.file import TIMELINE, at_most, rgb, time_column
from experiments.output.recording.scale import round_down
from sim import Array

RATE_HZ = 100
_UP = np.array([1, -1])
"""Image axes run down: the second axis is drawn upwards."""
_WHITE, _GREY = [240, 240, 240], [120, 120, 120]


@dataclass(frozen=True)
class Square:
    """The part of the plane that is shown.

    Attributes:
        center: Shape (2,).
        half: Of its side.
    """

    center: Array
    half: float


def square_around(*curves: Array) -> Square:
    """The square that holds curves (N, 2)."""
    points = np.concatenate(curves)
    low, high = points.min(axis=0), points.max(axis=0)
    half, center = 0.575 * float((high - low).max()), (low + high) / 2
    # A spiral is nearly centred, and is shown as if it were.
    return Square(np.where(np.abs(center) < 0.1 * half, 0.0, center), half)


def log_plane(
    recording: rr.RecordingStream,
    entity: str,
    time_s: Array,
    desired: Array,
    reached: Array,
    names: tuple[str, str],
    unit: str,
    square: Square,
) -> None:
    """Log two curves (N, 2) piece by piece, so that a view can show them up to its own time."""
    every = at_most(RATE_HZ, time_s)
    _log_scale(recording, entity, square, names, unit)
    start = rr.Points2D([desired[0] * _UP], colors=[_WHITE], radii=[square.half / 80])
    recording.log(f"{entity}/start", start, static=True)
    curves = (("desired", desired, ORANGE), ("reached", reached, SKY))
    for order, (label, curve, color) in enumerate(curves, 1):
        style = rr.LineStrips2D.from_fields(
            colors=[rgb(color)], radii=[square.half / 250], draw_order=10 * order
        )
        recording.log(f"{entity}/{label}", style, static=True)
        points = curve[every] * _UP
        columns = rr.LineStrips2D.columns(strips=np.stack([points[:-1], points[1:]], axis=1))
        recording.send_columns(f"{entity}/{label}", [time_column(time_s[every][1:])], columns)


def _log_scale(
    recording: rr.RecordingStream, entity: str, square: Square, names: tuple[str, str], unit: str
) -> None:
    """A cross with a round number on its arms: the view itself has no scale."""
    arm = round_down(square.half)
    ends = np.array([[arm, 0], [-arm, 0], [0, arm], [0, -arm]]) + square.center * _UP
    cross = rr.LineStrips2D(ends.reshape(2, 2, 2), colors=[_GREY], radii=[square.half / 800])
    recording.log(f"{entity}/axes", cross, static=True)
    where = " from {:.0f}, {:.0f}".format(*square.center) if square.center.any() else ""
    labels = [names[0], f"{names[1]} {arm:g} {unit}{where}"]
    scale = rr.Points2D(
        ends[[0, 3]], colors=[_GREY], radii=[square.half / 150], labels=labels, show_labels=True
    )
    recording.log(f"{entity}/scale", scale, static=True)


def plane_view(entity: str, name: str, square: Square) -> rrb.Spatial2DView:
    """All that was drawn until now."""
    x, y = square.center * _UP
    return rrb.Spatial2DView(
        origin=entity,
        name=name,
        visual_bounds=rrb.VisualBounds2D(
            x_range=[x - square.half, x + square.half], y_range=[y - square.half, y + square.half]
        ),
        time_ranges=rrb.VisibleTimeRange(
            TIMELINE,
            start=rrb.TimeRangeBoundary.infinite(),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        ),
    )
