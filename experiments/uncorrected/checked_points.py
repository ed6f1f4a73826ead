"""Points of the map that are simulated too."""

from typing import Any

from experiments.hexapod.metrics import pointing_rms_urad, rms
from experiments.hexapod.prediction import predicted_error_rad
from experiments.hexapod.simulation import Trajectory, nominal_loops
from experiments.hexapod.testbed import Bench
from experiments.uncorrected.candidates import BENCH
from experiments.uncorrected.machine import damped
from experiments.uncorrected.stability_map import at_crossover
from sim import load_model

CHECKED_POINTS = ((0.05, 12.0, 25.0), (0.02, 6.0, 40.0), (0.005, 7.3, 40.0))
"""(damping ratio, alpha crossover, roll-off) of map points that are simulated too, [-, Hz, Hz]."""


def point_calls(seed: int) -> list[dict[str, Any]]:
    """Arguments of `track_spiral`: W_a and uncorrected, point after point."""
    calls = []
    for ratio, alpha_hz, roll_off_hz in CHECKED_POINTS:
        machine = damped(load_model(), ratio)
        bench = at_crossover(Bench(), alpha_hz, roll_off_hz)
        loops = nominal_loops(machine, bench)
        shared = {"model": machine, "bench": bench, "loops": loops, "jacobian": "constant"}
        calls += [shared | BENCH.run(column, seed) for column in ("W_a", "W_a_uncorrected")]
    return calls


def compare(calls: list[dict[str, Any]], ended: list[Trajectory | float]) -> list[dict[str, Any]]:
    """Simulated beside predicted RMS at the checked points of the map."""
    compared = []
    for k, (call, run) in enumerate(zip(calls, ended, strict=True)):
        ratio, alpha_hz, roll_off_hz = CHECKED_POINTS[k // 2]
        prediction = {key: call[key] for key in call if key != "jacobian"}
        error = predicted_error_rad(**prediction)
        simulated = pointing_rms_urad(run) if isinstance(run, Trajectory) else None
        compared.append(
            {
                "name": ("W_a", "W_a_uncorrected")[k % 2],
                "damping_ratio": ratio,
                "alpha_crossover_hz": alpha_hz,
                "roll_off_hz": roll_off_hz,
                "predicted_urad": None if error is None else 1e6 * rms(error),
                "simulated_urad": simulated,
            }
        )
    return compared
