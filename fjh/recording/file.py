"""Parts of every Rerun recording: file, time, lines, and a screen with only views."""

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
    notes: str  # Markdown next to the views: parameters, results, the paper's numbers
    properties: dict[str, Any]  # seed, versions, model hash, every constant; units in the names
    results: dict[str, Any] = field(default_factory=dict)  # those of `record.results_of`

    @property
    def identity(self) -> str:
        """Unique name of the recording: the viewer merges recordings of the same name."""
        content = json.dumps([self.notes, self.properties], default=str).encode()
        name = re.sub(r"[^\w-]", "-", self.recording_id)
        return f"{name}-{hashlib.sha256(content).hexdigest()[:8]}"


@contextmanager
def recording_file(
    path: Path, about: RecordingInfo, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Open a recording for logging; at the end of the block write it with views, properties, notes.

    Raises:
        OSError: The file cannot be written or read back.
        Exception: Rerun's writer failed, or the block raised an error.
    """
    rr.set_strict_mode(True)
    # The viewer has one layout for all recordings of an application: each recording is its own.
    name = about.identity
    recording = rr.RecordingStream(f"fjh-{name}", recording_id=name, send_properties=False)
    # Into memory first: Rerun's own file writer would only log that the disk is full.
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
        content = encoded.read()  # after an error, too: Rerun warns of an unread stream
        recording.disconnect()
    path.write_bytes(content or b"")
    _read_back(path)


def _read_back(path: Path) -> None:
    """Decode a recording and its views completely; raise `OSError` if they are incomplete."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # the reader only warns of a truncated file
            reader = RrdReader(path)
            (recording,), (views,) = reader.recordings(), reader.blueprints()
            for store in (recording, views):
                reader.stream(store=store).to_chunks()
    except Exception as error:  # the reader's own errors have no common class
        reason = " ".join(str(error).split())
        raise OSError(f"{path.name} cannot be read back: {reason}") from error


def rgb(color: str) -> list[int]:
    """Return a colour of the palette as R, G, B in 0..255."""
    return [round(255 * part) for part in to_rgb(color)]


def round_down(value: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, ... that does not exceed a positive value."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in _ROUND if step * decade <= value))


def time_column(time_s: Array) -> rr.TimeColumn:
    """Return the column of simulation time, rounded to nanoseconds."""
    return rr.TimeColumn(TIMELINE, duration=np.rint(time_s * 1e9).astype("timedelta64[ns]"))


def at_most(rate_hz: float, time_s: Array) -> slice:
    """Return the slice of evenly spaced samples that has at most `rate_hz` samples per second."""
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
    """Log each column of `values` (N, k) as a line, in float64; units are in the names.

    If a colour is given, points are not aggregated, so that gaps remain visible.
    """
    aggregation = None if color is None else rr.components.AggregationPolicy.Off
    colors = LINES if color is None else [color]
    on_dark = [_WHITE if name == BLACK else rgb(name) for name in colors]
    style = rr.SeriesLines(
        names=names,
        colors=[on_dark[k % len(on_dark)] for k in range(len(names))],
        widths=None if width is None else [width] * len(names),
        aggregation_policy=aggregation,
    )
    recording.log(entity, style, static=True)
    recording.send_columns(entity, indexes=[time], columns=rr.Scalars.columns(scalars=values))


def screen(views: rrb.Container) -> rrb.Blueprint:
    """Return a blueprint of the views without the viewer's panels, at the recording's end."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
    )
