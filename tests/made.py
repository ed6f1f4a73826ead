"""A short run that no simulation made: for tests that are about files."""

from pathlib import Path

import mujoco
import numpy as np

from experiments.hexapod.recording.keep import keep_run
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import Bench
from experiments.output.recording.file import About
from experiments.output.recording.marks import Mark

MARK = Mark(0, 0.0, "strut 1 locked")


def made_run(ticks: int = 400) -> Trajectory:
    """The spiral's beginning, tracked up to noise; nothing else moves."""
    rng, bench = np.random.default_rng(0), Bench()
    time_s = bench.time_s(ticks * bench.control_period_s)
    desired_rad = bench.desired_rad(time_s)

    def noise(size: float, *shape: int) -> np.ndarray:
        return size * rng.normal(size=(ticks, *shape))

    return Trajectory(
        time_s=time_s,
        desired_rad=desired_rad,
        true_rad=desired_rad + noise(1e-6, 2),
        measured_rad=desired_rad + noise(1e-6, 2),
        strut_input_percent=noise(1.0, 6),
        strut_displacement_m=noise(1e-6, 6),
        secondary=noise(1e-7, 4),
        secondary_estimated=noise(1e-7, 4),
        closure_residual_m=np.abs(noise(1e-10)),
    )


def keep_made(folder: Path, model: mujoco.MjModel, name: str = "made") -> None:
    """`made.npz` and `made.rrd`, as any study writes a run."""
    about = About("made-seed0", name, "notes", {"seed": 0})
    keep_run(folder, name, about, model, Shown(made_run(), [MARK]))
