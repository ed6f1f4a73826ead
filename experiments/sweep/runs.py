"""The runs of a sweep, those that are missing in its folder, on whatever there is to run them."""

import itertools
import json
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.output.lock import LOCK, alone_in
from experiments.output.study import Interrupted, OnProgress, WrongInput
from experiments.output.terminal import notice
from experiments.sweep.basis import BASIS, basis_in, basis_of, check_same
from experiments.sweep.cluster import Where, cluster, finished_rows
from experiments.sweep.dataset import Broken, Dataset, check_merged
from experiments.sweep.design import SweepRuns, grid, read_design
from experiments.sweep.sweep_run import Choice

UNFINISHED = "unfinished"
"""Folder of the dataset, below the results', until all of it is published."""

_TURN, _MIRROR = (2, 3, 4, 5, 0, 1), (1, 0, 5, 4, 3, 2)
"""Symmetries of the machine: the strut in whose place each strut comes."""


@dataclass(frozen=True)
class Sweep:
    """A complete sweep: its rows are on disk.

    `took` has the `runs` of this session, and `runs_per_s` from the first of them to finish to the
    last; None for fewer than two.
    """

    runs: SweepRuns
    dataset: Dataset
    took: dict[str, Any]


Outcome = Sweep | dict[str, Any]
"""A sweep; or the contents of its JSON file, if it has been published before."""


def run_sweep(
    *, seed: int, quick: bool, design: Path | None, **options: Any
) -> AbstractContextManager[Outcome]:
    """The runs of a design file, or of the default design; further options as of `complete`."""
    chosen = read_design(design)
    if quick:
        chosen = replace(chosen, runs=min(chosen.runs, 40), duration_s=0.5)
    return complete("sweep", SweepRuns(chosen, seed), **options)


def run_atlas(*, seed: int, quick: bool, **options: Any) -> AbstractContextManager[Outcome]:
    """All failure conditions, weights and Jacobians; further options as of `complete`."""
    factors = [
        Choice("struts", representatives() if quick else conditions()),
        Choice("weight", ("W_a",) if quick else ("W_a", "W_b", "W_c", "W_d", "W_e")),
        Choice("jacobian", ("constant", "analytic")),
    ]
    return complete("atlas", SweepRuns(grid(0.5 if quick else 2.0, factors), seed), **options)


def conditions() -> tuple[str, ...]:
    """All 3^6 failure conditions, a letter for each strut, in the order of the failure atlas."""
    return tuple(map("".join, itertools.product("SLF", repeat=6)))


def representatives() -> tuple[str, ...]:
    """The first of each set of conditions that turning by 120 degrees and mirroring make equal."""
    every, found = conditions(), {}
    for condition in every:
        for seen in (condition, _moved(condition, _MIRROR)):
            for _ in range(3):
                seen = _moved(seen, _TURN)
                found.setdefault(seen, condition)
    return tuple(condition for condition in every if found[condition] == condition)


def _moved(condition: str, struts: tuple[int, ...]) -> str:
    return "".join(condition[k] for k in struts)


@contextmanager
def complete(
    name: str,
    runs: SweepRuns,
    *,
    folder: Path,
    scheduler: str | None,
    workers: int | None,
    resume: bool | None,
    on_progress: OnProgress,
) -> Iterator[Outcome]:
    """The sweep with all its runs done, now or before; to be published within the context.

    Within it nobody else can run anything in the folder; after it, unless publishing failed, the
    dataset of unfinished runs is gone. Where `resume` is None, unfinished runs are continued if
    they are of this sweep and removed if not, and a published sweep is done again. Raises as
    `run_missing` and `published_before`, and `WrongInput` where another process runs a sweep.
    """
    where = Where(scheduler, workers)
    with alone_in(folder / UNFINISHED):
        if resume and (summary := published_before(folder, name, runs)):
            yield summary
        else:
            if resume is None:
                remove_other_rows(folder, runs)
            kept = resume is not False
            sweep = run_missing(folder, runs, where=where, resume=kept, on_progress=on_progress)
            yield sweep
            sweep.dataset.remove()


def run_missing(
    folder: Path, runs: SweepRuns, *, where: Where, resume: bool, on_progress: OnProgress
) -> Sweep:
    """Do the runs that are missing in `folder`/unfinished, a dataset that grows part by part.

    Finished runs are kept, whatever is raised.

    Raises:
        WrongInput: There is an unfinished sweep that shall not be resumed, or is another one; or
            there is no scheduler at that address.
        Interrupted: By Ctrl-C.
        Unsound: A run failed in a way that no row foresees, or the scheduler has gone.
        OutputError: The disk or the folder refuses.
    """
    basis, unfinished = basis_of(runs), folder / UNFINISHED
    if (former := basis_in(unfinished)) is not None:
        if not resume:
            raise WrongInput(
                f"--out {folder} holds an unfinished sweep: --resume continues it; to start "
                f"again, remove {unfinished}"
            )
        check_same(former, basis, folder)
    dataset = Dataset(unfinished, len(runs), basis)
    if dataset.broken:
        others = len(dataset.broken) - 1
        more = f" and those of {others} more broken files" if others else ""
        notice(f"{dataset.broken[0]}; its runs{more} are done again")
    return Sweep(runs, dataset, _fill(dataset, runs, where, on_progress))


def _fill(
    dataset: Dataset, runs: SweepRuns, where: Where, on_progress: OnProgress
) -> dict[str, Any]:
    missing = list(dataset.missing())
    done = len(runs) - len(missing)
    on_progress(done, len(runs))
    times_s: list[float] = []
    if missing:
        with cluster(where, most=len(missing)) as client:
            try:
                for row in finished_rows(client, (runs[number] for number in missing)):
                    dataset.add(row)
                    times_s = [*times_s[:1], time.perf_counter()]  # of the first and the last
                    done += 1
                    on_progress(done, len(runs))
            except KeyboardInterrupt:
                raise Interrupted(
                    f"interrupted: {done} of {len(runs)} runs are kept; --resume continues"
                ) from None
            finally:
                dataset.keep()
    rate = (len(missing) - 1) / (times_s[1] - times_s[0]) if len(times_s) == 2 else None
    return {"runs": len(missing), "runs_per_s": rate}


def remove_other_rows(folder: Path, runs: SweepRuns) -> None:
    """Remove the rows in `folder`/unfinished, which this process has locked, if of other runs."""
    unfinished = folder / UNFINISHED
    try:
        if (former := basis_in(unfinished)) is not None:
            check_same(former, basis_of(runs), folder)
    except WrongInput:
        # What says whose the rows are goes last.
        for path in sorted(unfinished.iterdir(), key=lambda path: path.name == BASIS):
            if path.name != LOCK:
                path.unlink()


def published_before(folder: Path, name: str, runs: SweepRuns) -> dict[str, Any] | None:
    """Contents of the JSON file in a folder that holds the rows of these runs, all of them.

    None if it holds nothing, or nothing whole; a `WrongInput` is raised if it holds others.
    """
    index = folder / f"{name}.json"
    if basis_in(folder / UNFINISHED) is not None or not index.exists():
        return None
    basis = basis_of(runs)
    try:
        summary = json.loads(index.read_bytes())
        former, dataset = dict(summary["basis"]), folder / summary["dataset"]
    except (OSError, ValueError, LookupError, TypeError):
        notice(f"{index} is broken; all runs are done again")
        return None
    check_same(former, basis, folder)
    try:
        check_merged(dataset, len(runs), basis)
    except Broken as broken:
        notice(f"{broken}; all runs are done again")
        return None
    return summary
