"""What every Rerun recording shares: opening, time, lines, and a screen with nothing but views."""

import hashlib
import json
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.colors import to_rgb
from rerun.chunk import RrdReader

from experiments.output.palette import LINES
from sim import Array

TIMELINE = "sim_time"


def rgb(color: str) -> list[int]:
    """A colour of the palette as Rerun takes it."""
    return [round(255 * part) for part in to_rgb(color)]


@dataclass(frozen=True)
class About:
    """What a recording says of itself.

    Attributes:
        recording_id: Experiment, run and seed; its file adds a hash of notes and properties.
        name: What a person reads.
        notes: Markdown shown beside the views: parameters, results, the paper's numbers.
        properties: Seed, versions, model hash, every constant; units in the names.
    """

    recording_id: str
    name: str
    notes: str
    properties: dict[str, Any]

    @property
    def identity(self) -> str:
        """What tells it from all others; the viewer takes those alike for one recording."""
        told = json.dumps([self.notes, self.properties], default=str).encode()
        name = re.sub(r"[^\w-]", "-", self.recording_id)
        return f"{name}-{hashlib.sha256(told).hexdigest()[:8]}"


@contextmanager
def recording_file(
    path: Path, about: About, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """A recording that goes to a file, with its blueprint, properties and notes inside.

    The file is read back when it is written.

    Raises:
        OSError: The disk refuses, or what it holds cannot be read back.
        Exception: Whatever the writer complains of, here and inside; it runs in strict mode.
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
    if about.properties:
        recording.send_property("run", rr.AnyValues(**about.properties))
    document = rr.TextDocument(about.notes, media_type=rr.MediaType.MARKDOWN)
    recording.log("notes", document, static=True)
    try:
        yield recording
    finally:
        content = encoded.read()  # in any case: Rerun warns of what nobody reads
        recording.disconnect()
    path.write_bytes(content or b"")
    _read_back(path)


def _read_back(path: Path) -> None:
    """Decode all of a recording and of its screen.

    Raises:
        OSError: It is not whole.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of a file that ends too early, the reader only warns
            reader = RrdReader(path)
            (shown,), (layout,) = reader.recordings(), reader.blueprints()
            for store in (shown, layout):
                reader.stream(store=store).to_chunks()
    except Exception as error:  # the reader's own errors have no common class
        reason = " ".join(str(error).split())
        raise OSError(f"{path.name} cannot be read back: {reason}") from error


def time_column(time_s: Array) -> rr.TimeColumn:
    """Simulation time in whole nanoseconds."""
    return rr.TimeColumn(TIMELINE, duration=np.rint(time_s * 1e9).astype("timedelta64[ns]"))


def at_most(rate_hz: float, time_s: Array) -> slice:
    """Every so many of evenly spaced samples that there are no more than this in a second."""
    return slice(None, None, max(1, round(1 / (rate_hz * float(time_s[1] - time_s[0])))))


def log_series(
    recording: rr.RecordingStream,
    time: rr.TimeColumn,
    entity: str,
    names: Sequence[str],
    values: Array,
) -> None:
    """Log one line for each column of `values`, as float64; names carry the units."""
    style = rr.SeriesLines(names=names, colors=[rgb(color) for color in LINES[: len(names)]])
    recording.log(entity, style, static=True)
    columns = rr.Scalars.columns(scalars=values)
    recording.send_columns(entity, indexes=[time], columns=columns)


def screen(views: rrb.Container) -> rrb.Blueprint:
    """The views alone, at the recording's end: everything has been drawn there."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
    )
