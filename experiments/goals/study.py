"""All four goals, each in every way: secondary goals that do not touch the major task."""

from collections.abc import Callable

from experiments.goals import obstacle, reliability, singularity, stroke
from experiments.goals.demonstration import Outcome, ways
from experiments.hexapod.simulation import nominal_loops
from experiments.hexapod.testbed import Bench
from experiments.output.parallel import in_parallel
from sim import load_model

DEMONSTRATIONS = (
    reliability.DEMONSTRATION,
    stroke.DEMONSTRATION,
    obstacle.DEMONSTRATION,
    singularity.DEMONSTRATION,
)

Outcomes = dict[str, dict[str, Outcome]]
"""By demonstration and way."""


def run_goals(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Outcomes:
    """Run every demonstration in every way, side by side on the machine's cores.

    Args:
        seed: Of the sensor noise.
        quick: Shorter runs, one weight.
        on_progress: Called with finished and total number of runs.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    loops = nominal_loops(load_model(), Bench())
    pairs = [(one, way) for one in DEMONSTRATIONS for way in ways(seed, quick)]
    calls = [
        {
            "run": one.run,
            "way": way,
            "duration_s": one.quick_duration_s if quick else one.duration_s,
            "loops": loops,
        }
        for one, way in pairs
    ]
    results = in_parallel(_run, calls, on_progress)
    outcomes: Outcomes = {one.name: {} for one in DEMONSTRATIONS}
    for (one, way), outcome in zip(pairs, results, strict=True):
        outcomes[one.name][way.name] = outcome
    return outcomes


def _run(run: Callable[..., Outcome], **arguments: object) -> Outcome:
    return run(**arguments)
