"""The rooms and their parts: who may import whom."""

import ast
import importlib
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path
from types import ModuleType

import pytest

from experiments.studies import LINES, PAPER, study

ROOT = Path(__file__).parents[2]
ALLOWED = {
    "argument_checks": {"numpy", "scipy"},
    "kernels": {"_cffi_backend", "cffi", "numpy"},
    "prioritized": {"numpy", "scipy", "argument_checks", "kernels"},
    "sim": {"numpy", "scipy", "mujoco", "argument_checks", "kernels"},
    "ftc": {"numpy", "scipy", "control", "prioritized", "argument_checks", "kernels"},
}
"""As in the table of CONTRIBUTING.md, which a test compares."""
OPEN = ("fjh", "experiments")
"""Rooms whose parts are places of their own in the drawing."""
NO_STUDIES = {"again", "app", "studies", "study"}
"""What else is in `experiments`."""


def imported(file: Path) -> set[str]:
    """Modules that a file imports, by their full names."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            below = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= below if node.module in OPEN else {node.module}
    return names


def place_of(module: str) -> str:
    """The place of a module in the drawing: its room, or its part of an open one."""
    room, *parts = module.split(".")
    if room not in OPEN or not parts:
        return room
    if room == "experiments" and parts[0] not in NO_STUDIES:
        return "experiments/STUDY"
    return f"{room}/{parts[0]}"


def arrows() -> dict[str, set[str]]:
    """Each place, and the places that it imports; the lists of public names left out."""
    found: dict[str, set[str]] = {}
    for file in (file for room in (*ALLOWED, *OPEN) for file in (ROOT / room).rglob("*.py")):
        module = ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        ours = {name for name in imported(file) if name.split(".")[0] in {*ALLOWED, *OPEN}}
        if module not in (*OPEN, "fjh._checkout", "experiments.__main__"):
            place = place_of(module)
            found.setdefault(place, set()).update({place_of(name) for name in ours} - {place})
    return found


def drawing() -> str:
    """The places in Mermaid; an arrow that follows from others is left out."""
    found = arrows()

    def reached(place: str) -> set[str]:
        below = found.get(place, set())
        return below.union(*map(reached, below))

    lines = [
        f"    {place} --> {other}"
        for place in sorted(found)
        for other in sorted(found[place])
        if not any(other in reached(each) for each in found[place])
    ]
    return "\n".join(["```mermaid", "graph TD", *lines, "```"])


def test_no_arrow_leads_back():
    TopologicalSorter(arrows()).prepare()  # raises CycleError


def test_the_drawing_of_imports_is_that_of_the_page_for_contributors():
    """A new arrow fails here: whoever wants it draws it, and says why in the commit."""
    assert drawing() in (ROOT / "CONTRIBUTING.md").read_text(), drawing()


def test_no_study_imports_another():
    """What two studies share is below them; a large study has files that begin with its name."""
    wrong = set()
    for file in (ROOT / "experiments").rglob("*.py"):
        name = file.relative_to(ROOT / "experiments").with_suffix("").parts[0]
        others = (each.split(".") for each in imported(file) if each.startswith("experiments."))
        if name not in NO_STUDIES and not name.startswith("__"):
            beside = {each[1] for each in others if not each[1].startswith(name)}
            wrong |= {f"{name} imports {other}" for other in beside - {"study"}}
    assert not wrong


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


PUBLIC = (
    *("prioritized", "sim", "sim.mjcf", "sim.plant", "sim.scene", "sim.tasks"),
    *("ftc", "ftc.control", "ftc.fdi"),
)
"""Modules with lists of public names; all else of these rooms is inside."""


FOR_USERS = {
    # What public functions return, for who annotates; and rows of one body seen from another.
    *(f"prioritized.{name}" for name in ("Attainable", "ForceMapping", "ForceSolution")),
    "sim.Relative",
}
"""Public names that neither other rooms nor pages use."""


def public_names(module: str) -> set[str]:
    """What such a module lists."""
    found = vars(importlib.import_module(module)).items()
    return {
        name
        for name, value in found
        if not name.startswith("_") and not isinstance(value, ModuleType)
    } - {"log_warnings"}  # which `sim` calls


def imports_of_others(*suffixes: str) -> set[tuple[str, str, str]]:
    """File, module and name of what files outside import of these rooms, tests left out."""
    found = set()
    for file in tracked(*suffixes):
        room, text = file.parts[0], (ROOT / file).read_text()
        blocks = [text] if file.suffix == ".py" else re.findall(r"```python\n(.*?)```", text, re.S)
        for node in (node for block in blocks for node in ast.walk(ast.parse(block))):
            if isinstance(node, ast.ImportFrom) and node.module:
                module = node.module.removeprefix("fjh.")
                if module.split(".")[0] in {"prioritized", "sim", "ftc"} - {room}:
                    found |= {(str(file), module, alias.name) for alias in node.names}
    return {each for each in found if not each[0].startswith(("tests/", "tools/"))}


def tracked(*suffixes: str) -> list[Path]:
    """Files of the project with these endings."""
    listed = subprocess.run(
        ["git", "ls-files", *(f"*{suffix}" for suffix in suffixes)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return [Path(line) for line in listed.stdout.splitlines() if (ROOT / line).is_file()]


def test_a_room_is_used_by_its_public_names_alone():
    wrong = {
        f"{file} imports {name} from {module}"
        for file, module, name in imports_of_others(".py", ".md")
        if module not in PUBLIC or name not in {*public_names(module), "fdi"}
    }
    assert not wrong, "\n".join(sorted(wrong))


def test_every_public_name_is_used_outside_its_room():
    """By another room, an example or a page: nothing else is public."""
    used = {(module, name) for _, module, name in imports_of_others(".py", ".md")}
    pages = "".join((ROOT / file).read_text() for file in tracked(".md", "examples/*.py"))
    unused = {
        f"{module}.{name}"
        for module in PUBLIC
        for name in public_names(module)
        if (module, name) not in used and f"{module}.{name}" not in pages
    }
    assert unused == FOR_USERS


ORDER = {
    "sim": ("mjcf", "closing", "kinematics", "tasks", "plant", "scene"),
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


TESTED = {"prioritized": {"ftc", "experiments", "fjh"}, "sim": {"ftc"}}
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
    assert outside - sys.stdlib_module_names <= {"experiments", "fjh"}


def test_inverse_kinematics_need_no_loop_and_no_study():
    """Importable with the extra `sim` alone."""
    files = (ROOT / "fjh" / "ik").rglob("*.py")
    names = {name for file in files for name in imported(file)}
    ours = {name.split(".")[0] for name in names if not name.startswith("fjh.ik")}
    assert ours - sys.stdlib_module_names == {
        *("argument_checks", "mujoco", "numpy", "prioritized", "sim")
    }


def _names(function: ast.FunctionDef) -> set[str]:
    return {each.arg for each in function.args.kwonlyargs}


def test_the_registry_has_every_study_and_the_first_line_of_its_help():
    for name, line in LINES.items():
        assert (study(name).__doc__ or "").partition("\n")[0] == line
    functions = {
        node.name
        for file in (ROOT / "experiments").glob("*.py")
        for node in ast.parse(file.read_text()).body
        if isinstance(node, ast.FunctionDef) and {"seed", "quick", "on_progress"} <= _names(node)
    }
    assert functions <= set(PAPER)


def test_the_check_sees_imports():
    assert {"prioritized", "sim", "ftc", "rerun"} <= imported_by("fjh")
    assert "fjh.rig.hexapod.controller" in imported(
        ROOT / "tests" / "fjh" / "rig" / "test_bench.py"
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
from fjh.rig import Rig
rig = Rig.hexapod()
print(rig.fly(rig.controller(), [[0.0, 0.0]]).status)
"""
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "This controller does not diagnose.\n"
