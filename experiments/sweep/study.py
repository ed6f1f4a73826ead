"""Run what is missing of a sweep, on whatever there is to run it."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.output.study import Interrupted, OnProgress, WrongInput
from experiments.output.terminal import notice
from experiments.sweep.basis import Basis, basis_in, basis_of, check_same
from experiments.sweep.cluster import Where, cluster
from experiments.sweep.dataset import Dataset
from experiments.sweep.design import Cases
from experiments.sweep.lock import alone_in
from experiments.sweep.merged import check_merged
from experiments.sweep.parquet import Broken
from experiments.sweep.stream import finished_rows

UNFINISHED = "unfinished"
"""Folder of the dataset, below the results', until all of it is there."""


@dataclass(frozen=True)
class Ran:
    """A complete dataset.

    Attributes:
        dataset: On disk.
        basis: What its numbers depend on.
        took: `runs` of this session, and `runs_per_s` from the first of them to finish to the last;
            None for fewer than two.
    """

    dataset: Dataset
    basis: Basis
    took: dict[str, Any]


def complete(
    folder: Path,
    index: str,
    cases: Cases,
    *,
    where: Where,
    resume: bool,
    on_progress: OnProgress,
    write: Callable[[Ran], dict[str, Any]],
) -> dict[str, Any]:
    """The index of a folder in which all cases have been run, now or before.

    Args:
        folder: Of the results; for as long as this takes nobody else can run cases there.
        index: Name of the file that names the others.
        cases: To run.
        where: On what.
        resume: Go on with what is there.
        on_progress: Called with finished and total number of runs.
        write: Leaves everything in the folder, and returns the index.

    Raises:
        WrongInput: Somebody else runs cases there; or as `run_cases` and `finished_before`.
        Interrupted, Unsound, OutputError: As `run_cases`.
    """
    with alone_in(folder / UNFINISHED):
        if resume and (summary := finished_before(folder, index, cases)):
            return summary
        return write(run_cases(folder, cases, where=where, resume=resume, on_progress=on_progress))


def run_cases(
    folder: Path, cases: Cases, *, where: Where, resume: bool, on_progress: OnProgress
) -> Ran:
    """Run the cases that are missing in `folder`/unfinished, a dataset that grows part by part.

    Args:
        folder: Of the results.
        cases: To run.
        where: On what.
        resume: Go on with what is there.
        on_progress: Called with finished and total number of runs.

    Raises:
        WrongInput: There is an unfinished sweep and nobody said to go on with it, or it is another
            one; or there is no scheduler at that address.
        Interrupted: By Ctrl-C; finished runs are kept.
        Unsound: A case failed in a way that no row foresees, or the scheduler has gone; finished
            runs are kept.
        OutputError: The disk or the folder refuses.
    """
    basis, unfinished = basis_of(cases), folder / UNFINISHED
    if (former := basis_in(unfinished)) is not None:
        if not resume:
            raise WrongInput(
                f"--out {folder} holds an unfinished sweep: --resume goes on with it; to begin "
                f"anew, remove {unfinished}"
            )
        check_same(former, basis, folder)
    dataset = Dataset(unfinished, len(cases), basis)
    if dataset.broken:
        others = len(dataset.broken) - 1
        more = f" and those of {others} more broken files" if others else ""
        notice(f"{dataset.broken[0]}; its runs{more} are done again")
    took = _run_missing(dataset, cases, where, on_progress)
    return Ran(dataset, basis, took)


def finished_before(folder: Path, index: str, cases: Cases) -> dict[str, Any] | None:
    """The index of a folder that holds these cases already, all of them.

    Returns:
        None if it holds nothing, or nothing whole.

    Raises:
        WrongInput: It holds others.
    """
    if basis_in(folder / UNFINISHED) is not None or not (folder / index).exists():
        return None
    basis = basis_of(cases)
    try:
        summary = json.loads((folder / index).read_bytes())
        former, dataset = dict(summary["basis"]), folder / summary["dataset"]
    except (OSError, ValueError, LookupError, TypeError):
        notice(f"{folder / index} is broken; all runs are done again")
        return None
    check_same(former, basis, folder)
    try:
        check_merged(dataset, len(cases), basis)
    except Broken as broken:
        notice(f"{broken}; all runs are done again")
        return None
    return summary


def _run_missing(
    dataset: Dataset, cases: Cases, where: Where, on_progress: OnProgress
) -> dict[str, Any]:
    missing = list(dataset.missing())
    done = len(cases) - len(missing)
    on_progress(done, len(cases))
    times_s: list[float] = []
    if missing:
        with cluster(where, most=len(missing)) as client:
            try:
                for row in finished_rows(client, (cases[number] for number in missing)):
                    dataset.add(row)
                    times_s = [*times_s[:1], time.perf_counter()]  # of the first and the last
                    done += 1
                    on_progress(done, len(cases))
            except KeyboardInterrupt:
                raise Interrupted(
                    f"interrupted: {done} of {len(cases)} runs are kept; --resume goes on"
                ) from None
            finally:
                dataset.keep()
    rate = (len(missing) - 1) / (times_s[1] - times_s[0]) if len(times_s) == 2 else None
    return {"runs": len(missing), "runs_per_s": rate}
