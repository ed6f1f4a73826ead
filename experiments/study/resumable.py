"""The missing runs of a campaign, done on whatever there is to run them."""

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from experiments.study.basis import BASIS, basis_in, check_same
from experiments.study.campaign import AnyRuns, Campaign, Row, simulate
from experiments.study.dataset import Broken, Dataset, check_merged
from experiments.study.interrupts import notice
from experiments.study.lock import LOCK, alone_in
from experiments.study.parallel import finished
from experiments.study.provenance import versions
from experiments.study.study import Interrupted, OnProgress, WrongInput
from experiments.study.where import Where

UNFINISHED = "unfinished"
"""Folder of the dataset, below the results', until all of it is published."""


@dataclass(frozen=True)
class Complete(Generic[AnyRuns]):
    """A complete campaign: its rows are on disk.

    `took` has the `runs` of this session, and `runs_per_s` from the first of them to finish to the
    last; None for fewer than two.
    """

    campaign: Campaign[AnyRuns]
    dataset: Dataset
    took: dict[str, Any]


def origin(name: str, done: Complete[Any]) -> dict[str, Any]:
    """The first part of a summary: where its numbers are from."""
    basis = done.dataset.basis
    return {
        "experiment": name,
        "seed": basis["seed"],
        "versions": versions(),
        "model_sha256": basis["model_sha256"],
        "basis": basis,
        "dataset": f"{name}.parquet",
        "runs": len(done.campaign.runs),
        "took": done.took,
    }


def rate(summary: dict[str, Any]) -> list[str]:
    """Number and rate of the runs of this session, if there were at least two."""
    took = summary["took"]
    if took["runs_per_s"] is None:
        return []
    return [f"{took['runs']} runs in this session, {took['runs_per_s']:.2f} per second."]


Outcome = Complete[AnyRuns] | dict[str, Any]
"""A complete campaign; or the contents of its JSON file, if it has been published before."""


@contextmanager
def complete(
    name: str,
    campaign: Campaign[AnyRuns],
    *,
    folder: Path,
    scheduler: str | None,
    workers: int | None,
    resume: bool | None,
    on_progress: OnProgress,
) -> Iterator[Outcome[AnyRuns]]:
    """The campaign with all its runs done, now or before; to be published within the context.

    Within it nobody else can run anything in the folder; after it, unless publishing failed, the
    dataset of unfinished runs is gone. Where `resume` is None, unfinished runs are continued if
    they are of this campaign and removed if not, and published ones are done again. Raises as
    `run_missing` and `published_before`, and `WrongInput` where another process runs one.
    """
    where = Where(scheduler, workers)
    with alone_in(folder / UNFINISHED):
        if resume and (summary := published_before(folder, name, campaign)):
            yield summary
        else:
            if resume is None:
                remove_other_rows(folder, campaign)
            kept = resume is not False
            done = run_missing(folder, campaign, where=where, resume=kept, on_progress=on_progress)
            yield done
            done.dataset.remove()


def run_missing(
    folder: Path,
    campaign: Campaign[AnyRuns],
    *,
    where: Where,
    resume: bool,
    on_progress: OnProgress,
) -> Complete[AnyRuns]:
    """Do the runs that are missing in `folder`/unfinished, a dataset that grows part by part.

    Finished runs are kept, whatever is raised.

    Raises:
        WrongInput: There are unfinished runs that shall not be resumed, or are others; or
            there is no scheduler at that address.
        Interrupted: By Ctrl-C.
        Unsound: A run failed in a way that no row foresees, or the scheduler has gone.
        OutputError: The disk or the folder refuses.
    """
    basis, unfinished = campaign.basis, folder / UNFINISHED
    if (former := basis_in(unfinished)) is not None:
        if not resume:
            raise WrongInput(
                f"--out {folder} holds an unfinished study: --resume continues it; to start "
                f"again, remove {unfinished}"
            )
        check_same(former, basis, folder)
    dataset = Dataset(unfinished, len(campaign.runs), basis, campaign.schema)
    if dataset.broken:
        others = len(dataset.broken) - 1
        more = f" and those of {others} more broken files" if others else ""
        notice(f"{dataset.broken[0]}; its runs{more} are done again")
    return Complete(campaign, dataset, _fill(dataset, campaign, where, on_progress))


def _fill(
    dataset: Dataset, campaign: Campaign[Any], where: Where, on_progress: OnProgress
) -> dict[str, Any]:
    missing, total = list(dataset.missing()), len(campaign.runs)
    done = total - len(missing)
    on_progress(done, total)
    times_s: list[float] = []
    if missing:
        with rows_of(campaign, missing, where) as rows:
            try:
                for row in rows:
                    dataset.add(row)
                    times_s = [*times_s[:1], time.perf_counter()]  # of the first and the last
                    done += 1
                    on_progress(done, total)
            except KeyboardInterrupt:
                raise Interrupted(
                    f"interrupted: {done} of {total} runs are kept; --resume continues"
                ) from None
            finally:
                dataset.keep()
    rate = (len(missing) - 1) / (times_s[1] - times_s[0]) if len(times_s) == 2 else None
    return {"runs": len(missing), "runs_per_s": rate}


@contextmanager
def rows_of(
    campaign: Campaign[Any], numbers: Sequence[int], where: Where
) -> Iterator[Iterator[Row]]:
    """The rows of the runs of these numbers, in the order in which they finish.

    Raises:
        WrongInput: As :func:`experiments.study.cluster.cluster`.
        Unsound: A run failed in a way that no row foresees, or the scheduler has gone.
    """
    if where.scheduler:
        from experiments.study.cluster import cluster, finished_rows  # late: Dask takes a second

        with cluster(where.scheduler, campaign.sources) as client:
            yield finished_rows(client, campaign, numbers)
    else:
        given = {"row_of": campaign.row_of}
        jobs = ((n, simulate, given | {"run": campaign.runs[n]}) for n in numbers)
        with closing(finished(jobs, min(where.processes, len(numbers)))) as found:
            yield (row for _, row in found)


def remove_other_rows(folder: Path, campaign: Campaign[Any]) -> None:
    """Remove the rows in `folder`/unfinished, which this process has locked, if of other runs."""
    unfinished = folder / UNFINISHED
    try:
        if (former := basis_in(unfinished)) is not None:
            check_same(former, campaign.basis, folder)
    except WrongInput:
        # What says whose the rows are goes last.
        for path in sorted(unfinished.iterdir(), key=lambda path: path.name == BASIS):
            if path.name != LOCK:
                path.unlink()


def published_before(folder: Path, name: str, campaign: Campaign[Any]) -> dict[str, Any] | None:
    """Contents of the JSON file in a folder that holds the rows of these runs, all of them.

    None if it holds nothing, or nothing whole; a `WrongInput` is raised if it holds others.
    """
    index = folder / f"{name}.json"
    if basis_in(folder / UNFINISHED) is not None or not index.exists():
        return None
    basis = campaign.basis
    try:
        summary = json.loads(index.read_bytes())
        former, dataset = dict(summary["basis"]), folder / summary["dataset"]
    except (OSError, ValueError, LookupError, TypeError):
        notice(f"{index} is broken; all runs are done again")
        return None
    check_same(former, basis, folder)
    try:
        check_merged(dataset, len(campaign.runs), basis, campaign.schema)
    except Broken as broken:
        notice(f"{broken}; all runs are done again")
        return None
    return summary
