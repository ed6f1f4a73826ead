"""In a recording: when a strut fails, and when that is found, in colour and on the time line."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from experiments.rerun_file import time_column
from sim import Array

FAILED = [213, 94, 0]
DIAGNOSED = [0, 158, 115]
_SOUND = [190, 190, 190]

_WIDTH = 3.0


@dataclass(frozen=True)
class Mark:
    """One strut's failure in a run.

    Attributes:
        strut: 0..5.
        failed_s: When it happened.
        failure: What, in words.
        diagnosed_s: When it was found; None: it was not.
        diagnosis: What was found, in words.
    """

    strut: int
    failed_s: float
    failure: str
    diagnosed_s: float | None = None
    diagnosis: str = ""


def log_marks(
    recording: rr.RecordingStream, marks: Sequence[Mark], time_s: Array, strut_input_percent: Array
) -> None:
    """Log what each strut is in, what happened as text, and the failed strut's input in colour.

    Args:
        recording: To log into.
        marks: What happened.
        time_s: Of the run, shape (N,).
        strut_input_percent: (N, 6).
    """
    begin_s, end_s = float(time_s[0]), float(time_s[-1])
    by_strut = {mark.strut: mark for mark in marks}
    for strut in range(6):
        entity = f"state/strut_{strut + 1}"
        style = rr.StateConfiguration(
            values=["sound", "failed", "diagnosed"], colors=[_SOUND, FAILED, DIAGNOSED]
        )
        recording.log(entity, style, static=True)
        changes = [(begin_s, "sound")]
        if mark := by_strut.get(strut):
            changes.append((mark.failed_s, "failed"))
            if mark.diagnosed_s is not None:
                changes.append((mark.diagnosed_s, "diagnosed"))
        times, states = zip(*changes, strict=True)
        columns = rr.StateChange.columns(state=states)
        recording.send_columns(entity, [time_column(np.array(times))], columns)
    for mark in marks:
        found_s = end_s if mark.diagnosed_s is None else mark.diagnosed_s
        signal = strut_input_percent[:, mark.strut]
        told = f"strut {mark.strut + 1}"
        _log_part(recording, f"{told} failed [%]", FAILED, time_s, signal, mark.failed_s, found_s)
        _log_text(recording, mark.failed_s, mark.failure)
        if mark.diagnosed_s is not None:
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
