"""Run what is missing of a sweep, on whatever there is to run it."""

import json
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from experiments.conduct import Interrupted, OnProgress, WrongInput
from experiments.report.origin import processor
from experiments.sweep.cluster import Where, cluster
from experiments.sweep.dataset import Dataset, basis_in
from experiments.sweep.design import Cases
from experiments.sweep.identity import identity
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
    basis: dict[str, Any]
    took: dict[str, Any]


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
    took = _run_missing(dataset, cases, where, on_progress)
    return Ran(dataset, basis, took)


def finished_before(folder: Path, index: str, cases: Cases) -> dict[str, Any] | None:
    """The index of a folder that holds these cases already, all of them; None if it holds nothing.

    Raises:
        WrongInput: It holds others.
    """
    if basis_in(folder / UNFINISHED) is not None:
        return None
    try:
        summary = json.loads((folder / index).read_bytes())
        former = summary["basis"]
    except (OSError, ValueError, LookupError, TypeError):
        return None  # there is none, or it is not one that we wrote
    check_same(former, basis_of(cases), folder)
    return summary


def basis_of(cases: Cases) -> dict[str, Any]:
    """All that the bytes of a dataset depend on; as JSON it is the same again."""
    basis = {
        "design": cases.design.as_json(),
        "seed": cases.seed,
        **identity(),
        "version of pyarrow": version("pyarrow"),
        "processor": processor(),
    }
    return json.loads(json.dumps(basis))


def check_same(former: dict[str, Any], basis: dict[str, Any], folder: Path) -> None:
    """Whether a sweep goes on as it began.

    Raises:
        WrongInput: It does not; the message says what has changed.
    """
    changed = [name for name in basis if former.get(name) != basis[name]]
    if changed:
        raise WrongInput(
            f"--resume cannot go on with the sweep in {folder}: it has another {', '.join(changed)}"
        )


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
