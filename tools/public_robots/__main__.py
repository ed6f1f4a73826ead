"""`make robots`: load and simulate every robot of some registry packages.

It writes docs/data/robots.csv, and the totals on docs/refused.md.

    python -m tools.public_robots                          robots without a result
    python -m tools.public_robots --only panda --only ur5e   robots with such a name, again
    python -m tools.public_robots --page                   the page alone, from existing results

Packages, files and results are in build/robots; delete its `trials` to start again.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from fjh.study.provenance import processor, versions
from tools.public_robots.page import message, outcome, page, table
from tools.public_robots.registry import Model, install, models
from tools.public_robots.trial import LIMIT_S

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "robots"
PAGE = ROOT / "docs" / "refused.md"
TABLE = ROOT / "docs" / "data" / "robots.csv"
PROCESSES = 2


def main() -> None:
    """Run robots, and write the page."""
    parser = argparse.ArgumentParser(description="Load and simulate published robots.")
    parser.add_argument(
        "--only", action="append", metavar="NAME", help="robots with this in their name"
    )
    parser.add_argument("--page", action="store_true", help="write page and CSV file alone")
    arguments = parser.parse_args()
    only = arguments.only
    install(BUILD / "packages")
    robots = models(BUILD / "packages")
    if not arguments.page:
        chosen = [
            each
            for each in robots
            if (any(part in each.label for part in only) if only else not _result(each).is_file())
        ]
        with ThreadPoolExecutor(PROCESSES) as pool:
            for done, (model, record) in enumerate(pool.map(_run_robot, chosen), 1):
                text = f"{outcome(record)} {message(record)}"[:200]
                print(f"{done} of {len(chosen)} {model.label}: {text}", flush=True)
    records = {each.label: _entry(each) for each in robots if _result(each).is_file()}
    (BUILD / "robots.json").write_text(json.dumps(records, indent=1))
    dates = sorted({each["date"] for each in records.values() if "date" in each})
    commits = sorted({each["commit"][:7] for each in records.values() if "commit" in each})
    with_them = ", ".join(f"{name} {number}" for name, number in versions().items())
    conditions = (
        f"{' to '.join(dict.fromkeys([dates[0], dates[-1]]))}, commit {', '.join(commits)}, "
        f"{with_them}. Exact plants, seed 0, one run each; at most {LIMIT_S} s of "
        f"processor time for each robot, {PROCESSES} processes at once, one BLAS thread each, "
        f"{processor()}."
    )
    text = page(PAGE.read_text(encoding="utf-8"), list(records.values()), conditions)
    PAGE.write_text(text, encoding="utf-8")
    TABLE.write_text(table(list(records.values())), encoding="utf-8")


def _result(model: Model) -> Path:
    return BUILD / "trials" / f"{model.label}.json"


def _entry(model: Model) -> dict[str, Any]:
    origin = {"package": model.package, "name": model.name, "source": model.source}
    return origin | json.loads(_result(model).read_text())


def _run_robot(model: Model) -> tuple[Model, dict[str, Any]]:
    """Run the test of a robot in its own process, and return its record."""
    out = _result(model)
    out.parent.mkdir(parents=True, exist_ok=True)
    if model.xml is None:
        out.write_text(json.dumps({"stage": "load", "refused": model.refusal}))
        return model, _entry(model)
    file = BUILD / "models" / f"{model.label}.xml"
    unfinished = out.with_suffix(".part")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(model.xml)
    command = [sys.executable, "-W", "ignore", "-m", "tools.public_robots.trial", file, unfinished]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    code = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True).returncode
    record: dict[str, Any] = {"stage": "load"}
    if unfinished.is_file():
        record = json.loads(unfinished.read_text())
    if code == -signal.SIGXCPU:
        record["timeout_s"] = LIMIT_S
    elif code:
        record["traceback"] = f"the process ended with code {code}"
    out.write_text(json.dumps(record, indent=1))
    unfinished.unlink(missing_ok=True)
    return model, _entry(model)


if __name__ == "__main__":
    main()
