"""The notes beside a run: what was done, results, every parameter, as Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.recording.shown import Shown


def run_notes(
    title: str,
    said: Sequence[str],
    shown: Shown,
    beside: Mapping[str, Sequence[float | None]],
    properties: Mapping[str, Any],
) -> str:
    """The notes beside a run; arguments as of :func:`experiments.recording.keep.record_run`."""
    rms = {"here": 1e6 * shown.rms(), **beside}
    heads = [f"{row}, u{unit}" for row, unit in zip(shown.rows, shown.row_units, strict=True)]
    names, secondary = shown.secondary
    peaks = {name: f"{peak:.3f}" for name, peak in zip(names, _peaks(secondary), strict=True)}
    for unit in dict.fromkeys(shown.input_units):
        own = [k for k, each in enumerate(shown.input_units) if each == unit]
        each = ", ".join(
            f"{peak:.{2 if unit == '%' else 6}f}" for peak in _peaks(shown.inputs[:, own])
        )
        called = ", ".join(shown.actuators[k] for k in own)
        peaks[f"input of {called} [{unit}]"] = each
    if shown.closure_m.any():
        peaks["closure residual [nm]"] = f"{1e9 * shown.closure_m.max():.2f}"
    lines = [
        f"# {title}",
        "",
        *said,
        "",
        _row("RMS error", *heads),
        _row(*["---"] * (1 + len(heads))),
    ]
    lines += [_row(name, *map(_number, values)) for name, values in rms.items()]
    lines += ["", "| peak | |", "| --- | --- |"]
    lines += [_row(name, value) for name, value in peaks.items()]
    return "\n".join([*lines, "", *constants(properties)])


def constants(properties: Mapping[str, Any]) -> list[str]:
    """All parameters as a table in Markdown; units are in their names."""
    rows = [_row(name, str(value)) for name, value in properties.items()]
    return ["| parameter | value |", "| --- | --- |", *rows]


def _peaks(values: Any) -> Any:
    return np.abs(values).max(axis=0)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"
