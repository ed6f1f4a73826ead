"""Synthetic short run and study for tests of files, without a simulation."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np

from fjh.recording.record import About, write_run
from fjh.recording.view import Change, RunView, as_run_arrays, stated_of
from fjh.rig import Rig, Run
from fjh.rig.hexapod.columns import hexapod_arrays
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.study.option import OnProgress, Option, Study, seed_of
from fjh.study.result import Result
from sim import NOMINAL, Failure

ABOUT = About("made", "made-seed0", notes=["Made."], parameters={"seed": 0})


@cache
def hexapod() -> Rig:
    """Return the rig of the synthetic run."""
    return Rig.hexapod()


def synthetic_run() -> Run:
    """Create the start of the spiral, tracked up to noise, without other motion."""
    rng, bench, ticks = np.random.default_rng(0), TestbedConfig(), 400
    desired = bench.spiral_rad(ticks * bench.control_period_s)

    def noise(size: float, *shape: int) -> np.ndarray:
        return size * rng.normal(size=(ticks, *shape))

    pose = NOMINAL.moved(np.hstack([desired + noise(1e-6, 2), noise(1e-7, 4)]))
    return Run(
        time_s=bench.time_s(ticks * bench.control_period_s),
        desired=desired,
        true=pointing_angles(pose.rotation),
        measured=desired + noise(1e-6, 2),
        pose=pose,
        estimated=noise(1e-7, 6),
        inputs=noise(1.0, 6),
        displacement=noise(1e-6, 6),
        qpos=np.zeros((ticks, 0)),
        closure_m=np.abs(noise(1e-10)),
        saturated=np.zeros((ticks, 6), dtype=bool),
        failures=(),
        state=None,
        diagnoses=(),
        task_lost=False,
        undiagnosed=None,
        status="Made.",
    )


def write_synthetic_run(folder: Path, name: str = "made", *, locked: bool = True) -> None:
    """Write `made.npz` and `made.rrd` as a study of the hexapod does; strut 1 is locked."""
    run = replace(synthetic_run(), failures=(Failure(0, "locked"),) * locked)
    file, arrays = folder / f"{name}.rrd", hexapod_arrays(run)
    write_run(file, hexapod(), run, ABOUT, arrays=arrays, known="known")


def synthetic_view(
    *incidents: Change, diagnoses: Sequence[Change] = (), **arrays: np.ndarray
) -> RunView:
    """Create the view of a synthetic run with some incidents and changed arrays."""
    rig, own = hexapod(), hexapod_arrays(synthetic_run()) | arrays
    stated = replace(stated_of(rig), incidents=list(incidents), diagnoses=list(diagnoses))
    return RunView(stated, as_run_arrays(own), rig.model)


def synthetic_study(name: str, make: Callable[..., Result]) -> Study:
    """Create a study of this name from a function of its options."""

    def study(
        *,
        seed: Annotated[int, seed_of("nothing")] = 0,
        quick: Annotated[bool, Option(help="Less.")] = False,
        times: Annotated[int, Option(help="How often.")] = 1,
        on_progress: OnProgress,
    ) -> Result:
        """Ask something & <something> else.

        By nothing.
        """
        return make(seed=seed, quick=quick, times=times, on_progress=on_progress)

    study.__name__ = name
    return study
