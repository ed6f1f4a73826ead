"""Plane of two rows of the major task: desired and reached curves."""

from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fjh.recording import Array
from fjh.recording.file import TIMELINE, at_most, rgb, round_down, time_column
from fjh.study.palette import ORANGE, SKY

_RATE_HZ = 50
"""Rate [Hz] of the curves in a plane."""
_UP = np.array([1, -1])
"""Signs of the axes: vertical image axes run down, the second row is plotted upwards."""
MARGIN = 1.3
"""Side of the square relative to the extent of the curves, with space for the label."""
_LABEL, _ARM = 0.93, 1.1
"""Position of the label in half sides of the square; half side divided by the largest cross arm."""
_WHITE, _GREY = [240, 240, 240], [120, 120, 120]


@dataclass(frozen=True)
class Plane:
    """Two rows of the major task as curves in a plane.

    Attributes:
        title: Title of the view.
        names: Names of the rows: right, up.
        unit: Unit of both rows.
        desired: Desired curve (N, 2).
        reached: Reached curve (N, 2).
        enclosed: Points (K, 2) that the visible square contains.
        margin: Side of the square relative to the extent of these points.
        note: Text below the scale.
    """

    title: str
    names: tuple[str, str]
    unit: str
    desired: Array
    reached: Array
    enclosed: Array
    margin: float = MARGIN
    note: str = ""

    @property
    def square(self) -> tuple[Array, float]:
        """Centre (2,) and half the side of the visible square, in the rows' unit."""
        low, high = self.enclosed.min(axis=0), self.enclosed.max(axis=0)
        half, center = self.margin * float((high - low).max()) / 2, (low + high) / 2
        # A spiral is nearly centred: round its centre to zero.
        return np.where(np.abs(center) < 0.1 * half, 0.0, center), half


def log_plane(recording: rr.RecordingStream, entity: str, time_s: Array, plane: Plane) -> None:
    """Log both curves at times (N,) in segments, for a view that ends at the current time."""
    every, (_, half) = at_most(_RATE_HZ, time_s), plane.square
    _log_scale(recording, entity, plane)
    start = rr.Points2D([plane.desired[0] * _UP], colors=[_WHITE], radii=[half / 80])
    recording.log(f"{entity}/start", start, static=True)
    curves = (("desired", plane.desired, ORANGE), ("reached", plane.reached, SKY))
    for order, (label, curve, color) in enumerate(curves, 1):
        style = rr.LineStrips2D.from_fields(
            colors=[rgb(color)], radii=[half / 250], draw_order=10 * order
        )
        recording.log(f"{entity}/{label}", style, static=True)
        points = curve[every] * _UP
        columns = rr.LineStrips2D.columns(strips=np.stack([points[:-1], points[1:]], axis=1))
        recording.send_columns(f"{entity}/{label}", [time_column(time_s[every][1:])], columns)


def _log_scale(recording: rr.RecordingStream, entity: str, plane: Plane) -> None:
    """Log a labelled cross with arms of a round length as a scale, which the view lacks."""
    center, half = plane.square
    arm, middle = round_down(half / _ARM), center * _UP
    ends = middle + arm * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    cross = rr.LineStrips2D(
        ends.reshape(2, 2, 2).astype(np.float32), colors=[_GREY], radii=[half / 800]
    )
    recording.log(f"{entity}/axes", cross, static=True)
    right, up = plane.names
    where = " about {:.0f}, {:.0f}".format(*center) if center.any() else ""
    parts = [f"{up} over {right}", f"cross ±{arm:g} {plane.unit}{where}"]
    label = "\n".join([*parts, plane.note]) if plane.note else "; ".join(parts)
    scale = rr.Points2D(
        [middle - [0, _LABEL * half]], colors=[_GREY], radii=[0.0], labels=[label], show_labels=True
    )
    recording.log(f"{entity}/scale", scale, static=True)


def plane_view(entity: str, name: str, plane: Plane) -> rrb.Spatial2DView:
    """Return a view of the curves from their start to the current time."""
    center, half = plane.square
    x, y = center * _UP
    bounds = rrb.VisualBounds2D(x_range=[x - half, x + half], y_range=[y - half, y + half])
    start, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    until_now = rrb.VisibleTimeRange(TIMELINE, start=start, end=now)
    return rrb.Spatial2DView(origin=entity, name=name, visual_bounds=bounds, time_ranges=until_now)
