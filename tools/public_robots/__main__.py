"""`make robots`: every robot of some registry packages through a trial.

It writes docs/data/robots.csv, and the totals on docs/refused.md.

    python -m tools.public_robots                          those without a result yet
    python -m tools.public_robots --only panda --only ur5e   those whose name has one of these, anew
    python -m tools.public_robots --page                   the page alone, of the results there are

Packages, files and results are in build/robots; delete its `trials` to begin anew.
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
from tools.public_robots.page import outcome, page, said, table
from tools.public_robots.registry import Model, install, models
from tools.public_robots.trial import LIMIT_S

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "robots"
PAGE = ROOT / "docs" / "refused.md"
TABLE = ROOT / "docs" / "data" / "robots.csv"
PROCESSES = 2


def main() -> None:
    """Try robots, and write the page."""
    parser = argparse.ArgumentParser(description="Published robots, from their file to a flight.")
    parser.add_argument("--only", action="append", metavar="NAME", help="robots with this in it")
    parser.add_argument("--page", action="store_true", help="write page and CSV file alone")
    words = parser.parse_args()
    only = words.only
    install(BUILD / "packages")
    found = models(BUILD / "packages")
    if not words.page:
        chosen = [
            each
            for each in found
            if (any(part in each.label for part in only) if only else not _result(each).is_file())
        ]
        with ThreadPoolExecutor(PROCESSES) as pool:
            for done, (model, record) in enumerate(pool.map(_run_trial, chosen), 1):
                says = f"{outcome(record)} {said(record)}"[:200]
                print(f"{done} of {len(chosen)} {model.label}: {says}", flush=True)
    records = {each.label: _entry(each) for each in found if _result(each).is_file()}
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
    named = {"package": model.package, "name": model.name, "source": model.source}
    return named | json.loads(_result(model).read_text())


def _run_trial(model: Model) -> tuple[Model, dict[str, Any]]:
    """Run the trial of a robot in its own process, and return its record."""
    out = _result(model)
    out.parent.mkdir(parents=True, exist_ok=True)
    if model.xml is None:
        out.write_text(json.dumps({"stage": "load", "refused": model.refusal}))
        return model, _entry(model)
    file = BUILD / "models" / f"{model.label}.xml"
    unfinished = out.with_suffix(".part")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(model.xml)
    words = [sys.executable, "-W", "ignore", "-m", "tools.public_robots.trial", file, unfinished]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    code = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True).returncode
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
