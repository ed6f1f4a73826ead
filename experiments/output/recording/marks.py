"""In a recording: when a strut fails, and when that is found, in colour and on the time line."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from experiments.hexapod.simulation import Trajectory
from experiments.output.palette import YELLOW
from experiments.output.recording.file import rgb, time_column
from sim import Array

FAILED = rgb(YELLOW)
DIAGNOSED = [255, 255, 255]
_SOUND = [190, 190, 190]

_WIDTH = 3.0


@dataclass(frozen=True)
class Mark:
    """One strut's failure in a run.

    Attributes:
        strut: 0..5.
        failed_s: When it happened.
        failure: What, in words.
        diagnosed_s: When it was found; infinite: never.
        diagnosis: What was found, in words.
    """

    strut: int
    failed_s: float
    failure: str
    diagnosed_s: float = np.inf
    diagnosis: str = ""

    @property
    def is_found(self) -> bool:
        """Whether it ever was."""
        return self.diagnosed_s < np.inf


def marks_from(text: str, end_s: float) -> list[Mark]:
    """Marks of a run that lasts until `end_s`, from JSON: a list of their attributes.

    Raises:
        ValueError: It is none of that; the message says what came.
    """
    try:
        marks = [Mark(**each) for each in json.loads(text)]
        sound = all(_is_sound(mark, end_s) for mark in marks)
    except (ValueError, TypeError):
        sound, marks = False, []
    if not sound:
        raise ValueError(
            f"expected a list of failures of struts 0 to 5 within {end_s:g} s, got {text!s:.80}"
        )
    return marks


def _is_sound(mark: Mark, end_s: float) -> bool:
    return (
        isinstance(mark.strut, int)
        and mark.strut in range(6)
        and 0 <= mark.failed_s <= end_s
        and mark.failed_s <= mark.diagnosed_s
        and (mark.diagnosed_s <= end_s or not mark.is_found)
        and isinstance(mark.failure, str)
        and isinstance(mark.diagnosis, str)
    )


def happens_in_flight(marks: Sequence[Mark], time_s: Array) -> bool:
    """Whether a strut fails after the run (N,) has begun."""
    return any(mark.failed_s > time_s[0] for mark in marks)


def log_marks(recording: rr.RecordingStream, marks: Sequence[Mark], run: Trajectory) -> None:
    """Log what each failing strut is in, what happens as text, and the strut's input in colour.

    Args:
        recording: To log into.
        marks: What happened.
        run: In which.
    """
    time_s, begin_s, end_s = run.time_s, float(run.time_s[0]), float(run.time_s[-1])
    for mark in marks:
        entity = f"state/strut_{mark.strut + 1}"
        style = rr.StateConfiguration(
            values=["sound", "failed", "diagnosed"], colors=[_SOUND, FAILED, DIAGNOSED]
        )
        recording.log(entity, style, static=True)
        changes = [(begin_s, "sound")] if mark.failed_s > begin_s else []
        changes.append((mark.failed_s, "failed"))
        if mark.is_found:
            changes.append((mark.diagnosed_s, "diagnosed"))
        times, states = zip(*changes, strict=True)
        columns = rr.StateChange.columns(state=states)
        recording.send_columns(entity, [time_column(np.array(times))], columns)
    for mark in marks:
        found_s = min(mark.diagnosed_s, end_s)
        signal = run.strut_input_percent[:, mark.strut]
        told = f"strut {mark.strut + 1}"
        _log_part(recording, f"{told} failed [%]", FAILED, time_s, signal, mark.failed_s, found_s)
        _log_text(recording, mark.failed_s, mark.failure)
        if mark.is_found:
            name = f"{told} diagnosed [%]"
            _log_part(recording, name, DIAGNOSED, time_s, signal, found_s, end_s)
            _log_text(recording, mark.diagnosed_s, mark.diagnosis)


def _log_part(
    recording: rr.RecordingStream,
    name: str,
    color: list[int],
    time_s: Array,
    signal: Array,
    begin_s: float,
    end_s: float,
) -> None:
    entity = "strut/input/" + name.removesuffix(" [%]").replace(" ", "_")
    style = rr.SeriesLines(names=[name], colors=[color], widths=[_WIDTH])
    recording.log(entity, style, static=True)
    within = (time_s >= begin_s) & (time_s <= end_s)
    columns = rr.Scalars.columns(scalars=signal[within])
    recording.send_columns(entity, [time_column(time_s[within])], columns)


def _log_text(recording: rr.RecordingStream, when_s: float, text: str) -> None:
    columns = rr.TextLog.columns(text=[text])
    recording.send_columns("events", [time_column(np.array([when_s]))], columns)
