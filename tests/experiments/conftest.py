"""Folders of studies that only these tests need, made by their commands once a session."""

import logging
from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import fjh, folder_of
from tests.experiments.results import Results

TWO_WORKERS = ("--workers", "2")
SHORT_SWEEP = Path(__file__).with_name("short_sweep.toml")
FAILING = ("--path", "spiral", "--duration", "4", "--fail", "strut1:locked@2")

track_folder = folder_of("track", "--quick", *FAILING)
survey_folder = folder_of("survey", "--quick")
figures_folder = folder_of("figures")
uncorrected_folder = folder_of("uncorrected", "--quick")
limits_folder = folder_of("limits", "--quick")
force_folder = folder_of("force", "--quick")
sweep_folder = folder_of("sweep", "--design", str(SHORT_SWEEP), *TWO_WORKERS)


@pytest.fixture(scope="module")
def study(request) -> Results:
    """Results of the study in a module's name, as goals in test_goals.py."""
    name = request.module.__name__.rpartition("test_")[2]
    return Results(request.getfixturevalue(f"{name}_folder"), name)


@pytest.fixture(scope="session")
def smaller(created_once):
    """Function that makes a study smaller than its --quick, by other values in its modules."""

    def made(name: str, values: dict[str, Any], *arguments: str) -> Path:
        def make(folder: Path) -> int:
            with pytest.MonkeyPatch.context() as patch:
                for place, value in values.items():
                    patch.setattr(f"experiments.{place}", value)
                return fjh(name, "--quick", *arguments)(folder)

        return created_once(f"smaller_{name}", make)

    return made


def second_of_the_spiral() -> Any:
    from fjh.rig.hexapod.testbed import TestbedConfig

    return TestbedConfig(quick_duration_s=1.0)


def smaller_values(name: str) -> dict[str, Any]:
    """Return the values of short studies: a second of the spiral, one case of each sort."""
    if name == "table1":
        from experiments.table1 import CONFIGURATIONS

        return {"table1.CONFIGURATIONS": CONFIGURATIONS | {"calibrated": second_of_the_spiral()}}
    if name == "release":
        from experiments.release import RATIOS
        from fjh.rig.hexapod.rig import nominal_testbed

        testbed = nominal_testbed(second_of_the_spiral())
        ratios = (RATIOS[0], *RATIOS[1:3], RATIOS[-1])  # --quick uses every third
        return {"release.nominal_testbed": lambda: testbed, "release.RATIOS": ratios}
    if name == "goals":  # the singularity of the arm
        from experiments.goals import GOALS

        return {"goals.GOALS": GOALS[3:]}
    if name == "recover":
        from experiments.recover.plan import QUICK

        few = [(*block[:3], 1) for block in QUICK if block[2] in (0.3, 1.0)]
        return {"recover.plan.QUICK": few}
    if name == "systems":
        from experiments.systems import MECHANISMS

        few = [
            replace(mechanism, conditions=mechanism.conditions[:2]) for mechanism in MECHANISMS[:2]
        ]
        return {"systems.MECHANISMS": few}
    if name == "limits":
        from experiments.limits import Strategy

        how = [Strategy(kind) for kind in ("strict", "clipping", "unlimited")]
        how.insert(1, Strategy("strict", slowness=inf))
        return {"limits.strategies": lambda *, quick, loop: how if loop else [how[0], *how[2:]]}
    if name == "uncorrected":
        return {"uncorrected.QUICK": ("lost_strut",), "uncorrected.ROLL_OFF_HZ": (25.0,)}
    return {}  # jacobian uses --quick, without its loop


@pytest.fixture(scope="session")
def smaller_study(smaller) -> Callable[[str], Path]:
    """Function from the name of a study `NIGHT_STUDIES` to the folder of its short version."""
    return lambda name: smaller(name, smaller_values(name))


CONDITIONS = ("SSSSSS", "FSSSSS", "SSLSSS", "SLLSLL", "SFFSLF", "LLLLLL")
"""Failure conditions of every class; the fifth is singular, off the linear model."""


@pytest.fixture(scope="session")
def atlas_folder(smaller):
    """Folder of the atlas with a few failure conditions."""
    return smaller("atlas", {"sweep.representatives": lambda: [*CONDITIONS]}, *TWO_WORKERS)


@pytest.fixture(scope="session")
def scheduler():
    """Address of a Dask cluster of two workers."""
    from distributed import LocalCluster

    here = LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL + 1,
    )
    with here:
        yield here.scheduler_address
