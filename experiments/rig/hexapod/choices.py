"""Choices that the command line offers; apart, so that its help need not wait for other imports."""

from pathlib import Path
from typing import Literal

from experiments.study.spelling import check_file
from experiments.study.study import Option

JacobianChoice = Literal["analytic", "constant"]
"""Of the estimated pose at every control tick, or of the nominal pose as eq. (39)."""

ConfigurationName = Literal["calibrated", "demand-limit"]
"""Of Table I, see :mod:`experiments.table1.runs`."""

STRUTS = tuple((f"strut{k}", f"coil{k}") for k in range(1, 7))
"""Names of the hexapod's actuators, as people know them, and in its file."""

MACHINE_FILE = Option(
    "model",
    Path | None,
    None,
    "Another machine file, MJCF.  [default: the hexapod, fjh.xml]",
    metavar="FILE",
    check=check_file,
)
"""Of studies that run on any hexapod."""
