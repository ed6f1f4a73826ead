"""Rerun recordings of any mechanism: made after a run, opened without a click.

The `.rrd` is for looking at; the `.npz` beside it is the record.
"""

from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]
