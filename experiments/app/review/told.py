"""What the JSON files beside a run say of it, held against its data."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiments.hexapod.metrics import closure_residual_max_m, pointing_rms_urad, rms
from experiments.hexapod.simulation import Trajectory
from experiments.output.study import WrongInput

_ROUNDING = 1e-9
"""Relative: sums may be taken in another order elsewhere."""


def told_in(folder: Path) -> dict[str, Any]:
    """Contents of the JSON files of a folder, by their names.

    Raises:
        WrongInput: One of them cannot be read.
    """
    contents = {}
    for file in sorted(folder.glob("*.json")):
        try:
            contents[file.name] = json.loads(file.read_bytes())
        except (OSError, ValueError, RecursionError):
            raise WrongInput(f"{file} is not readable JSON") from None
    return contents


def check_told(data: str, run: Trajectory, told: dict[str, Any]) -> None:
    """Hold what is told of a data file against the run that is in it.

    Args:
        data: Name of the data file.
        run: What it holds.
        told: As :func:`told_in` gives it for the folder of the file.

    Raises:
        WrongInput: They contradict each other.
    """
    measured = _measured(run)
    for file, content in told.items():
        for entry in _entries(content):
            if entry.get("data") != data:
                continue
            for name in measured.keys() & entry.keys():
                if not _agree(entry[name], measured[name]):
                    raise WrongInput(
                        f"{file} says {name} = {entry[name]!s:.20} of {data}, "
                        f"whose data give {measured[name]:.10g}"
                    )


def _measured(run: Trajectory) -> dict[str, float]:
    alpha, beta = pointing_rms_urad(run)
    alpha_measured, beta_measured = 1e6 * rms(run.desired_rad - run.measured_rad)
    return {
        "alpha_rms_urad": float(alpha),
        "beta_rms_urad": float(beta),
        "alpha_measured_rms_urad": float(alpha_measured),
        "beta_measured_rms_urad": float(beta_measured),
        "closure_residual_max_m": closure_residual_max_m(run),
    }


def _agree(told: Any, measured: float) -> bool:
    return isinstance(told, int | float) and abs(told - measured) <= _ROUNDING * abs(measured)


def _entries(content: Any) -> Iterator[dict[str, Any]]:
    """Every object in it, at any depth."""
    if isinstance(content, dict):
        yield content
    if isinstance(content, dict | list):
        for part in content.values() if isinstance(content, dict) else content:
            yield from _entries(part)
