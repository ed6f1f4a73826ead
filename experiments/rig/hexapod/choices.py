"""Choices that the command line offers; apart, so that its help need not wait for other imports."""

from pathlib import Path
from typing import Literal

from experiments.study.study import Option

JacobianChoice = Literal["analytic", "constant"]
"""Of the estimated pose at every control tick, or of the nominal pose as eq. (39)."""

ConfigurationName = Literal["calibrated", "demand-limit"]
"""Of Table I, see :mod:`experiments.table1.runs`."""

MACHINE_FILE = Option(
    "model",
    Path | None,
    None,
    "Another machine file, MJCF.  [default: the hexapod, fjh.xml]",
    metavar="FILE",
)
"""Of studies that run on any hexapod."""
