"""Table I: the six tracking experiments of section 4.2."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco

from experiments.bench import Bench
from experiments.compensator import Loop
from experiments.mapping import Goal, JacobianChoice
from experiments.parallel import in_parallel
from experiments.prediction import predicted_rms_rad
from experiments.run import Trajectory, nominal_loops, track_spiral
from sim import Array, load_model

QUICK_S = 4.0
"""Seconds of spiral under --quick."""

CLOSURE_LIMIT_M = 1e-8
"""A run with a larger gap in a closed loop is not sound: 10 nm is about 0.03 urad."""


@dataclass(frozen=True)
class Column:
    """One column of Table I.

    Attributes:
        name: As in `table1.json`.
        goal: Weights, and the failure that the mapping is told of.
        locked: Struts 0..5 that are locked in the plant.
    """

    name: str
    goal: Goal
    locked: tuple[int, ...] = ()


_EQUAL = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
_STRUT_1 = {0: 0.0}

COLUMNS = (
    Column("W_a", Goal(joint_weight=_EQUAL)),
    Column("W_b", Goal(joint_weight=(2.0, 1.0, 2.0, 1.0, 2.0, 1.0))),
    Column("W_c", Goal(joint_weight=(1.0, 2.0, 1.0, 2.0, 1.0, 2.0))),
    # Secondary weights are on [t_x, t_y, t_z, gamma].
    Column("W_d", Goal(secondary_weight=(1.0, 1.0, 1.0, 1.0), locked_m=_STRUT_1), (0,)),
    Column("W_e", Goal(secondary_weight=(10.0, 10.0, 1.0, 1.0), locked_m=_STRUT_1), (0,)),
    Column("W_a_uncorrected", Goal(joint_weight=_EQUAL), (0,)),
)


@dataclass(frozen=True)
class Table1:
    """All runs of the table.

    Attributes:
        model: The machine.
        bench: Constants around it.
        loops: The (alpha, beta) compensators.
        jacobian: Of the runs in `trajectories`; `other` holds those with the other choice.
        trajectories: By column name.
        other: By column name.
        reseeded: W_a once more with the next seed: how much the noise alone moves an RMS.
        predicted_rad: (2,) by column name, from the linear model.
        seed: Of the detector noise.
    """

    model: mujoco.MjModel
    bench: Bench
    loops: tuple[Loop, Loop]
    jacobian: JacobianChoice
    trajectories: dict[str, Trajectory]
    other: dict[str, Trajectory]
    reseeded: Trajectory
    predicted_rad: dict[str, Array]
    seed: int

    @property
    def closure_residual_max_m(self) -> float:
        """Largest gap of a closed loop in any run of the table."""
        runs = (*self.trajectories.values(), *self.other.values(), self.reseeded)
        return max(float(run.closure_residual_m.max()) for run in runs)


def other_jacobian(jacobian: JacobianChoice) -> JacobianChoice:
    """The choice that the table is compared with."""
    return "constant" if jacobian == "analytic" else "analytic"


def run_table1(
    *,
    mjcf: Path | None = None,
    seed: int = 0,
    quick: bool = False,
    jacobian: JacobianChoice = "analytic",
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Table1:
    """Run the six experiments, each with both Jacobians, side by side on the machine's cores.

    Args:
        mjcf: Another machine file; None is `models/fjh.xml`.
        seed: Of the detector noise; the same seed gives the same numbers to the bit.
        quick: Only the first seconds of the spiral.
        jacobian: Which runs are the table's, and which are compared with them.
        on_progress: Called with finished and total number of runs.

    Raises:
        sim.ModelError: A missing, broken or incomplete machine file.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    model, bench = load_model(mjcf), Bench()
    loops = nominal_loops(model, bench)
    duration_s = QUICK_S if quick else bench.duration_s
    primary = [(column, jacobian, seed) for column in COLUMNS]
    compared = [(column, other_jacobian(jacobian), seed) for column in COLUMNS]
    jobs = [*primary, *compared, (COLUMNS[0], jacobian, seed + 1)]
    calls = [
        {
            "model": model,
            "bench": bench,
            "loops": loops,
            "goal": column.goal,
            "locked": column.locked,
            "jacobian": choice,
            "seed": job_seed,
            "duration_s": duration_s,
        }
        for column, choice, job_seed in jobs
    ]
    runs = in_parallel(track_spiral, calls, on_progress)
    names = [column.name for column in COLUMNS]
    return Table1(
        model=model,
        bench=bench,
        loops=loops,
        jacobian=jacobian,
        trajectories=dict(zip(names, runs[: len(names)], strict=True)),
        other=dict(zip(names, runs[len(names) : -1], strict=True)),
        reseeded=runs[-1],
        predicted_rad={
            column.name: predicted_rms_rad(
                model,
                bench,
                loops,
                column.goal,
                locked=column.locked,
                duration_s=duration_s,
            )
            for column in COLUMNS
        },
        seed=seed,
    )
