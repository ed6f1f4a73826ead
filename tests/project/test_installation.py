"""Tests of the installed package, messages for missing packages, and the version."""

import ast
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import argument_checks
import fjh
import fjh.rig
import ftc
import prioritized
import sim
from experiments.app.cli import main
from experiments.app.start import PACKAGES, run
from hatch_build import FOLDERS, stage

ROOT = Path(__file__).parents[2]


def python(folder: Path, *arguments: str, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run the interpreter in a user's folder, with this project behind it on the path."""
    environment = os.environ | {"PYTHONPATH": str(path)}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True
    )


def users_own(folder: Path) -> None:
    """Create packages of the user with the names of this project's folders."""
    for name in ("experiments", "models", "sim"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("MINE = True\n")


@pytest.mark.long
def test_an_installed_package_does_not_hide_packages_of_the_user(tmp_path):
    """A script next to folders `sim`, `models` and `experiments` of the user imports both."""
    stage(ROOT, tmp_path / "site" / "fjh")
    user = tmp_path / "user"
    user.mkdir()
    users_own(user)
    (user / "script.py").write_text(
        "import fjh, experiments, models, sim\n"
        "assert experiments.MINE and models.MINE and sim.MINE\n"
        "print(fjh.load_model().nu, fjh.Rig.__module__, fjh.sim.Failure is fjh.Failure)\n"
        "import sys\n"
        f"print([m.__file__ for m in sys.modules.values() if {str(ROOT / 'sim')!r} in repr(m)])\n"
    )
    done = python(user, "script.py", path=tmp_path / "site")
    assert (done.stdout, done.stderr) == ("6 fjh.rig.rig True\n[]\n", "")


@pytest.mark.long
def test_every_import_in_the_wheel_starts_at_fjh(tmp_path):
    stage(ROOT, tmp_path / "fjh")
    left = set()
    for file in tmp_path.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or ""]
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                for name in re.findall(r"^[a-z_]+\.[\w.]+(?=:\w+$|$)", node.value):
                    place = ROOT / name.replace(".", "/")
                    if place.with_suffix(".py").is_file() or (place / "__init__.py").is_file():
                        names.append(name)
            left |= {f"{file}: {name}" for name in names if name.split(".")[0] in FOLDERS}
    assert not left


def test_both_names_in_a_checkout_are_one_object():
    assert fjh.Rig is fjh.rig.Rig
    assert fjh.load_model is sim.load_model
    assert fjh.ConstrainedSystem is prioritized.ConstrainedSystem
    assert importlib.import_module("fjh.sim.plant.linear") is importlib.import_module(
        "sim.plant.linear"
    )
    assert sim.__spec__.name == sim.__name__ == "sim"


def test_the_packages_of_fjh_are_the_folders_of_the_wheel():
    packages = {name for name in fjh.__all__ if isinstance(getattr(fjh, name), ModuleType)}
    assert packages == {"experiments", "ftc", "prioritized", "sim"} < set(FOLDERS)
    assert set(FOLDERS) - {"models"} == set(fjh._checkout.FOLDERS)  # models contain no Python


@pytest.mark.parametrize("name", fjh.__all__)
def test_each_public_name_exists_and_is_documented(name):
    assert getattr(fjh, name).__doc__
    assert name in dir(fjh)


def test_an_unknown_name_is_an_attribute_error():
    assert not hasattr(fjh, "rigs")


def test_the_import_of_fjh_loads_no_large_package(tmp_path):
    code = "import sys, fjh; print({'numpy', 'mujoco', 'cffi'} & set(sys.modules))"
    assert python(tmp_path, "-c", code).stdout == "set()\n"


def test_a_folder_that_hides_a_package_of_the_checkout_is_reported(tmp_path):
    users_own(tmp_path)
    done = python(tmp_path, "-c", "import fjh")
    message = f"{tmp_path}/experiments/__init__.py, not {ROOT}/experiments: rename the former"
    assert message in done.stderr.splitlines()[-1]


@pytest.mark.parametrize("package", PACKAGES)
def test_the_command_reports_a_missing_extra(monkeypatch, capsys, package):
    monkeypatch.setitem(sys.modules, package, None)  # its import then fails
    with pytest.raises(SystemExit) as end:
        run()
    assert end.value.code == 2
    message = capsys.readouterr().err
    assert f'not installed, {package}: in a checkout, pip install ".[all]"' in message
    assert message.count("\n") == 1


def test_sim_reports_a_missing_extra(tmp_path):
    absent = "import sys; sys.modules['mujoco'] = None; "
    last = python(tmp_path, "-c", absent + "import sim").stderr.splitlines()[-1]
    message = "ModuleNotFoundError: sim needs mujoco, which is not installed: in a checkout, "
    assert last == f'{message}pip install ".[sim]"'


def test_all_packages_have_one_version(capsys):
    version = argument_checks.__version__
    assert {prioritized.__version__, ftc.__version__, sim.__version__} == {version}
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"fjh {version}\n"
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {version} (" in (ROOT / "CHANGELOG.md").read_text()


NOT_OF_SIM = ("rerun", "rerun_loader_mjcf", "pyarrow", "typer", "rich", "distributed", "psutil")


@pytest.mark.long
def test_a_rig_needs_only_the_extra_sim(tmp_path):
    """Simulation from Python needs no packages for recordings, tables or commands."""
    code = f"""
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {NOT_OF_SIM}:
            raise ImportError(name)

sys.meta_path.insert(0, Missing())
from fjh.rig import Rig
rig = Rig.hexapod()
print(rig.fly(rig.controller(), [[0.0, 0.0]]).status)
"""
    done = python(tmp_path, "-c", code)
    assert done.stdout == "This controller does not diagnose.\n", done.stderr
