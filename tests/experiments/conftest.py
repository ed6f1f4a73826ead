"""Studies that only these tests need, made by their commands once a session."""

import logging
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import fjh

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


@pytest.fixture(scope="session")
def short(made_once):
    """Makes a study smaller than its --quick, for which names of its modules are changed."""

    def made(name: str, **changed: Any) -> Path:
        def make(folder: Path) -> int:
            with pytest.MonkeyPatch.context() as smaller:
                for place, value in changed.items():
                    smaller.setattr(f"experiments.{place.replace('__', '.')}", value)
                return fjh(name, "--quick")(folder)

        return made_once(f"short_{name}", make)

    return made


@pytest.fixture(scope="session")
def short_table1_folder(short):
    """A second of the spiral."""
    from experiments.table1 import CONFIGURATIONS
    from fjh.rig.hexapod.testbed import TestbedConfig

    bench = TestbedConfig(quick_duration_s=1.0)
    return short("table1", table1__CONFIGURATIONS=CONFIGURATIONS | {"calibrated": bench})


@pytest.fixture(scope="session")
def short_release_folder(short):
    """A second of the spiral, two stiffnesses."""
    from experiments.release import RATIOS
    from fjh.rig.hexapod.rig import nominal_testbed
    from fjh.rig.hexapod.testbed import TestbedConfig

    testbed = nominal_testbed(TestbedConfig(quick_duration_s=1.0))
    ratios = RATIOS[:: len(RATIOS) - 1]
    ends = {
        "release__nominal_testbed": lambda: testbed,
        "release__RATIOS": (*ratios[:1], 0, 0, ratios[1]),
    }
    return short("release", **ends)


@pytest.fixture(scope="session")
def short_goals_folder(short):
    """The stroke of the hexapod, and the singularity of the arm."""
    from experiments.goals import GOALS

    return short("goals", goals__GOALS=GOALS[1::2])


@pytest.fixture(scope="session")
def short_recover_folder(short):
    """A case of each sort."""
    from experiments.recover.plan import QUICK

    few = [
        (sort, mismatch, factor, 1) for sort, mismatch, factor, _ in QUICK if factor in (1.0, 0.3)
    ]
    return short("recover", recover__plan__QUICK=few)


@pytest.fixture(scope="session")
def track_folder(made_once):
    """The hexapod on two seconds of its spiral, a strut stuck halfway."""
    words = ("--path", "spiral", "--duration", "4", "--fail", "strut1:locked@2")
    return made_once("track", fjh("track", "--quick", *words))


@pytest.fixture(scope="session")
def survey_folder(made_once):
    """What failures leave the hexapod."""
    return made_once("survey", fjh("survey", "--quick"))


@pytest.fixture(scope="session")
def figures_folder(made_once):
    """Machine, loops and failures drawn."""
    return made_once("figures", fjh("figures"))


@pytest.fixture(scope="session")
def uncorrected_folder(made_once):
    """The first seconds of three explanations."""
    return made_once("uncorrected", fjh("uncorrected", "--quick"))


@pytest.fixture(scope="session")
def limits_folder(made_once):
    """Limits in the loop, short."""
    return made_once("limits", fjh("limits", "--quick"))


@pytest.fixture(scope="session")
def force_folder(made_once):
    """Forces with strut 1 failing, short."""
    return made_once("force", fjh("force", "--quick"))


@pytest.fixture(scope="session")
def crew():
    """A client of a Dask cluster of two workers."""
    from distributed import Client, LocalCluster

    here = LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL + 1,
    )
    with here, Client(here) as client:
        yield client


@pytest.fixture(scope="session")
def scheduler(crew):
    """Its address."""
    return crew.scheduler_info()["address"]


DESIGN = """
layout = "latin-hypercube"
runs = 30
duration_s = 0.2
[vary]
settling_s = 0.1
struts = ["SSSSSS", "SLSSSS"]
failure_time_s = [0.0, 0.1]
known = [true, false]
roll_off_hz = { from = 20, to = 30 }
"""
"""A few short runs, some of which fail in flight, told and not told."""


@pytest.fixture(scope="session")
def sweep_design(made_once):
    """A design file."""

    def make(folder: Path) -> int:
        folder.mkdir()
        return (folder / "short.toml").write_text(DESIGN) != len(DESIGN)

    return made_once("design", make) / "short.toml"


@pytest.fixture(scope="session")
def sweep_folder(sweep_design, made_once):
    """That sweep."""
    return made_once("sweep", fjh("sweep", "--design", str(sweep_design), "--workers", "2"))


FLOWN = ("SSSSSS", "FSSSSS", "SSLSSS", "SLLSLL", "SFFSLF", "LLLLLL")
"""Failure conditions of every verdict; the fifth leaves the linear model where it is singular."""


@pytest.fixture(scope="session")
def atlas_folder(made_once):
    """A few failure conditions simulated."""

    def make(folder: Path) -> int:
        with pytest.MonkeyPatch.context() as few:
            few.setattr("experiments.sweep.representatives", lambda: [*FLOWN])
            return fjh("atlas", "--quick", "--workers", "2")(folder)

    return made_once("atlas", make)
