"""Everything that `fjh force` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.force.figure import figure_force
from experiments.force.recording import write_force
from experiments.force.rig import Readings
from experiments.force.study import Force
from experiments.force.tradeoff import Tried
from experiments.output.files import published, write_arrays, write_index
from experiments.output.plotting import save_figure
from sim import Array


def write(folder: Path, force: Force, summary: dict[str, Any]) -> dict[str, Any]:
    """Write data, recording and figure; all of them or none.

    Returns:
        The contents of `force.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="force.json") as staging:
        write_arrays(staging / summary["data"], _arrays(force))
        write_force(staging / summary["recording"], force.examinations, summary)
        save_figure(figure_force(force, summary), staging, "force")
        return write_index(staging / "force.json", summary)


def _arrays(force: Force) -> dict[str, Array]:
    """All that was asked, said and read; wrenches and displacements are [angular; linear], SI."""
    arrays = {"asked_wrench": force.aims.wrench}
    for one in force.examinations:
        for trial in one.trials:
            said, where = trial.answer, f"{one.condition} {trial.answer.goal}".replace(" ", "_")
            arrays |= {
                f"{where}_torques_n": said.torques,
                f"{where}_wrench": said.wrench,
                f"{where}_strut_n": said.strut,
                **_prefixed(f"{where}_pressed", trial.pressed),
                **_prefixed(f"{where}_held", trial.held),
            }
        for held in one.prescribed:
            where = f"{one.condition} prescribed {held.mapping}".replace(" ", "_")
            arrays |= {f"{where}_torques_n": held.torques, f"{where}_predicted": held.predicted}
            arrays |= _prefixed(where, held.readings)
    for name in ("mapping", "others", "pseudo_inverse"):
        arrays |= _prefixed(f"tradeoff_{name}", getattr(force.tradeoff, name))
    for use in force.internal:
        where = f"platform_{use.name}".replace(" ", "_")
        arrays |= {f"{where}_wrench": use.wrench}
        for name, how in (("without", use.without), ("used", use.used)):
            arrays |= {f"{where}_{name}_torques_n": how.torques, f"{where}_{name}_legs_n": how.legs}
            arrays |= _prefixed(f"{where}_{name}", how.pressed)
    return arrays


def _prefixed(where: str, record: Readings | Tried) -> dict[str, Array]:
    return {f"{where}_{name}": values for name, values in vars(record).items()}
