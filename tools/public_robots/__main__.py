"""`make robots`: load and simulate every robot of some registry packages.

    python -m tools.public_robots                          robots without a result
    python -m tools.public_robots --only panda --only ur5e   robots with such a name, again

Packages, files and results are in build/robots; results of other code are replaced. Then arms are
simulated with failures at several steps (:mod:`tools.public_robots.failures`).
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

from fjh.study.provenance import code_sha256
from tools.public_robots.failures import simulate_failures
from tools.public_robots.registry import Model, install, models
from tools.public_robots.summary import message, outcome
from tools.public_robots.trial import LIMIT_S

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "robots"
PROCESSES = 2


def main() -> None:
    """Run the robots, and write all results to build/robots/robots.json."""
    parser = argparse.ArgumentParser(description="Load and simulate published robots.")
    parser.add_argument(
        "--only", action="append", metavar="NAME", help="robots with this in their name"
    )
    only = parser.parse_args().only
    install(BUILD / "packages")
    robots, code = models(BUILD / "packages"), code_sha256()
    if only:
        chosen = [model for model in robots if any(part in model.label for part in only)]
    else:
        chosen = [model for model in robots if _entry(model).get("code_sha256") != code]
    with ThreadPoolExecutor(PROCESSES) as pool:
        for done, (model, record) in enumerate(pool.map(_run_robot, chosen), 1):
            text = f"{outcome(record)} {message(record)}"[:200]
            print(f"{done} of {len(chosen)} {model.label}: {text}", flush=True)
    records = [_entry(model) for model in robots]
    (BUILD / "robots.json").write_text(json.dumps(records, indent=1))
    if not only:
        simulate_failures(robots, BUILD / "failures")


def _result(model: Model) -> Path:
    return BUILD / "trials" / f"{model.label}.json"


def _entry(model: Model) -> dict[str, Any]:
    """Return the record of a robot, with its stored result if there is one."""
    origin = {"package": model.package, "name": model.name, "source": model.source}
    file = _result(model)
    return origin | (json.loads(file.read_text()) if file.is_file() else {})


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
