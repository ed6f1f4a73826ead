"""Studies that only these tests need, made by their commands once a session."""

import logging
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import fjh, folder_of

AT_NIGHT = {f"{name}_folder" for name in ("table1", "release", "goals", "recover")}
"""Studies that take 30 to 60 s of a core: by day they run at the size of the `short_` fixtures."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave for the night what needs one of these studies at its own length."""
    for item in items:
        needs = AT_NIGHT & set(getattr(item, "fixturenames", ()))
        if needs and Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.long)
            item.add_marker(pytest.mark.night)


HERE = ("--workers", "2")
SHORT_SWEEP = Path(__file__).with_name("short_sweep.toml")
FAILING = ("--path", "spiral", "--duration", "4", "--fail", "strut1:locked@2")

track_folder = folder_of("track", "--quick", *FAILING)
survey_folder = folder_of("survey", "--quick")
figures_folder = folder_of("figures")
uncorrected_folder = folder_of("uncorrected", "--quick")
limits_folder = folder_of("limits", "--quick")
force_folder = folder_of("force", "--quick")
sweep_folder = folder_of("sweep", "--design", str(SHORT_SWEEP), *HERE)


@pytest.fixture(scope="session")
def smaller(made_once):
    """Makes a study smaller than its --quick, by other values of names in its modules."""

    def made(name: str, values: dict[str, Any], *words: str) -> Path:
        def make(folder: Path) -> int:
            with pytest.MonkeyPatch.context() as patch:
                for place, value in values.items():
                    patch.setattr(f"experiments.{place}", value)
                return fjh(name, "--quick", *words)(folder)

        return made_once(f"smaller_{name}", make)

    return made


@pytest.fixture(scope="session")
def short_table1_folder(smaller):
    """A second of the spiral."""
    from experiments.table1 import CONFIGURATIONS
    from fjh.rig.hexapod.testbed import TestbedConfig

    bench = TestbedConfig(quick_duration_s=1.0)
    return smaller("table1", {"table1.CONFIGURATIONS": CONFIGURATIONS | {"calibrated": bench}})


@pytest.fixture(scope="session")
def short_release_folder(smaller):
    """A second of the spiral, the first and the last stiffness."""
    from experiments.release import RATIOS
    from fjh.rig.hexapod.rig import nominal_testbed
    from fjh.rig.hexapod.testbed import TestbedConfig

    testbed = nominal_testbed(TestbedConfig(quick_duration_s=1.0))
    ratios = (RATIOS[0], *RATIOS[1:3], RATIOS[-1])  # of which --quick takes every third
    values = {"release.nominal_testbed": lambda: testbed, "release.RATIOS": ratios}
    return smaller("release", values)


@pytest.fixture(scope="session")
def short_goals_folder(smaller):
    """The stroke of the hexapod, and the singularity of the arm."""
    from experiments.goals import GOALS

    return smaller("goals", {"goals.GOALS": GOALS[1::2]})


@pytest.fixture(scope="session")
def short_recover_folder(smaller):
    """A case of each sort."""
    from experiments.recover.plan import QUICK

    few = [(*block[:3], 1) for block in QUICK if block[2] in (0.3, 1.0)]
    return smaller("recover", {"recover.plan.QUICK": few})


FLOWN = ("SSSSSS", "FSSSSS", "SSLSSS", "SLLSLL", "SFFSLF", "LLLLLL")
"""Failure conditions of every verdict; the fifth leaves the linear model where it is singular."""


@pytest.fixture(scope="session")
def atlas_folder(smaller):
    """A few failure conditions simulated."""
    return smaller("atlas", {"sweep.representatives": lambda: [*FLOWN]}, *HERE)


@pytest.fixture(scope="session")
def scheduler():
    """The address of a Dask cluster of two workers."""
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
