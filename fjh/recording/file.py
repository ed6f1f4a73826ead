"""Parts of every Rerun recording: opening, time, lines, and a screen with nothing but views."""

import hashlib
import json
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.colors import to_rgb
from rerun.chunk import RrdReader

from fjh.recording import Array
from fjh.study.palette import BLACK, LINES

TIMELINE = "sim_time"
_WHITE = [240, 240, 240]
_ROUND = (1, 2, 5, 10)


@dataclass(frozen=True)
class RecordingInfo:
    """Name, notes and properties of a recording."""

    recording_id: str  # experiment, run and seed
    name: str  # for people
    notes: str  # Markdown beside the views: parameters, results, the paper's numbers
    properties: dict[str, Any]  # seed, versions, model hash, every constant; units in the names
    results: dict[str, Any] = field(default_factory=dict)  # as of `properties.results_of`

    @property
    def identity(self) -> str:
        """A name that no other recording has: the viewer merges recordings of one name."""
        content = json.dumps([self.notes, self.properties], default=str).encode()
        name = re.sub(r"[^\w-]", "-", self.recording_id)
        return f"{name}-{hashlib.sha256(content).hexdigest()[:8]}"


@contextmanager
def recording_file(
    path: Path, about: RecordingInfo, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """A recording to log into: with its views, properties and notes it is written on leaving.

    Raises:
        OSError: The disk refuses, or the file cannot be read back.
        Exception: Any error of the writer's, here and in the block; it runs in strict mode.
    """
    rr.set_strict_mode(True)
    # The viewer keeps one layout for all recordings of an application: each of ours has its own.
    recording = rr.RecordingStream(
        f"fjh-{about.identity}", recording_id=about.identity, send_properties=False
    )
    # Into memory first: a writer of Rerun's own would only log that the disk is full.
    encoded = recording.binary_stream()
    recording.send_blueprint(blueprint, make_active=False, make_default=True)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(about.name)
    for group, values in (("run", about.properties), ("results", about.results)):
        if values:
            recording.send_property(group, rr.AnyValues(**values))
    document = rr.TextDocument(about.notes, media_type=rr.MediaType.MARKDOWN)
    recording.log("notes", document, static=True)
    try:
        yield recording
    finally:
        content = encoded.read()  # after an error, too: Rerun warns of a stream that nobody reads
        recording.disconnect()
    path.write_bytes(content or b"")
    _read_back(path)


def _read_back(path: Path) -> None:
    """Decode all of a recording and of its views; an `OSError` where they are not whole."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of a file that ends too early, the reader only warns
            reader = RrdReader(path)
            (recording,), (views,) = reader.recordings(), reader.blueprints()
            for store in (recording, views):
                reader.stream(store=store).to_chunks()
    except Exception as error:  # the reader's own errors have no common class
        reason = " ".join(str(error).split())
        raise OSError(f"{path.name} cannot be read back: {reason}") from error


def rgb(color: str) -> list[int]:
    """A colour of the palette as Rerun takes it."""
    return [round(255 * part) for part in to_rgb(color)]


def round_down(value: float) -> float:
    """The last of 1, 2, 5, 10, 20, ... up to a positive value."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in _ROUND if step * decade <= value))


def time_column(time_s: Array) -> rr.TimeColumn:
    """Simulation time in whole nanoseconds."""
    return rr.TimeColumn(TIMELINE, duration=np.rint(time_s * 1e9).astype("timedelta64[ns]"))


def at_most(rate_hz: float, time_s: Array) -> slice:
    """Every k-th of evenly spaced samples, k such that there are at most so many in a second."""
    return slice(None, None, max(1, round(1 / (rate_hz * float(time_s[1] - time_s[0])))))


def log_series(
    recording: rr.RecordingStream,
    time: rr.TimeColumn,
    entity: str,
    names: Sequence[str],
    values: Array,
    *,
    color: str | None = None,
    width: float | None = None,
) -> None:
    """Log one line for each column of `values`, as float64; names carry the units.

    Lines of one given colour are drawn point by point, gaps and all.
    """
    alike = None if color is None else rr.components.AggregationPolicy.Off
    colors = LINES if color is None else [color]
    shown = [_WHITE if each == BLACK else rgb(each) for each in colors]  # on a dark background
    style = rr.SeriesLines(
        names=names,
        colors=[shown[k % len(shown)] for k in range(len(names))],
        widths=None if width is None else [width] * len(names),
        aggregation_policy=alike,
    )
    recording.log(entity, style, static=True)
    recording.send_columns(entity, indexes=[time], columns=rr.Scalars.columns(scalars=values))


def screen(views: rrb.Container) -> rrb.Blueprint:
    """The views without the viewer's panels, at the recording's end, where all is drawn."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
    )
