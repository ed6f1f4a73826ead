"""The columns of a sweep's dataset."""

from collections.abc import Sequence

import pyarrow as pa

from experiments.sweep.factors import ACTIVE, BENCH, KINDS, SECONDARY
from experiments.sweep.run import INPUT_PEAK, INPUT_RMS, SECONDARY_PEAK, Row

_TYPES = {"integer": pa.int64(), "switch": pa.bool_(), "real": pa.float64()}

PARAMETERS = (
    "seed",
    "duration_s",
    "struts",
    "failure_time_s",
    "known",
    "weight",
    *ACTIVE,
    *SECONDARY,
    "jacobian",
    *BENCH,
)
PREDICTED = (
    "dac_step_urad",
    "predicted_pole_radius",
    "predicted_alpha_rms_urad",
    "predicted_beta_rms_urad",
)
MEASURED = (
    "alpha_rms_urad",
    "beta_rms_urad",
    "alpha_peak_urad",
    "beta_peak_urad",
    "alpha_measured_rms_urad",
    "beta_measured_rms_urad",
    *INPUT_RMS,
    *INPUT_PEAK,
    *SECONDARY_PEAK,
    "closure_residual_max_m",
)

SCHEMA = pa.schema(
    [
        ("case", pa.int64()),
        *((name, _TYPES.get(KINDS.get(name, "real"), pa.string())) for name in PARAMETERS),
        ("status", pa.string()),
        ("message", pa.string()),
        ("diverged_at_s", pa.float64()),
        *((name, pa.float64()) for name in (*PREDICTED, *MEASURED)),
    ]
)


def table_of(rows: Sequence[Row]) -> pa.Table:
    """Rows in the order of their cases; what a row has not is null."""
    return pa.Table.from_pylist(sorted(rows, key=lambda row: row["case"]), schema=SCHEMA)
