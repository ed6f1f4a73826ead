"""The rows of many runs: kept as they finish, and continued where they stopped."""

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
    """Where runs are done, and whether they go on; `resume` None is "if they are the same runs"."""

    scheduler: Annotated[
        str | None,
        Option(
            metavar="ADDRESS",
            help="A Dask scheduler, e.g. tls://host:8786.  [default: this computer]",
        ),
    ] = None
    workers: Annotated[
        int | None,
        Option(
            metavar="N",
            help="Processes on this computer.  [default: one for each core]",
            bounds=(1, 10**9),
        ),
    ] = None
    resume: Annotated[
        bool | None,
        Option(help="Continue the unfinished runs in the folder."),
    ] = False

    def __post_init__(self) -> None:
        """Refuse what is no address, and both at once."""
        if self.scheduler is not None and not re.fullmatch(r"\S+", self.scheduler):
            raise WrongInput(f"--scheduler must be an address, got {self.scheduler!r}")
        if self.scheduler and self.workers:
            raise WrongInput("--workers are processes on this computer: omit it with --scheduler")


HERE = Where()
"""On this computer, from the beginning."""


def basis_of(**drawn_from: Any) -> dict[str, Any]:
    """All that rows depend on, ready for JSON: what runs are drawn from, code and versions."""
    numbers = {"pyarrow": version("pyarrow"), "pandas": version("pandas"), **versions()}
    own = {"code_sha256": code_sha256(), "model_sha256": model_sha256(), "processor": processor()}
    return plain({**drawn_from, **own, "versions": numbers})


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
    """The rows of all runs, those done before included, in the order of their column `case`.

    They are the same to the last bit for any number of workers and interruptions.

    Args:
        runs: Numbered from 0; each so small that it can be sent to any machine.
        row_of: Makes the row of a run: a function that workers can import. What rows lack, or
            have as None, is NaN.
        basis: Of :func:`basis_of`.
        where: Where runs are done, and whether they go on.
        name: Of the study.
        folder: Of its results, where rows are kept.
        on_progress: Called with the number of finished and of all runs.

    Raises:
        WrongInput: The folder has finished runs of something else, or which shall not be resumed.
        Interrupted: By Ctrl-C; finished runs are kept.
        Unsound: A run failed in a way that no row foresees, or a worker was killed; likewise.
        OutputError: The disk or the folder refuses.
    """
    file, kept = folder / UNFINISHED, _kept(name, folder, basis, where.resume)
    rows = {row["case"]: row for row in kept if row["case"] < len(runs)}
    missing = [number for number in range(len(runs)) if number not in rows]
    on_progress(len(rows), len(runs))
    try:
        # Nothing is written before a worker has answered.
        for row in _made(runs, missing, row_of, where):
            _append(file, [row] if file.exists() else [basis, *rows.values(), row])
            rows[row["case"]] = row
            on_progress(len(rows), len(runs))
    except KeyboardInterrupt:
        done = f"{len(rows)} of {len(runs)} runs are kept; --resume continues"
        raise Interrupted(f"interrupted: {done}") from None
    except Unsound as error:
        kept_too = "; finished runs are kept, and --resume continues" if file.exists() else ""
        raise Unsound(f"{error}{kept_too}") from None
    return frame_of([rows[number] for number in sorted(rows)])


def frame_of(rows: Sequence[Row]) -> pd.DataFrame:
    """Rows as a data frame; what is missing is NaN."""
    frame = pd.DataFrame(rows)
    return frame.where(frame.notna(), np.nan).infer_objects()


def _append(file: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as lines:
            lines.writelines(f"{json.dumps(row)}\n" for row in rows)
    except OSError as error:
        raise OutputError(f"{file} could not be written: {error.strerror}") from None


def _made(
    runs: Sequence[Any], numbers: Sequence[int], row_of: Callable[[Any], Row], where: Where
) -> Iterator[Row]:
    if not numbers:
        return
    count = min(where.workers or CORES, CORES, len(numbers))
    calls = ({"row_of": row_of, "run": runs[number]} for number in numbers)
    with cluster(where.scheduler) if where.scheduler else processes(count) as pool:
        for _, row in finished(pool, row_of_run, calls):
            yield plain(row)  # as it is read again: no row shall depend on whether it was kept


def row_of_run(row_of: Callable[[Any], Row], run: Any) -> Row:
    """The row of a run, on a worker; an `Unsound` says which run failed, why, and where."""
    try:
        return row_of(run)
    except Exception as error:
        [*_, last] = extract_tb(error.__traceback__)
        why = f"{type(error).__name__} in {Path(last.filename).name}, line {last.lineno}"
        said = " ".join(str(error).split())
        raise Unsound(f"run {run.number} failed: {why}: {said}") from None


def _kept(name: str, folder: Path, basis: Mapping[str, Any], resume: bool | None) -> list[Row]:
    """Rows of finished runs in the folder: unfinished ones, else those of its published results.

    If they are of something else, and this is no reason to refuse, the unfinished are removed.
    """
    file, index = folder / UNFINISHED, folder / f"{name}.json"
    again = f"to start again, remove {file}"
    try:
        if os.path.lexists(file):
            if resume is False:
                raise WrongInput(f"--out {folder} has unfinished runs: --resume, or {again}")
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
        said = f"it has another {', '.join(changed)}"
        raise WrongInput(f"--resume cannot continue the runs in {folder}: {said}")
    file.unlink(missing_ok=True)
    return []


def _lines(file: Path) -> list[Row]:
    """What the lines of a file hold; a last one that was not written to its end is removed."""
    *whole, torn = check_file(file).read_bytes().split(b"\n")
    if torn:
        os.truncate(file, file.stat().st_size - len(torn))
    return [json.loads(line) for line in whole]
