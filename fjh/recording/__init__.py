"""Rerun recordings of any mechanism, written after a run, with a layout of views.

The `.rrd` is for viewing; the `.npz` of the same name has all data.
"""

from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]
