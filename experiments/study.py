"""Simulation of many runs, whose rows are saved so that it can resume after an interruption."""

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from traceback import extract_tb
from typing import Annotated, Any

import numpy as np
import pandas as pd

from fjh.study.errors import Interrupted, OutputError, Unsound, WrongInput
from fjh.study.files import UNFINISHED
from fjh.study.input_checks import check_file
from fjh.study.option import OnProgress, Option
from fjh.study.provenance import code_sha256, processor, versions
from fjh.study.result import plain
from fjh.study.untrusted_files import read_json
from fjh.study.workers import CORES, cluster, finished, processes
from sim.mjcf import model_sha256

Row = dict[str, Any]


@dataclass(frozen=True)
class Where:
    """Options for where runs are simulated, and whether unfinished ones are resumed.

    If `resume` is None, a study is resumed if its runs are the same.
    """

    scheduler: Annotated[
        str | None,
        Option("A Dask scheduler, e.g. tls://host:8786.  [default: this computer]", "ADDRESS"),
    ] = None
    workers: Annotated[
        int | None,
        Option("Processes on this computer.  [default: one for each core]", "N", bounds=(1, 10**9)),
    ] = None
    resume: Annotated[bool | None, Option("Continue the unfinished runs in the folder.")] = False

    def __post_init__(self) -> None:
        if self.scheduler is not None and not re.fullmatch(r"\S+", self.scheduler):
            raise WrongInput(
                f"--scheduler must be an address without blanks, got {self.scheduler!r}"
            )
        if self.scheduler and self.workers:
            raise WrongInput("--workers are processes on this computer: omit it with --scheduler")


HERE = Where()
"""Default options: on this computer, from the beginning."""


def basis_of(**sampling: Any) -> dict[str, Any]:
    """Return the basis of rows, ready for JSON: sampling parameters, hash of the code, versions."""
    numbers = {"pyarrow": version("pyarrow"), "pandas": version("pandas"), **versions()}
    hashes = {"code_sha256": code_sha256(), "model_sha256": model_sha256()}
    return plain({**sampling, **hashes, "processor": processor(), "versions": numbers})


def rows_of(
    runs: Sequence[Any],
    row_of: Callable[[Any], Row],
    basis: Mapping[str, Any],
    where: Where,
    *,
    name: str,
    folder: Path,
    on_progress: OnProgress,
) -> pd.DataFrame:
    """Simulate all runs without a saved row; return all rows, ordered by the column `case`.

    The rows are the same to the last bit for any number of workers and interruptions.

    Args:
        runs: Parameters of the runs, numbered from 0, which are sent to the workers.
        row_of: Function from a run to its row, importable by workers. Missing entries and None
            become NaN.
        basis: Result of :func:`basis_of`.
        where: Options for where runs are simulated, and whether unfinished ones are resumed.
        name: Name of the study.
        folder: Folder of its results, where rows are saved.
        on_progress: Function called with the number of finished and of all runs.

    Raises:
        WrongInput: The folder has unfinished runs of another study, or that `where` does not
            resume.
        Interrupted: Ctrl-C was pressed; finished runs are saved.
        Unsound: A run failed unexpectedly, or a worker was killed; finished runs are saved.
        OutputError: The folder cannot be written.
    """
    file, saved = folder / UNFINISHED, _saved(name, folder, basis, where.resume)
    rows = {row["case"]: row for row in saved if row["case"] < len(runs)}
    missing = [number for number in range(len(runs)) if number not in rows]
    on_progress(len(rows), len(runs))
    try:
        # Nothing is written before the first worker has returned a row.
        for row in _simulated(runs, missing, row_of, where):
            _append(file, [row] if file.exists() else [basis, *rows.values(), row])
            rows[row["case"]] = row
            on_progress(len(rows), len(runs))
    except KeyboardInterrupt:
        done = f"{len(rows)} of {len(runs)} runs are saved; --resume continues"
        raise Interrupted(f"interrupted: {done}") from None
    except Unsound as error:
        advice = "; finished runs are saved, and --resume continues" if file.exists() else ""
        raise Unsound(f"{error}{advice}") from None
    frame = pd.DataFrame([rows[number] for number in sorted(rows)])
    return frame.where(frame.notna(), np.nan).infer_objects()


def _append(file: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as lines:
            lines.writelines(f"{json.dumps(row)}\n" for row in rows)
    except OSError as error:
        raise OutputError(f"{file} could not be written: {error.strerror}") from None


def _simulated(
    runs: Sequence[Any], numbers: Sequence[int], row_of: Callable[[Any], Row], where: Where
) -> Iterator[Row]:
    if not numbers:
        return
    count = min(where.workers or CORES, CORES, len(numbers))
    calls = ({"row_of": row_of, "run": runs[number]} for number in numbers)
    with cluster(where.scheduler) if where.scheduler else processes(count) as pool:
        for _, row in finished(pool, row_of_run, calls):
            yield plain(row)  # the same whether it is new or read from the file


def row_of_run(row_of: Callable[[Any], Row], run: Any) -> Row:
    """Return the row of a run; called by workers.

    Raises:
        Unsound: The run failed; the message has its number, the error and the line of code.
    """
    try:
        return row_of(run)
    except Exception as error:
        [*_, last] = extract_tb(error.__traceback__)
        why = f"{type(error).__name__} in {Path(last.filename).name}, line {last.lineno}"
        text = " ".join(str(error).split())
        raise Unsound(f"run {run.number} failed: {why}: {text}") from None


def _saved(name: str, folder: Path, basis: Mapping[str, Any], resume: bool | None) -> list[Row]:
    """Return the saved rows of an unfinished study, or else those of published results.

    Rows of other runs are removed if `resume` is None; otherwise they are an error.
    """
    file, index = folder / UNFINISHED, folder / f"{name}.json"
    again = f"to start again, remove {file}"
    try:
        if os.path.lexists(file):
            if resume is False:
                raise WrongInput(f"--out {folder} has unfinished runs: add --resume, or {again}")
            former, *rows = _lines(file) or [{}]
        elif resume and os.path.lexists(index):
            former = read_json(index)["basis"]
            rows = pd.read_parquet(check_file(folder / f"{name}.parquet")).to_dict("records")
        else:
            return []
        changed = [name for name in basis if former.get(name) != basis[name]]
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        raise WrongInput(f"the runs in {folder} cannot be read: {again}") from None
    if not changed:
        return [plain(row) for row in rows]
    if resume:
        text = f"they have another {', '.join(changed)}"
        raise WrongInput(f"--resume cannot continue the runs in {folder}: {text}")
    file.unlink(missing_ok=True)
    return []


def _lines(file: Path) -> list[Row]:
    """Return the rows in the lines of a file, and remove an incomplete last line."""
    *complete, incomplete = check_file(file).read_bytes().split(b"\n")
    if incomplete:
        os.truncate(file, file.stat().st_size - len(incomplete))
    return [json.loads(line) for line in complete]
