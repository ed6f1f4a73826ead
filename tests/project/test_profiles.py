"""What the settings of all tests promise: how many examples, whether they are new, no imports."""

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.profiles import EXAMPLES, chosen, examples

ROOT = Path(__file__).parents[2]


@pytest.fixture
def loaded():
    """Puts a profile in force until the test ends."""
    before = settings.get_current_profile_name()
    yield settings.load_profile
    settings.load_profile(before)


@pytest.mark.parametrize(
    ("properties", "ci", "expected"),
    [("", "", "local"), ("", "true", "ci"), ("night", "true", "night"), ("local", "true", "local")],
)
def test_the_environment_chooses(monkeypatch, properties, ci, expected):
    monkeypatch.setenv("PROPERTIES", properties)
    monkeypatch.setenv("CI", ci)
    assert chosen() == expected


@pytest.mark.parametrize("name", EXAMPLES)
def test_numbers_stated_for_ci_scale_with_the_profile(loaded, name):
    loaded(name)
    assert settings.default is not None
    assert settings.default.max_examples == EXAMPLES[name]
    assert examples(60).max_examples == 60 * EXAMPLES[name] // EXAMPLES["ci"]
    assert examples(1).max_examples >= 1


@pytest.mark.parametrize(("name", "repeats"), [("local", True), ("ci", True), ("night", False)])
def test_only_the_night_tries_examples_that_were_not_tried_before(name, repeats):
    def tried() -> list[int]:
        seen = []

        @settings(settings.get_profile(name), database=None, max_examples=20)
        @given(st.integers())
        def record(number):
            seen.append(number)

        record()
        return seen

    assert (tried() == tried()) is repeats


LIGHT = """
import sys
import tests.conftest
heavy = {"control", "distributed", "matplotlib", "mujoco", "scipy", "typer"}
print(*heavy & set(sys.modules))
"""


def test_whoever_runs_one_test_does_not_wait_for_what_it_does_not_need():
    done = subprocess.run(
        [sys.executable, "-c", LIGHT], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert done.stdout.split() == []


CONTROLLER = """
import sys
import ftc
heavy = {"control", "matplotlib", "mujoco", "scipy.signal", "scipy.stats"}
print(*heavy & set(sys.modules))
"""


def test_controllers_wait_neither_for_the_design_of_loops_nor_for_plots():
    done = subprocess.run(
        [sys.executable, "-c", CONTROLLER], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert done.stdout.split() == []
