"""The rooms, one direction, and the floors of `experiments`: who may import whom."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.studies import LINES, study

ROOT = Path(__file__).parents[2]
ALLOWED = {
    "argument_checks": {"numpy", "scipy"},
    "kernels": {"_cffi_backend", "cffi", "numpy"},
    "prioritized": {"numpy", "scipy", "argument_checks", "kernels"},
    "sim": {"numpy", "scipy", "mujoco", "argument_checks", "kernels"},
    "ftc": {"numpy", "scipy", "control", "prioritized", "argument_checks", "kernels"},
}
"""As in the table of CONTRIBUTING.md, which a test compares."""
FLOORS = {
    **{"study": 0, "ik": 1, "rig": 1, "recording": 2, "goals_physics": 2, "certificate": 2},
    **{"sweep_design": 2, "studies": 4, "results": 5, "comparison": 6, "app": 7},
}
"""Of `experiments`, from below; whatever else is there is a study."""
STUDY = 3


def imported(file: Path) -> set[str]:
    """Modules that a file imports, by their full names."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            below = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= below if node.module == "experiments" else {node.module}
    return names


def imported_by(room: str) -> set[str]:
    """Top-level names that a room imports, the standard library's and its own left out."""
    files = (ROOT / room).rglob("*.py")
    names = {name.split(".")[0] for file in files for name in imported(file)}
    return names - {room} - sys.stdlib_module_names


@pytest.mark.parametrize("room", ALLOWED)
def test_a_room_imports_only_what_it_may(room):
    assert imported_by(room) <= ALLOWED[room]


@pytest.mark.parametrize("room", ALLOWED)
def test_the_page_for_contributors_says_what_a_room_may_import(room):
    page = (ROOT / "CONTRIBUTING.md").read_text()
    row = next(line for line in page.splitlines() if line.startswith(f"| `{room}/` |"))
    assert set(re.findall(r"[\w]+", row.split("|")[3])) == ALLOWED[room]


ORDER = {
    "sim": ("mjcf", "closing", "kinematics", "tasks", "hexapod", "plant", "scene"),
    "prioritized": ("_solver", "_mechanism", "_mapping", "_analysis"),
    "ftc": ("control", "fdi"),
}
"""Folders of a room, from below; files beside them are free."""


@pytest.mark.parametrize("room", ORDER)
def test_a_folder_of_a_room_imports_only_those_before_it(room):
    order = ORDER[room]
    assert {path.parent.name for path in (ROOT / room).glob("*/__init__.py")} == set(order)
    wrong = {
        f"{file.relative_to(ROOT)} imports {name}"
        for above, folder in enumerate(order)
        for file in (ROOT / room / folder).rglob("*.py")
        for name in imported(file)
        if name.startswith(f"{room}.") and name.split(".")[1] in order[above + 1 :]
    }
    assert not wrong, "\n".join(sorted(wrong))


TESTED = {"prioritized": {"ftc", "experiments"}, "sim": {"ftc"}}
"""Folders of tests, and the rooms above theirs that they do without."""


@pytest.mark.parametrize("folder", TESTED)
def test_tests_of_a_room_do_without_those_above_it(folder):
    assert not imported_by(f"tests/{folder}") & TESTED[folder]


def test_a_test_is_in_the_folder_of_what_it_tests():
    assert not list((ROOT / "tests").glob("test_*.py"))


@pytest.mark.parametrize(
    "file", ["fjh/_checkout.py", "experiments/__main__.py", "experiments/app/start.py"]
)
def test_what_says_that_something_is_missing_needs_nothing_installed(file):
    outside = {name.split(".")[0] for name in imported(ROOT / file)}
    assert outside - sys.stdlib_module_names <= {"experiments"}


def test_inverse_kinematics_need_no_loop_and_no_study():
    """Importable with the extra `sim` alone."""
    files = (ROOT / "experiments" / "ik").rglob("*.py")
    names = {name for file in files for name in imported(file)}
    ours = {name.split(".")[0] for name in names if not name.startswith("experiments.ik")}
    assert ours - sys.stdlib_module_names == {
        *("argument_checks", "mujoco", "numpy", "prioritized", "sim")
    }


def floor_of(place: str) -> int:
    return FLOORS.get(place, STUDY)


PLACES = sorted(
    path.stem
    for path in (ROOT / "experiments").iterdir()
    if (path.is_dir() or path.suffix == ".py") and not path.name.startswith("_")
)


@pytest.mark.parametrize("place", PLACES)
def test_no_floor_imports_upward_and_no_study_another(place):
    wrong, folder = set(), ROOT / "experiments" / place
    for file in sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]:
        parts = (name.split(".") for name in imported(file) if name.startswith("experiments."))
        wrong |= {
            f"{file.relative_to(ROOT)} imports {other}"
            for _, other, *_ in parts
            if other != place and floor_of(other) >= floor_of(place)
        }
    assert not wrong, "\n".join(sorted(wrong))


def test_the_registry_has_every_study_and_the_first_line_of_its_help():
    places = {name for name in PLACES if floor_of(name) == STUDY}
    assert {study(name).__module__.split(".")[1] for name in LINES} == places
    assert {name: (study(name).__doc__ or "").partition("\n")[0] for name in LINES} == LINES


def test_the_check_sees_imports():
    assert {"prioritized", "sim", "ftc", "rerun"} <= imported_by("experiments")
    assert "experiments.rig.hexapod.controller" in imported(
        ROOT / "tests" / "rig" / "test_bench.py"
    )


NOT_OF_SIM = ("rerun", "rerun_loader_mjcf", "pyarrow", "typer", "rich", "distributed", "psutil")


@pytest.mark.long
def test_a_rig_needs_the_extra_sim_alone():
    """Who flies a robot from Python needs none of what recordings, tables and commands need."""
    code = f"""
import sys

class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {NOT_OF_SIM}:
            raise ImportError(name)

sys.meta_path.insert(0, Refused())
from experiments.rig import Rig
rig = Rig.hexapod()
print(rig.fly(rig.controller(), [[0.0, 0.0]]).status)
"""
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "This controller does not diagnose.\n"
