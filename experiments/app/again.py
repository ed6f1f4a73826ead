"""Runs that were found, side by side in one recording; what was never recorded is flown again."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from experiments.app.review import write_review
from experiments.recording.record import About, write_run
from experiments.rig import Rig, Run
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.studies import STUDIES
from experiments.study.campaign import Again, Row
from experiments.study.listing import ROW, SOURCE, Source
from experiments.study.parallel import in_parallel
from experiments.study.study import OnProgress, Unsound, WrongInput
from sim import ModelError, SimulationDiverged

ACCURACY = 1e-9
"""Relative difference up to which a number of a run that is flown again is the same."""

LONGEST_S = 60.0
"""Of a run that is flown again: a longer one would fill the memory."""


@dataclass(frozen=True)
class Repeated:
    """A run of a dataset that was flown again."""

    case: int
    again: Again
    source: Source
    columns: Row
    run: Run
    known: str

    def said(self, stated: Row) -> str:
        """Whether it agrees with its row; raises `Unsound` where nothing has changed that may."""
        others = [key for key, new in self.columns.items() if not _agree(stated[key], new)]
        if not others:
            return f"Case {self.case}, flown again, agrees with its row to {ACCURACY:g}."
        name = next((key for key in others if key.startswith("rms")), others[0])
        ours, theirs = self.again.campaign.basis, self.source.summary["basis"]
        depends_on = ours.keys() - self.again.campaign.drawn_from.keys()
        changed = [key for key in ours if key in depends_on and theirs.get(key) != ours[key]]
        what = f"{name} is {_short(self.columns[name])} instead of {_short(stated[name])}"
        if not changed:
            raise Unsound(f"case {self.case} flown again differs from its row: {what}")
        return (
            f"Case {self.case}, flown again, differs from its row ({what}): the dataset was "
            f"written with another {', '.join(changed)}."
        )


def write_found(
    file: Path, rows: Sequence[Row], sources: Sequence[Source], on_progress: OnProgress
) -> list[str]:
    """Write the recording of some rows side by side; returns sentences on those flown again.

    Raises:
        WrongInput: A run cannot be repeated, or not be drawn; the message says why.
        Unsound: A run came out otherwise, though all that it depends on is as it was.
    """
    beside = [sources[row[SOURCE]].recordings for row in rows]
    unrecorded = [row for row, recordings in zip(rows, beside, strict=True) if not recordings]
    said, repeated = list[str](), iter(_repeated(unrecorded, sources, on_progress))
    with tempfile.TemporaryDirectory(prefix="fjh-") as place:
        files = list[Path]()
        for k, (row, recordings) in enumerate(zip(rows, beside, strict=True)):
            if recordings:
                files.append(recordings[row[ROW]].with_suffix(".npz"))
                continue
            one = next(repeated)
            said.append(one.said(row))
            (folder := Path(place, str(k))).mkdir()
            files.append(_kept(folder, one, row))
        write_review(file, files, None)
    return said


def _repeated(
    rows: Sequence[Row], sources: Sequence[Source], on_progress: OnProgress
) -> Iterator[Repeated]:
    studies = [again_of(source) if not source.recordings else None for source in sources]
    chosen = [(row, sources[row[SOURCE]], studies[row[SOURCE]]) for row in rows]
    calls = [{"again": again, "row": row} for row, _, again in chosen]
    for (row, source, again), found in zip(
        chosen, in_parallel(flown, calls, on_progress) if calls else [], strict=True
    ):
        assert again is not None  # the row is of a dataset
        yield Repeated(row["case"], again, source, *found)


def again_of(source: Source) -> Again:
    """How the runs of a dataset are flown again; a `WrongInput` says why they cannot be."""
    name = str(source.summary.get("experiment"))
    known = {study.name: study.listing for study in STUDIES}
    if (listing := known.get(name)) is None:
        raise WrongInput(f"runs of {name!r:.40} in {source.folder} cannot be flown again")
    try:
        return resolve_name(listing.again)(source.summary)
    except (LookupError, TypeError, ValueError, AttributeError):
        raise WrongInput(
            f"the runs in {source.folder} cannot be flown again: this version draws them otherwise"
        ) from None


def flown(again: Again, row: Row) -> tuple[Row, Run, str]:
    """A run, in a process of its own; refused where it is not that of the row."""
    case = row["case"]
    run = again.campaign.runs[case]
    drawn: Mapping[str, Any] = run.parameters()
    if others := [name for name, value in drawn.items() if not _agree(row.get(name), value)]:
        raise WrongInput(
            f"case {case} cannot be flown again: this version draws another {others[0]}"
        )
    if run.duration_s > LONGEST_S:
        raise WrongInput(f"case {case} is not flown again: it lasts {run.duration_s:g} s")
    try:
        return again.fly(run)
    except (SimulationDiverged, ModelError) as error:
        raise WrongInput(f"case {case} cannot be shown: {error}") from None


def _kept(folder: Path, one: Repeated, row: Row) -> Path:
    """Data and recording of a run."""
    study = str(one.source.summary["experiment"])
    name = f"{study}_{one.case}"
    stated = {key: value for key, value in row.items() if value is not None and key[:2] != "__"}
    about = About(
        study=study,
        identity=f"{study}-case{one.case}",
        title=name,
        said=[f"Case {one.case} of {one.source.folder.name}, flown again."],
        parameters=stated,
    )
    path, arrays = folder / f"{name}.rrd", hexapod_arrays(one.run)
    write_run(path, Rig.hexapod(), one.run, about, arrays=arrays, known=one.known)
    return path.with_suffix(".npz")


def _agree(stated: Any, new: Any) -> bool:
    if isinstance(stated, float) and isinstance(new, int | float):
        return abs(stated - new) <= ACCURACY * max(abs(stated), abs(new))
    return stated == new


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else repr(value)
