"""A sweep goes on after an edit that no row depends on, and after no other."""

import ast
import shutil
from pathlib import Path

import pytest

from experiments.recover.command import SOURCES as CASES
from experiments.study import basis as bases
from experiments.study import provenance
from experiments.study.basis import check_same
from experiments.study.study import WrongInput
from experiments.sweep.campaign import SOURCES, sweep_of
from experiments.sweep.design import Design, SweepRuns
from experiments.sweep.sweep_run import Choice

ROOT = Path(__file__).parents[2]
RUNS = SweepRuns(Design("grid", 1, 0.1, (Choice("seed", (1,)),)), 0)
ROOMS = ("argument_checks", "experiments", "ftc", "models", "prioritized", "sim")


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A copy of the sources, of which the basis is taken."""
    for room in ROOMS:
        shutil.copytree(ROOT / room, tmp_path / room, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    bases.identity.cache_clear()
    yield tmp_path
    bases.identity.cache_clear()


def edit(project: Path, pattern: str) -> None:
    """Edit the first file of the pattern."""
    bases.identity.cache_clear()
    with min(project.glob(pattern)).open("a") as file:
        file.write("\n# edited\n")


WORDS_AND_DRAWINGS = (
    "experiments/app/cli.py",
    "experiments/recording/*.py",
    "experiments/study/cluster.py",
    "experiments/study/parallel.py",
    "experiments/study/plotting.py",
    "experiments/study/resumable.py",
    "experiments/study/results.py",
    "experiments/release.py",
    *(
        f"experiments/sweep/{name}.py"
        for name in ("__init__", "atlas", "campaign", "figure", "results", "runs", "words")
    ),
)


@pytest.mark.parametrize("pattern", WORDS_AND_DRAWINGS)
def test_an_edited_caption_or_help_text_changes_nothing_for_a_sweep(project, pattern):
    before, shown = sweep_of(RUNS).basis, provenance.code_sha256()
    edit(project, pattern)
    check_same(before, sweep_of(RUNS).basis, project)
    # A page shows captions, too; only its own code does not count.
    assert (provenance.code_sha256() == shown) == ("experiments/app/" in pattern)


@pytest.mark.parametrize(
    "pattern",
    [
        "argument_checks/*.py",
        "ftc/*.py",
        "ftc/control/*.py",
        "ftc/fdi/*.py",
        "models/*.xml",
        "prioritized/*.py",
        "prioritized/_solver/*.py",
        "sim/*.py",
        "sim/mjcf/*.py",
        "experiments/rig/*.py",
        "experiments/rig/hexapod/machine.py",
        *(f"experiments/study/{name}.py" for name in ("basis", "campaign", "dataset", "parquet")),
        *(f"experiments/sweep/{name}.py" for name in ("design", "row", "sweep_run")),
    ],
)
def test_an_edit_of_what_makes_rows_makes_another_sweep(project, pattern):
    before = sweep_of(RUNS).basis
    edit(project, pattern)
    with pytest.raises(WrongInput, match=r"it has another code_sha256$"):
        check_same(before, sweep_of(RUNS).basis, project)


@pytest.mark.parametrize(
    ("row", "sources"),
    [
        ("sweep/row.py", SOURCES),
        ("recover/row.py", CASES),
    ],
)
def test_all_that_a_row_is_made_with_counts(row, sources):
    """Every module that the worker's function imports, and those that they import."""
    counted = {path for pattern in sources.files for path in ROOT.glob(pattern)}
    counted -= {path for pattern in sources.without for path in ROOT.glob(pattern)}
    start = ROOT / "experiments" / row
    reached, waiting = set(), [start]
    while waiting:
        path = waiting.pop()
        if path not in reached:
            reached.add(path)
            # The study's help text is made of others' options, which make no numbers.
            waiting += [] if path == start.with_name("__init__.py") else imported(path)
    assert ROOT / "sim" / "plant" / "plant.py" in reached
    left = {str(path.relative_to(ROOT)) for path in reached - counted}
    # What has no robot in it makes no numbers; packages' own files hold their help texts.
    assert {
        name
        for name in left
        if not name.startswith("experiments/study/") and not name.endswith("__init__.py")
    } == set()


def imported(path: Path) -> list[Path]:
    """Files of the project that a file imports."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    stems = [ROOT.joinpath(*name.split(".")) for name in names if name.split(".")[0] in ROOMS]
    files = [path for stem in stems for path in (stem.with_suffix(".py"), stem / "__init__.py")]
    return [path for path in files if path.exists()]
