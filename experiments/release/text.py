"""The released strut in print, from `release.json`."""

from typing import Any

from experiments.output.results import Findings, Picture, Table
from experiments.release.summary import complaint

PICTURES = [
    Picture(
        "release.png",
        "Strut 1 without its coil: statics over six decades of stiffness, and two spirals.",
        "Above: the elastic mapping follows the simulation over all stiffnesses, taking the strut "
        "as locked fails for soft suspensions. Below: t_x over time when coil, or coil and spring, "
        "are lost in flight; simulation and linear model lie on top of each other.",
    )
]


def findings(summary: dict[str, Any]) -> Findings:
    """The spirals, and the sweep over stiffness."""
    tables = [spirals(summary), sweep(summary)]
    return Findings(summary, tables, [], PICTURES, complaint(summary))


def spirals(summary: dict[str, Any]) -> Table:
    """One row for each spiral."""

    def number(value: float | None, digits: int) -> str:
        return "" if value is None else f"{value:.{digits}f}"

    rows = [
        (
            spiral["name"].replace("_", " "),
            number(spiral["alpha_rms_urad"], 3),
            number(spiral["predicted_alpha_rms_urad"], 3),
            number(spiral["beta_rms_urad"], 3),
            number(spiral["predicted_beta_rms_urad"], 3),
            number(spiral["alpha_peak_urad"], 1),
            number(spiral["sensitivity_peak"], 2),
        )
        for spiral in summary["spirals"]
    ]
    return Table(
        "Strut 1 released: RMS of desired minus true angle, urad",
        ("", "alpha", "model", "beta", "model", "peak", "Ms"),
        rows,
        "free: without coil; loose: without coil and spring, in orbit. model: the linear model's. "
        "peak: of the alpha error, urad. Ms: peak of the loops' sensitivity.",
    )


def sweep(summary: dict[str, Any]) -> Table:
    """One row for each stiffness."""
    keys = (
        "alpha_simulated_urad",
        "alpha_elastic_urad",
        "alpha_as_if_locked_urad",
        "alpha_corrected_urad",
    )
    rows = [
        (f"{point['suspension_over_swing']:.0e}", *(f"{point[key]:.2f}" for key in keys))
        for point in summary["sweep"]
    ]
    return Table(
        "At rest, alpha of 100 urad asked for; alpha reached, urad",
        ("stiffness", "simulated", "elastic", "as locked", "corrected"),
        rows,
        "stiffness: suspension over the strut's own swing. Not told to the mapping: simulated, by "
        "the elastic mapping, and taking the strut as locked at its centre. corrected: told.",
    )
