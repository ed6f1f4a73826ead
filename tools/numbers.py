"""Copy the results of `make numbers` to docs/data: `python -m tools.numbers FOLDER`.

FOLDER has the report of all studies; build/robots and build/bench have the results of `make robots`
and `make bench`. Each result is copied, and origin.json says of which commit, date, computer and
seed it is.
"""

import json
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.table import measured_ratios, times_us
from fjh.study.result import plain, records_of
from tools.public_robots.summary import table, totals

ROOT = Path(__file__).parents[1]
ROBOTS, BENCH = ROOT / "build" / "robots", ROOT / "build" / "bench"


def main(studies: Path, data: Path = ROOT / "docs" / "data") -> None:
    """Replace the contents of `data`; raise SystemExit before that if a study is missing."""
    reports = {
        place: json.loads((place / "report.json").read_text())
        for place in (studies, ROBOTS / "failures")
    }
    trials, timed = (
        json.loads(file.read_text()) for file in (ROBOTS / "robots.json", BENCH / "run.json")
    )
    for place, report in reports.items():
        if report["missing"] or report["quick"]:
            raise SystemExit(f"{place} is not complete: {report['missing'] or 'it is quick'}")
    shutil.rmtree(data)
    data.mkdir()
    origins = {
        chapter["name"]: _copied(place / chapter["name"], data, chapter)
        | {key: report[key] for key in ("commit", "seed", "machine", "versions")}
        for place, report in reports.items()
        for chapter in report["chapters"]
    }
    last = max(trials, key=lambda trial: trial.get("finished", ""))
    origins["robots"] = {key: last[key] for key in ("commit", "finished")}
    origins["bench"] = {"commit": timed["commit_info"]["id"], "finished": timed["datetime"]}
    ratios = records_of(measured_ratios(times_us(timed)))
    contents = {"origin": origins, "robots": totals(trials), "bench": {"ratios": ratios}}
    for name, content in contents.items():
        (data / f"{name}.json").write_text(json.dumps(plain(content), indent=1))
    (data / "robots.csv").write_text(table(trials), encoding="utf-8")


def _copied(source: Path, data: Path, chapter: Mapping[str, Any]) -> dict[str, Any]:
    """Copy the result of a chapter; return its origin.

    A further chapter of a study has a folder of its own.
    """
    name = chapter["study"]
    summary = json.loads((source / f"{name}.json").read_text())
    folder = data if chapter["name"] == name else data / chapter["name"]
    folder.mkdir(exist_ok=True)
    # Only the rows of `recover` are published; those of sweep and atlas are of the linear model.
    if name == "recover":
        shutil.copy(source / f"{name}.parquet", folder)
    else:
        summary.pop("dataset", None)
    (folder / f"{name}.json").write_text(json.dumps(summary, indent=1))
    return {key: chapter[key] for key in ("study", "finished", "wall_time_s", "complaint")}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
