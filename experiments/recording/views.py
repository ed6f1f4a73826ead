"""Views beside the machine: two curves in a plane, and the notes."""

from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.recording import Array
from experiments.recording.file import TIMELINE, at_most, rgb, round_down, time_column
from experiments.study.palette import ORANGE, SKY

RATE_HZ = 50
"""Of the curves in a plane."""
_UP = np.array([1, -1])
"""Image axes run down: the second axis is drawn upwards."""
_MARGIN = 1.3
"""Side of the square over the extent of the curves: its label stands beyond them."""
_LABEL, _ARM = 0.93, 1.1
"""Where the label stands, in halves of the square; and these over the longest arm of the cross."""
_WHITE, _GREY = [240, 240, 240], [120, 120, 120]


def notes_view() -> rrb.TextDocumentView:
    """A view of the recording's notes."""
    return rrb.TextDocumentView(origin="notes", name="Notes")


@dataclass(frozen=True)
class Square:
    """The part of the plane that is shown: its center (2,), and half of its side."""

    center: Array
    half: float


@dataclass(frozen=True)
class Task:
    """Two rows of the major task, desired and reached, shape (N, 2), in the unit."""

    names: tuple[str, str]
    unit: str
    desired: Array
    reached: Array
    note: str = ""  # below the scale

    @property
    def square(self) -> Square:
        """The part of the plane that holds both curves."""
        return square_around(self.desired, self.reached)


def square_around(*curves: Array, margin: float = _MARGIN) -> Square:
    """The square that holds curves (N, 2), with a margin for the label."""
    points = np.concatenate(curves)
    low, high = points.min(axis=0), points.max(axis=0)
    half, center = margin * float((high - low).max()) / 2, (low + high) / 2
    # A spiral is nearly centred, and is shown as if it were.
    return Square(np.where(np.abs(center) < 0.1 * half, 0.0, center), half)


def log_plane(
    recording: rr.RecordingStream, entity: str, time_s: Array, task: Task, square: Square
) -> None:
    """Log both curves piece by piece, so that a view can show them up to its own time (N,)."""
    every = at_most(RATE_HZ, time_s)
    _log_scale(recording, entity, square, task)
    start = rr.Points2D([task.desired[0] * _UP], colors=[_WHITE], radii=[square.half / 80])
    recording.log(f"{entity}/start", start, static=True)
    curves = (("desired", task.desired, ORANGE), ("reached", task.reached, SKY))
    for order, (label, curve, color) in enumerate(curves, 1):
        style = rr.LineStrips2D.from_fields(
            colors=[rgb(color)], radii=[square.half / 250], draw_order=10 * order
        )
        recording.log(f"{entity}/{label}", style, static=True)
        points = curve[every] * _UP
        columns = rr.LineStrips2D.columns(strips=np.stack([points[:-1], points[1:]], axis=1))
        recording.send_columns(f"{entity}/{label}", [time_column(time_s[every][1:])], columns)


def _log_scale(recording: rr.RecordingStream, entity: str, square: Square, task: Task) -> None:
    """Log a cross with arms of a round length, which a label states: the view has no scale."""
    arm = round_down(square.half / _ARM)
    middle = square.center * _UP
    ends = middle + arm * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    cross = rr.LineStrips2D(
        ends.reshape(2, 2, 2).astype(np.float32), colors=[_GREY], radii=[square.half / 800]
    )
    recording.log(f"{entity}/axes", cross, static=True)
    right, up = task.names
    where = " about {:.0f}, {:.0f}".format(*square.center) if square.center.any() else ""
    scaled = f"{up} over {right}; cross ±{arm:g} {task.unit}{where}"
    label = "\n".join(
        filter(None, (scaled.replace("; ", "\n") if task.note else scaled, task.note))
    )
    scale = rr.Points2D(
        [middle - [0, _LABEL * square.half]],
        colors=[_GREY],
        radii=[0.0],
        labels=[label],
        show_labels=True,
    )
    recording.log(f"{entity}/scale", scale, static=True)


def plane_view(entity: str, name: str, square: Square) -> rrb.Spatial2DView:
    """A view of the curves from their start to the time shown."""
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
