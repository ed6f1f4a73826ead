"""The constant Jacobian in closed loop: what it costs, as spiral and stroke grow."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.columns import COLUMNS
from experiments.hexapod.compensator import Loop
from experiments.hexapod.mapping import DisplacementForm, StrutMapping
from experiments.hexapod.scaling import GROWTHS, Growth, grown_bench, grown_machine
from experiments.hexapod.simulation import Trajectory, nominal_loops, track_spiral
from experiments.hexapod.testbed import Bench
from experiments.jacobian.norms import NORMS, Norm
from experiments.jacobian.statics import extra_percent, follow, loop_gain_error, optimum
from experiments.jacobian.variation import relative_change
from experiments.output.parallel import in_parallel
from sim import Array, hexapod, load_model

VARIANTS: dict[str, tuple[JacobianChoice, DisplacementForm]] = {
    "constant": ("constant", "absolute"),
    "analytic": ("analytic", "absolute"),
    "incremental": ("analytic", "incremental"),
    "relinearized": ("analytic", "relinearized"),
}
"""The constant Jacobian, and three ways to use the one at the present pose."""

BY_NAME = {column.name: column for column in COLUMNS}
GROWN = "W_e"
"""The column that grows: strut 1 locked, t_x and t_y to be small. Curvature costs it the most."""
RECORDED = (Growth(1, 1), Growth(100, 100), Growth(100, 1000))
"""Sizes at which its runs are kept whole, data and recording."""
AT_NOMINAL = ("W_a", "W_d", "W_e")
STRIDE_S = 0.16
"""Between the instants at which a run is compared with the optimum, a dozen a turn."""
VISITED_STRIDE_S = 0.008
"""Between those whose strut lengths count as visited."""


@dataclass(frozen=True)
class Case:
    """One closed-loop run.

    Attributes:
        column: Of Table I.
        growth: Of stroke and spiral.
        variant: Key of :data:`VARIANTS`.
        seed: Of the detector noise.
    """

    column: str
    growth: Growth
    variant: str
    seed: int

    @property
    def name(self) -> str:
        """What its files are called."""
        return f"{self.column}_x{self.growth.spiral:g}_{self.variant}_seed{self.seed}"

    @property
    def is_recorded(self) -> bool:
        """Whether its data and recording are kept."""
        return self.column == GROWN and self.growth in RECORDED


@dataclass(frozen=True)
class Outcome:
    """What a run gave.

    Attributes:
        trajectory: The run itself.
        extra_percent: Distance from the optimum at the same pointing, of what the optimum costs.
        static_extra_percent: The same on the geometry alone.
        e_visited: Eq. (40) over the strut displacements that were visited, by norm.
        loop_gain_error: Largest ||J_m M_0 - I|| over them, M_0 the constant mapping.
    """

    trajectory: Trajectory
    extra_percent: float
    static_extra_percent: float
    e_visited: dict[Norm, float]
    loop_gain_error: float


def cases(seed: int, quick: bool) -> list[Case]:
    """Every variant: at nominal size for three columns, and another seed; grown for one column."""
    nominal, growths = GROWTHS[0], GROWTHS[3::3] if quick else GROWTHS[1:]
    columns = (GROWN,) if quick else AT_NOMINAL
    chosen = [Case(c, nominal, v, seed) for c in columns for v in VARIANTS]
    chosen += [Case(c, nominal, "analytic", seed + 1) for c in columns]
    return chosen + [Case(GROWN, g, v, seed) for g in growths for v in VARIANTS]


def run_loop(
    *,
    seed: int = 0,
    quick: bool = False,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[Case, Outcome]:
    """Track the spiral with each variant, side by side on the machine's cores.

    Args:
        seed: Of the detector noise.
        quick: Only the first seconds of the spiral, one column, and three sizes.
        on_progress: Called with finished and total number of runs.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    model, bench = load_model(), Bench()
    shared = {
        "model": model,
        "bench": bench,
        "loops": nominal_loops(model, bench),
        "duration_s": bench.quick_duration_s if quick else bench.duration_s,
    }
    chosen = cases(seed, quick)
    outcomes = in_parallel(_outcome, [shared | {"case": case} for case in chosen], on_progress)
    return dict(zip(chosen, outcomes, strict=True))


def _outcome(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    duration_s: float,
    case: Case,
) -> Outcome:
    column = BY_NAME[case.column]
    machine, around = grown_machine(model, case.growth), grown_bench(bench, case.growth)
    jacobian, form = VARIANTS[case.variant]
    run = track_spiral(
        machine,
        around,
        loops,
        column.goal,
        failures=column.failures,
        jacobian=jacobian,
        form=form,
        seed=case.seed,
        duration_s=duration_s,
    )
    geometry = hexapod(model)
    seen, passed = (
        slice(None, None, round(stride_s / bench.control_period_s))
        for stride_s in (STRIDE_S, VISITED_STRIDE_S)
    )
    strut_m, secondary = run.strut_displacement_m[seen], run.secondary[seen]
    visited_m = run.strut_displacement_m[passed]
    constant = StrutMapping(geometry, column.goal, "constant")
    return Outcome(
        trajectory=run,
        extra_percent=extra_percent(
            column.goal,
            (strut_m, secondary),
            optimum(geometry, column.goal, run.true_rad[seen]),
        ),
        static_extra_percent=_static(
            StrutMapping(geometry, column.goal, jacobian, form=form), run.desired_rad[seen]
        ),
        e_visited={n: float(relative_change(geometry, visited_m, n).max()) for n in NORMS},
        loop_gain_error=loop_gain_error(constant, visited_m),
    )


def _static(mapping: StrutMapping, desired_rad: Array) -> float:
    visited = follow(mapping, desired_rad)
    best = optimum(mapping.geometry, mapping.goal, visited.pointing_rad)
    return extra_percent(mapping.goal, (visited.strut_m, visited.secondary), best)
