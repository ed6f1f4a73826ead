"""The rooms and the floor beneath them, one direction: who may import whom."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
THIRD_PARTY = {
    "mujoco",
    "rerun",
    "control",
    "matplotlib",
    "typer",
    "rich",
    "scipy",
    "numpy",
    "jinja2",
    "psutil",
    "daqp",
    "mink",
    "placo",
    "threadpoolctl",
    "dask",
    "distributed",
    "pyarrow",
}
ALLOWED = {
    "argument_checks": {"numpy", "scipy"},
    "prioritized": {"numpy", "scipy", "argument_checks"},
    "sim": {"numpy", "scipy", "mujoco", "argument_checks"},
}


def imported(room: str) -> set[str]:
    """Top-level names that a room imports, its own left out."""
    names = set()
    for file in (ROOT / room).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module.split(".")[0])
    return names - {room}


@pytest.mark.parametrize("room", ALLOWED)
def test_a_room_imports_only_what_it_may(room):
    rooms = {"argument_checks", "prioritized", "sim", "experiments", "tests"}
    assert imported(room) & (THIRD_PARTY | rooms) <= ALLOWED[room]


def test_the_check_sees_imports():
    assert {"prioritized", "sim", "rerun"} <= imported("experiments")
