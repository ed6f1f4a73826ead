"""Marks of actuators that fail, in 3D: of any machine."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

from experiments.recording.file import TIMELINE, time_column


@dataclass(frozen=True)
class Mark:
    """The failure of an actuator in a run and its diagnosis, each a time and in words.

    A failure that is never diagnosed has an infinite time of diagnosis.
    """

    actuator: int
    failed_s: float
    failure: str
    diagnosed_s: float = np.inf
    diagnosis: str = ""

    @property
    def is_found(self) -> bool:
        """Whether it was ever diagnosed."""
        return self.diagnosed_s < np.inf


def log_mark(
    recording: rr.RecordingStream, body: str, mark: Mark, shape: rr.Cylinders3D | rr.Points3D
) -> None:
    """Log a shape at a body's entity from the failure on, labelled with what is known of it."""
    path, times, labels = f"{body}/failed", [mark.failed_s], [mark.failure]
    if mark.is_found:
        times, labels = [*times, mark.diagnosed_s], [*labels, mark.diagnosis]
    recording.set_time(TIMELINE, duration=mark.failed_s)
    recording.log(path, shape)
    recording.reset_time()
    columns = type(shape).columns(labels=labels, show_labels=[True] * len(labels))
    recording.send_columns(path, [time_column(np.array(times))], columns)
