"""Workflows of GitHub: what they run, and that nobody can change it under us."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from experiments.studies import LINES

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
NIGHT = (ROOT / ".github" / "workflows" / "night.yml").read_text()
MAKEFILE = (ROOT / "Makefile").read_text()


@pytest.mark.parametrize("file", WORKFLOWS, ids=lambda file: file.stem)
def test_every_action_is_pinned_by_the_hash_of_a_commit(file):
    used = re.findall(r"uses: *(.*)", file.read_text())
    assert used
    for action in used:
        assert re.fullmatch(r"[\w-]+/[\w/-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", action), action


def test_one_action_has_one_hash_and_one_version():
    used = {line for file in WORKFLOWS for line in re.findall(r"uses: *(.*)", file.read_text())}
    repositories = [line.split("@")[0].split("/")[:2] for line in used]
    pins = {tuple(repository): set() for repository in repositories}
    for line, repository in zip(used, repositories, strict=True):
        pins[tuple(repository)].add(line.split("@")[1])
    assert all(len(each) == 1 for each in pins.values()), pins


def test_every_study_runs_at_full_length_each_night():
    (listed,) = re.findall(r"^        study:\n((?: +- .*\n)+)", NIGHT, re.MULTILINE)
    names = [line.split()[1] for line in listed.splitlines()]
    assert names == [name for name in LINES if name != "bench"]
    assert "--quick" not in NIGHT
    assert "run: make bench\n" in NIGHT


def test_every_target_that_is_run_exists():
    targets = set(re.findall(r"^([\w-]+(?: [\w-]+)*):(?!=)", MAKEFILE, re.MULTILINE))
    known = {name for names in targets for name in names.split()}
    for file in (*WORKFLOWS, ROOT / ".ci" / "run"):
        assert set(re.findall(r"\bmake ([a-z][\w-]*)", file.read_text())) <= known, file


def test_the_reproduction_of_the_paper_is_shown_with_every_run():
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    assert 'run: cat results/table1/table1.md >> "$GITHUB_STEP_SUMMARY"' in text


def test_the_table_is_compared_with_that_of_the_last_release_with_every_run():
    """By a shell that fails where the first command of a pipe does."""
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    compare = ".venv/bin/fjh results results/table1 --against docs/data/table1.json"
    summary = 'tee -a "$GITHUB_STEP_SUMMARY"'
    assert f"      - run: {compare} | {summary}\n        shell: bash\n" in text
    assert text.index("run: make table1") < text.index(compare)


def recipe(folder: Path, target: str) -> str:
    """What `make` would do for a target in a folder, not done."""
    words = ["make", "--dry-run", target]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True).stdout


def test_table1_installs_the_command_alone_and_shows_what_pip_does(tmp_path):
    """The first hour; who has all that the tests need has the command, too."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(ROOT / "kernels", tmp_path / "kernels")
    assert re.findall(r'--editable "(.*)"', recipe(tmp_path, "table1")) == [".[all]"]
    groups = re.findall(r'--editable "(.*)" (.*)', recipe(tmp_path, "test"))
    assert groups == [(".[all]", "--group test --group check --group docs")]
    assert "--quiet" not in recipe(tmp_path, "venv")
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    touched = [word for line in recipe(tmp_path, "venv").splitlines() for word in line.split()]
    for name in ("bin/python", "installed", "command"):
        assert f".venv/{name}" in touched
        (tmp_path / ".venv" / name).touch()
    for target in ("table1", "venv"):
        assert "pip" not in recipe(tmp_path, target)
