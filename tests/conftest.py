import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import settings
from matplotlib.figure import Figure

from experiments.app.cli import main
from experiments.output.plotting import save_figure
from experiments.sweep.cluster import Where, cluster
from sim import load_model
from tests.figure_checks import faults

# Timings are noise on a busy machine, and a run of the suite must be one that can be repeated.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


AT_LENGTH = {
    *("table1_folder", "release_folder", "recover_folder", "systems_folder", "jacobian_folder"),
    *("goals_folder", "force_run", "uncorrected_folder", "bench_folder", "sweep_folder"),
    *("atlas_folder", "seeds_folder", "crew"),
}
"""Fixtures that run a study or a cluster; `figures_folder` takes seconds, and is not among them."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as long whatever needs the files of a study, however it comes by them."""
    for item in items:
        if AT_LENGTH & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.long)


@pytest.fixture(scope="session")
def model() -> mujoco.MjModel:
    """The hexapod; plants copy it, tests that alter it must copy it too."""
    return load_model()


@pytest.fixture(scope="session", autouse=True)
def faults_of_figures():
    """What is wrong with each figure that the commands save, by its name, as it was saved last."""
    found: dict[str, list[str]] = {}

    def save(figure: Figure, folder: Path, name: str, *formats: tuple[str, ...]) -> None:
        save_figure(figure, folder, name, *formats)
        found[name] = faults(figure)  # after it, since drawing moves what is not yet laid out

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.output.plotting.save_figure", save)
        yield found


@pytest.fixture(scope="session")
def table1_folder(tmp_path_factory):
    """All of Table I at full length, made by the command."""
    folder = tmp_path_factory.mktemp("table1")
    assert main(["table1", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def figures_folder(tmp_path_factory):
    """Machine, loops and failures drawn, made by the command."""
    folder = tmp_path_factory.mktemp("figures")
    assert main(["figures", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def release_folder(tmp_path_factory):
    """The released strut at full length, made by the command."""
    folder = tmp_path_factory.mktemp("release")
    assert main(["release", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def release(release_folder):
    """`release.json`."""
    return json.loads((release_folder / "release.json").read_text())


@pytest.fixture(scope="session")
def recover_folder(tmp_path_factory):
    """Failures in flight, a few: made by the command."""
    folder = tmp_path_factory.mktemp("recover")
    assert main(["recover", "--quick", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def recover(recover_folder):
    """`recover.json`."""
    return json.loads((recover_folder / "recover.json").read_text())


@pytest.fixture(scope="session")
def systems_folder(tmp_path_factory):
    """Every mechanism in every condition, made by the command."""
    folder = tmp_path_factory.mktemp("systems")
    assert main(["systems", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def systems(systems_folder):
    """`systems.json`."""
    return json.loads((systems_folder / "systems.json").read_text())


@pytest.fixture(scope="session")
def jacobian_folder(tmp_path_factory):
    """The study of the Jacobian, in the loop too, short: made by the command."""
    folder = tmp_path_factory.mktemp("jacobian")
    assert main(["jacobian", "--loop", "--quick", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def jacobian_study(jacobian_folder):
    """`jacobian.json`."""
    return json.loads((jacobian_folder / "jacobian.json").read_text())


@pytest.fixture(scope="session")
def goals_folder(tmp_path_factory):
    """The four secondary goals, short: made by the command."""
    folder = tmp_path_factory.mktemp("goals")
    assert main(["goals", "--quick", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def goals(goals_folder):
    """`goals.json`."""
    return json.loads((goals_folder / "goals.json").read_text())


@pytest.fixture(scope="session")
def bench_folder(tmp_path_factory):
    """Everything timed, but as briefly as can be: made by the command."""
    from experiments.benchmark import runs

    folder = tmp_path_factory.mktemp("bench")
    least = runs.Effort(seconds=0.05, rounds=2, batches=(1, 10, 100), actuators=(6, 10, 20))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs, "QUICK", least)
        saved = str(folder / "saved.json")
        assert main(["bench", "--quick", "--save", saved, "--out", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture(scope="session")
def bench(bench_folder):
    """`bench.json`."""
    return json.loads((bench_folder / "bench.json").read_text())


@pytest.fixture(scope="session")
def crew():
    """A client of a Dask cluster of two workers."""
    with cluster(Where(workers=2), most=2) as client:
        yield client


@pytest.fixture(scope="session")
def scheduler(crew):
    """Its address."""
    return crew.scheduler_info()["address"]


@pytest.fixture(scope="session")
def sweep_design(tmp_path_factory):
    """A design file: a few short runs, some of which fail in flight, told and not told."""
    path = tmp_path_factory.mktemp("design") / "short.toml"
    path.write_text("""
layout = "latin-hypercube"
runs = 30
duration_s = 0.2
[vary]
settling_s = 0.1
struts = ["SSSSSS", "SLSSSS"]
failure_time_s = [0.0, 0.1]
known = [true, false]
roll_off_hz = { from = 20, to = 30 }
""")
    return path


@pytest.fixture(scope="session")
def sweep_folder(sweep_design, scheduler, tmp_path_factory):
    """That sweep, made by the command."""
    folder = tmp_path_factory.mktemp("sweep")
    words = ["sweep", "--design", str(sweep_design), "--scheduler", scheduler]
    assert main([*words, "--out", str(folder)]) == 0
    return folder


FLOWN = ("SSSSSS", "FSSSSS", "SSLSSS", "SLLSLL", "SFFSLF", "LLLLLL")
"""Failure conditions of every verdict; the fifth leaves the linear model where it is singular."""


@pytest.fixture(scope="session")
def atlas_folder(scheduler, tmp_path_factory):
    """A few failure conditions simulated, made by the command."""
    folder = tmp_path_factory.mktemp("atlas")
    with pytest.MonkeyPatch.context() as few:
        few.setattr("experiments.sweep.runs.representatives", lambda: FLOWN)
        words = ["atlas", "--quick", "--scheduler", scheduler, "--out", str(folder)]
        assert main(words) == 0
    return folder


@pytest.fixture(scope="session")
def table1(table1_folder):
    """`table1.json`, its columns by name."""
    summary = json.loads((table1_folder / "table1.json").read_text())
    return summary | {"by_name": {column["name"]: column for column in summary["columns"]}}


@pytest.fixture(scope="session")
def runs(table1, table1_folder):
    """The `.npz` of each column, by name."""

    def load(file: str) -> dict[str, np.ndarray]:
        with np.load(table1_folder / file) as data:
            return dict(data)

    return {name: load(column["data"]) for name, column in table1["by_name"].items()}
