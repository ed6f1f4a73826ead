"""`ftc` alone against a state space, as docs/control-without-simulator.md has it."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import assert_prints, assert_says

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "control-without-simulator.md").read_text()
(SCRIPT,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
(PRINTED,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)

FURTHER = """
import json, sys
unaware = ftc.run_loop(Machine(), controller(goal), desired).measured
off = np.linalg.norm(desired - unaware, axis=1)[1500:]
found = {"before": before, "after": after, "unaware": np.sqrt(np.mean(off**2))}
found["modules"] = sorted({name.partition(".")[0] for name in sys.modules})
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> list[str]:
    """Lines that the script prints in a Python of its own, and a line of what it leaves."""
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT + FURTHER],
        cwd=tmp_path_factory.mktemp("elsewhere"),
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.splitlines(keepends=True)


def test_the_script_prints_what_stands_below_it(done):
    assert_prints("".join(done[:-1]), PRINTED)


def test_the_error_recovers_from_a_lock_and_does_not_without_diagnosis(done):
    """J_m M = I with the three drives left, as with four."""
    found = json.loads(done[-1])
    assert found["after"] < found["before"]
    assert found["unaware"] > 1.3 * found["after"]
    assert_says(PAGE, f"is {found['unaware']:.2f} um")


def test_no_simulator_is_imported(done):
    modules = set(json.loads(done[-1])["modules"])
    assert {"ftc", "prioritized"} <= modules
    assert not modules & {"mujoco", "sim", "experiments", "rerun"}


def test_the_page_is_short():
    assert len(PAGE.splitlines()) <= 60
    assert len([line for line in SCRIPT.splitlines() if line.strip()]) <= 35
