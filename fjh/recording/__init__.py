"""Rerun recordings of runs of any mechanism, with a layout of views.

A recording (`.rrd`) is for viewing; the `.npz` file of the same name has all data.
"""

from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]
