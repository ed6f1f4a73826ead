"""Table I: the six tracking experiments of section 4.2."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.hexapod.choices import ConfigurationName, JacobianChoice
from experiments.hexapod.columns import COLUMNS, Column
from experiments.hexapod.compensator import Loop
from experiments.hexapod.metrics import rms
from experiments.hexapod.prediction import predicted_error_rad, predicted_rms_rad
from experiments.hexapod.provenance import plant_constants
from experiments.hexapod.simulation import Trajectory, nominal_loops, track_spiral
from experiments.output.parallel import in_parallel
from experiments.table1.configuration import CONFIGURATIONS, Configuration
from sim import Array, ModelError, load_model, model_sha256


@dataclass(frozen=True)
class Table1:
    """All runs of the table.

    Attributes:
        mjcf: The machine file; None is `models/fjh.xml`.
        configuration: Constants around the plant, and what was fitted.
        plant_constants: Constants of the plant.
        model_sha256: Of the machine file.
        loops: The (alpha, beta) compensators.
        jacobian: Of the runs in `trajectories`; `other` holds those with the other choice.
        trajectories: By column name.
        other: By column name.
        reseeded: W_a once more with the next seed: how much the noise alone moves an RMS.
        predicted_rad: (2,) by column name, from the linear model.
        seed: Of the detector noise.
    """

    mjcf: Path | None
    configuration: Configuration
    plant_constants: dict[str, float | list[float]]
    model_sha256: str
    loops: tuple[Loop, Loop]
    jacobian: JacobianChoice
    trajectories: dict[str, Trajectory]
    other: dict[str, Trajectory]
    reseeded: Trajectory
    predicted_rad: dict[str, Array]
    seed: int


def other_jacobian(jacobian: JacobianChoice) -> JacobianChoice:
    """The choice that the table is compared with."""
    return "constant" if jacobian == "analytic" else "analytic"


def run_table1(
    *,
    mjcf: Path | None = None,
    seed: int = 0,
    quick: bool = False,
    jacobian: JacobianChoice = "analytic",
    configuration: ConfigurationName = "calibrated",
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Table1:
    """Run the six experiments, each with both Jacobians, side by side on the machine's cores.

    Args:
        mjcf: Another machine file; None is `models/fjh.xml`.
        seed: Of the detector noise; the same seed gives the same numbers to the bit.
        quick: Only the first seconds of the spiral.
        jacobian: Which runs are the table's, and which are compared with them.
        configuration: Which constants of the bench.
        on_progress: Called with finished and total number of runs.

    Raises:
        sim.ModelError: A missing, broken or incomplete machine file.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    chosen = CONFIGURATIONS[configuration]
    model, bench = load_model(mjcf), chosen.bench
    loops, constants = nominal_loops(model, bench), plant_constants(model)
    shared = {
        "model": model,
        "bench": bench,
        "loops": loops,
        "duration_s": bench.quick_duration_s if quick else bench.duration_s,
    }
    jobs = [(column, jacobian, seed) for column in COLUMNS]
    jobs += [(column, other_jacobian(jacobian), seed) for column in COLUMNS]
    jobs.append((COLUMNS[0], jacobian, seed + 1))
    calls = [
        shared | {"goal": c.goal, "failures": c.failures, "jacobian": choice, "seed": noise}
        for c, choice, noise in jobs
    ]
    runs = in_parallel(track_spiral, calls, on_progress)
    names = [column.name for column in COLUMNS]
    return Table1(
        mjcf=mjcf,
        configuration=chosen,
        plant_constants=constants,
        model_sha256=model_sha256(mjcf),
        loops=loops,
        jacobian=jacobian,
        trajectories=dict(zip(names, runs[: len(names)], strict=True)),
        other=dict(zip(names, runs[len(names) : -1], strict=True)),
        reseeded=runs[-1],
        predicted_rad={c.name: _predicted_rad(c, seed, shared) for c in COLUMNS},
        seed=seed,
    )


def _predicted_rad(column: Column, seed: int, shared: dict[str, Any]) -> Array:
    """RMS (2,) by the linear model: over all noise, or with a limit, which needs one, this seed's.

    Raises:
        sim.ModelError: A loop of the column is unstable on this machine.
    """
    run = shared | {"goal": column.goal, "failures": column.failures}
    if shared["bench"].demand_limit_urad is None:
        return predicted_rms_rad(**run)
    error = predicted_error_rad(**run, seed=seed)
    if error is None:
        raise ModelError(f"the loops of {column.name} are unstable on this machine")
    return rms(error)
