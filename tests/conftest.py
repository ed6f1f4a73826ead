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

# Whoever runs one test waits for what it imports: the command line and MuJoCo are imported where a
# fixture needs them.
if TYPE_CHECKING:
    import mujoco

profiles.register()

# Their assertions say what they compare, as those of tests do.
pytest.register_assert_rewrite(
    *("tests.fjh.live.browser", "tests.fjh.survey.surveys", "tests.hostile", "tests.models"),
    *("tests.motions", "tests.processes"),
)

# A job that a shell puts in the background ignores Ctrl-C, and so would what the tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)


AT_NIGHT = {"table1", "release", "systems", "recover", "goals", "jacobian", "limits", "uncorrected"}
"""Studies that take 15 s of a core and more: by day the contract of studies holds smaller ones."""
PAGES = Path(__file__).with_name("project")
"""Its tests show what a reader of the pages has, by day as well."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as long whatever needs the files of a study, however it comes by them."""
    for item in items:
        names = set[str](getattr(item, "fixturenames", ()))
        if "study" in names:  # the one that a module is named after, or a parameter
            names.add(f"{item.path.stem.removeprefix('test_')}_folder")
        if callspec := getattr(item, "callspec", None):
            names.add(f"{callspec.params.get('study')}_folder")
        if names & {"scheduler", "compared", *(f"{name}_folder" for name in LINES)}:
            item.add_marker(pytest.mark.long)
        if names & {f"{name}_folder" for name in AT_NIGHT} and PAGES not in item.path.parents:
            item.add_marker(pytest.mark.long)
            item.add_marker(pytest.mark.night)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Show a failure when it happens: whoever stops the run would not see it at its end."""
    if report.failed and "PYTEST_XDIST_WORKER" not in os.environ:
        print(f"\n{report.nodeid}\n{report.longreprtext}", file=sys.stderr, flush=True)


@pytest.fixture(scope="session")
def model() -> "mujoco.MjModel":
    """The hexapod; plants copy it, tests that alter it must copy it too."""
    from sim import load_model

    return load_model()


@pytest.fixture
def switching() -> Iterator[None]:
    """Threads take turns after 10 us."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


@pytest.fixture(scope="session")
def shared(tmp_path_factory) -> Path:
    """A folder that all processes of this run of pytest have in common."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


Make = Callable[[str, Callable[[Path], int]], Path]


@pytest.fixture(scope="session")
def made_once(shared) -> Make:
    """Makes a folder in the first process that needs it; one name is one folder and one command."""

    def made(name: str, make: Callable[[Path], int]) -> Path:
        folder, complete = shared / name, shared / f"{name}.complete"
        with FileLock(shared / f"{name}.lock"):
            if not complete.exists():
                assert make(folder) == 0
                complete.touch()
        return folder

    return made


def fjh(*words: str) -> Callable[[Path], int]:
    """The command with these words, its folder left open."""

    def command(folder: Path) -> int:
        from experiments.app.cli import main

        return main([*words, "--out", str(folder)])

    return command


@pytest.fixture
def refused(capfd) -> Callable[..., str]:
    """The sentence with which words are refused: alone on standard error, without a traceback."""

    def sentence(*words: str, code: int = 2) -> str:
        from experiments.app.cli import main

        assert main([*words]) == code
        out, said = capfd.readouterr()
        assert said.startswith("fjh: ") and said.count("\n") == 1 and len(said) < 2100
        assert said[:-1].isprintable() and not out
        return said

    return sentence


def folder_of(study: str, *words: str) -> Any:
    """A fixture: the folder of a study, made by its command with these words."""

    @pytest.fixture(scope="session", name=f"{study}_folder")
    def folder(made_once: Make) -> Path:
        return made_once(study, fjh(study, *words))

    return folder


table1_folder = folder_of("table1")
release_folder = folder_of("release")
systems_folder = folder_of("systems")
recover_folder = folder_of("recover", "--quick")
jacobian_folder = folder_of("jacobian", "--loop", "--quick")
goals_folder = folder_of("goals", "--quick")


@pytest.fixture(scope="session")
def jacobian_study(jacobian_folder):
    """`jacobian.json`."""
    return json.loads((jacobian_folder / "jacobian.json").read_text())


@pytest.fixture(scope="session")
def table1(table1_folder):
    """`table1.json`, its columns by name."""
    summary = json.loads((table1_folder / "table1.json").read_text())
    return summary | {"by_name": {column["name"]: column for column in summary["columns"]}}
