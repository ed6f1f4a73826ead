"""What a package that is absent, or hidden by a user's folder, means: one sentence. The version."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import argument_checks
import ftc
import prioritized
import sim
from experiments.__main__ import PACKAGES, run
from experiments.app.cli import main
from experiments.benchmark.runs import PACKAGES as BENCH_PACKAGES

ROOT = Path(__file__).parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT, TOOL = SETTINGS["project"], SETTINGS["tool"]
COMMAND = "import sys; sys.argv = ['fjh', '--version']; import fjh_launcher as f; f.run()"
LATE = f"""
import sys
from importlib.machinery import PathFinder
class Late:
    find_spec = staticmethod(lambda name, path, target=None:
        PathFinder.find_spec(name, path or [{str(ROOT)!r}]))
sys.path.remove({str(ROOT)!r})
sys.meta_path.insert(sys.meta_path.index(PathFinder) + 1, Late)
"""
"""An editable installation finds this project after all folders of `sys.path`."""


def python(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Outcome of the interpreter in a user's folder, with this project behind it on the path."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True
    )


def user_package(folder: Path, name: str) -> Path:
    """A package of the user's own, of that name."""
    place = folder / name
    place.mkdir()
    (place / "__init__.py").write_text("")
    return place


def only_line(error: str) -> str:
    """The sentence on standard error, without a traceback."""
    assert error.count("\n") == 1, error
    return error


@pytest.mark.parametrize("name", ["ftc", "prioritized", "sim", "experiments"])
def test_the_command_names_the_folder_that_hides_a_package(tmp_path, name):
    place = user_package(tmp_path, name)
    done = python(tmp_path, "-c", COMMAND)
    assert done.returncode == 2
    assert f"finds {place}, which hides {ROOT / name}" in only_line(done.stderr)


def test_a_module_hides_a_package_too(tmp_path):
    (tmp_path / "sim.py").write_text("")
    done = python(tmp_path, "-c", COMMAND)
    assert f"finds {tmp_path / 'sim.py'}, which hides {ROOT / 'sim'}" in only_line(done.stderr)


def test_an_import_names_the_folder_that_hides_a_package(tmp_path):
    place = user_package(tmp_path, "sim")
    done = python(tmp_path, "-c", "from experiments.rig.hexapod import testbed")
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ImportError: `import sim` finds ")
    assert f"finds {place}, which hides {ROOT / 'sim'}" in last
    done = python(tmp_path, "-m", "experiments", "--version")
    assert done.returncode == 1
    assert str(place) in only_line(done.stderr)


def test_a_folder_that_is_no_package_hides_only_an_editable_installation(tmp_path):
    for name in ("sim", "models"):
        (tmp_path / name).mkdir()
    load = "import experiments, sim; print(sim.load_model().nu)"
    assert python(tmp_path, "-c", load).stdout == "6\n"
    done = python(tmp_path, "-c", LATE + load)
    assert f"finds {tmp_path / 'sim'}, which hides {ROOT / 'sim'}" in done.stderr.splitlines()[-1]
    (tmp_path / "sim").rmdir()
    assert python(tmp_path, "-c", LATE + load).stdout == "6\n"


@pytest.mark.parametrize("package", PACKAGES)
def test_without_the_testbeds_extra_the_command_says_what_to_install(monkeypatch, capsys, package):
    monkeypatch.setitem(sys.modules, package, None)  # what an import of it meets
    with pytest.raises(SystemExit) as end:
        run()
    assert end.value.code == 2
    sentence = only_line(capsys.readouterr().err)
    assert f"not installed, {package}: pip install" in sentence
    assert '"fault-tolerant-hexapod[testbed]"' in sentence


def test_sim_without_mujoco_says_what_to_install(tmp_path):
    absent = "import sys; sys.modules['mujoco'] = None; "
    done = python(tmp_path, "-c", absent + "import sim")
    line = 'pip install "fault-tolerant-hexapod[sim]"'
    assert done.stderr.splitlines()[-1] == (
        f"ModuleNotFoundError: sim needs mujoco, which is not installed: {line}"
    )


def names(requirements: list[str]) -> set[str]:
    """Distributions, without their versions."""
    return {re.split(r"[<>]", requirement)[0] for requirement in requirements}


def test_the_packages_that_the_sentences_speak_of_are_those_of_the_extras():
    extras = PROJECT["optional-dependencies"]
    assert names(PROJECT["dependencies"]) == {"control", "numba", "numpy", "scipy"}
    assert names(extras["sim"]) == {"mujoco"}
    distributions = {name.replace("_", "-") for name in PACKAGES} - {"mujoco", "rerun"}
    assert names(extras["testbed"]) == distributions | {"fault-tolerant-hexapod[sim]", "rerun-sdk"}
    peers = set(BENCH_PACKAGES) - {"qpsolvers"}  # which mink installs
    assert names(extras["bench"]) == peers | {"fault-tolerant-hexapod[testbed]"}


def test_there_is_one_version(capsys):
    version = argument_checks.__version__
    assert {prioritized.__version__, ftc.__version__, sim.__version__} == {version}
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"fjh {version}\n"
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()


def test_every_package_says_that_it_is_typed():
    packages = {name for name in TOOL["pyright"]["include"] if (ROOT / name).is_dir()}
    for package in packages - {"tests", "docs"}:
        assert (ROOT / package / "py.typed").is_file(), package
    assert TOOL["setuptools"]["package-data"]["*"] == ["py.typed"]
