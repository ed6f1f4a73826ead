"""Everything that `fjh force` leaves in its folder."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.files import published, write_arrays, write_json
from experiments.force.cases import PRESCRIBED
from experiments.force.figure import figure_force
from experiments.force.rig import Readings
from experiments.force.study import Examination, Force
from experiments.force.text import tables
from experiments.force.tradeoff import Tried
from experiments.provenance import version_properties
from experiments.rerun_file import write_series
from sim import Array

_WRENCH = ["m_x [N m]", "m_y [N m]", "m_z [N m]", "f_x [N]", "f_y [N]", "f_z [N]"]
_STRUTS = [f"strut {k} [N]" for k in range(1, 7)]
_MOTION = ["alpha [urad]", "beta [urad]", "gamma [urad]", "t_x [um]", "t_y [um]", "t_z [um]"]


def write(folder: Path, force: Force, summary: dict[str, Any]) -> None:
    """Write data, recording and figure; all of them or none.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="force.json") as staging:
        write_arrays(staging / summary["data"], _arrays(force))
        write_series(
            staging / summary["recording"],
            f"force-seed{summary['seed']}",
            "force mapping",
            _plots(force.examinations),
            _notes(summary),
            {"seed": summary["seed"]}
            | {f"model_sha256_{name}": sha for name, sha in summary["model_sha256"].items()}
            | version_properties(summary)
            | summary["bench"],
        )
        figure_force(force, summary).savefig(staging / "force.png", dpi=130)
        write_json(staging / "force.json", summary)


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


def _plots(examinations: list[Examination]) -> dict[str, tuple[Array, list[str], Array]]:
    """Prescribed wrenches, one after another, on the sound hexapod and with strut 1 failed."""
    plots = {}
    for one in examinations:
        if one.condition.strut != 0:
            continue
        trial, where = one.trial(PRESCRIBED), str(one.condition)
        pressed, held = trial.pressed, trial.held
        plots[f"{where}: wrench on the fixture"] = _series(pressed, _WRENCH, pressed.fixture)
        plots[f"{where}: struts, holding"] = _series(held, _STRUTS, held.strut_n)
        if one.condition.kind == "locked":
            predicted = np.broadcast_to(trial.answer.strut[:, None, :1], held.lock_n[..., :1].shape)
            lock = np.concatenate([held.lock_n[..., :1], predicted], axis=-1)
            names = ["lock [N]", "predicted [N]"]
            plots[f"{where}: reaction"] = _series(held, names, lock)
        for way in one.prescribed:
            title = f"{where}: payload, {way.mapping} mapping"
            plots[title] = _series(way.readings, _MOTION, 1e6 * way.readings.displacement)
    return plots


def _series(readings: Readings, names: list[str], values: Array) -> tuple[Array, list[str], Array]:
    return readings.time_s.ravel(), names, values.reshape(-1, len(names))


def _notes(summary: dict[str, Any]) -> str:
    """The tables, shown beside the plots."""
    lines = ["# Static force mappings", "", f"Seed {summary['seed']}. Each load is a step.", ""]
    for table in tables(summary):
        lines += [f"## {table.title}", "", table.markdown(), ""]
    return "\n".join(lines)
