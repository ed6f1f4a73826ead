import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from filelock import FileLock

from experiments.studies import LINES
from tests import profiles
from tests.durations import pytest_terminal_summary as pytest_terminal_summary

# Fixtures import the command line and MuJoCo themselves, so that single tests start fast.
if TYPE_CHECKING:
    import mujoco

profiles.register()

# Assertions of these modules show the compared values, as in tests.
pytest.register_assert_rewrite(
    *("tests.fjh.live.browser", "tests.fjh.survey.surveys", "tests.hostile", "tests.models"),
    *("tests.motions", "tests.processes"),
)

# Background jobs of a shell ignore Ctrl-C, and so would processes that the tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)


NIGHT_STUDIES = {
    "table1",
    "release",
    "systems",
    "recover",
    "goals",
    "jacobian",
    "limits",
    "uncorrected",
}
"""Studies of 15 s and more of a core; short tests use smaller versions."""
PAGES = Path(__file__).with_name("project")
"""Folder of tests of the pages, which use the whole studies in short runs, too."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as long all tests that need the files of a study, by fixture or parameter."""
    for item in items:
        names = set[str](getattr(item, "fixturenames", ()))
        if "study" in names:  # the one that a module is named after, or a parameter
            names.add(f"{item.path.stem.removeprefix('test_')}_folder")
        if callspec := getattr(item, "callspec", None):
            names.add(f"{callspec.params.get('study')}_folder")
        if names & {"scheduler", "compared", *(f"{name}_folder" for name in LINES)}:
            item.add_marker(pytest.mark.long)
        if names & {f"{name}_folder" for name in NIGHT_STUDIES} and PAGES not in item.path.parents:
            item.add_marker(pytest.mark.long)
            item.add_marker(pytest.mark.night)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Print a failure when it occurs, since an interrupted run prints no summary."""
    if report.failed and "PYTEST_XDIST_WORKER" not in os.environ:
        print(f"\n{report.nodeid}\n{report.longreprtext}", file=sys.stderr, flush=True)


@pytest.fixture(scope="session")
def model() -> "mujoco.MjModel":
    """Load the hexapod; plants copy it, and tests that change it must copy it, too."""
    from sim import load_model

    return load_model()


@pytest.fixture
def switching() -> Iterator[None]:
    """Let threads take turns every 10 us."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


@pytest.fixture(scope="session")
def shared(tmp_path_factory) -> Path:
    """Return a folder that all processes of this run of pytest share."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


Make = Callable[[str, Callable[[Path], int]], Path]


@pytest.fixture(scope="session")
def created_once(shared) -> Make:
    """Return a function that creates a folder of a name by a command, once in all processes."""

    def made(name: str, make: Callable[[Path], int]) -> Path:
        folder, complete = shared / name, shared / f"{name}.complete"
        with FileLock(shared / f"{name}.lock"):
            if not complete.exists():
                assert make(folder) == 0
                complete.touch()
        return folder

    return made


def fjh(*arguments: str) -> Callable[[Path], int]:
    """Return a function that runs a command with these arguments into a folder."""

    def command(folder: Path) -> int:
        from experiments.app.cli import main

        return main([*arguments, "--out", str(folder)])

    return command


@pytest.fixture
def refused(capfd) -> Callable[..., str]:
    """Return a function that runs a rejected command, and returns its one-line message."""

    def sentence(*arguments: str, code: int = 2) -> str:
        from experiments.app.cli import main

        assert main([*arguments]) == code
        out, message = capfd.readouterr()
        assert message.startswith("fjh: ") and message.count("\n") == 1 and len(message) < 2100
        assert message[:-1].isprintable() and not out
        return message

    return sentence


def folder_of(study: str, *arguments: str) -> Any:
    """Return a fixture: the folder of a study, created by its command with these arguments."""

    @pytest.fixture(scope="session", name=f"{study}_folder")
    def folder(created_once: Make) -> Path:
        return created_once(study, fjh(study, *arguments))

    return folder


table1_folder = folder_of("table1")
release_folder = folder_of("release")
systems_folder = folder_of("systems")
recover_folder = folder_of("recover", "--quick")
jacobian_folder = folder_of("jacobian", "--loop", "--quick")
goals_folder = folder_of("goals", "--quick")


@pytest.fixture(scope="session")
def jacobian_study(jacobian_folder):
    """Return the contents of `jacobian.json`."""
    return json.loads((jacobian_folder / "jacobian.json").read_text())


@pytest.fixture(scope="session")
def table1(table1_folder):
    """Return the contents of `table1.json`, with its columns by name."""
    summary = json.loads((table1_folder / "table1.json").read_text())
    return summary | {"by_name": {column["name"]: column for column in summary["columns"]}}
