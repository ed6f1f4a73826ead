import json

import mujoco
import numpy as np
import pytest
from hypothesis import settings

from experiments.cli import main
from sim import load_model

# Timings are noise on a busy machine, and a run of the suite must be one that can be repeated.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def model() -> mujoco.MjModel:
    """The hexapod; plants copy it, tests that alter it must copy it too."""
    return load_model()


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
