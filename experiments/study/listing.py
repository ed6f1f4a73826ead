"""Rows of runs in folders: of the dataset beside them, or of their recordings' properties."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import acero

from argument_checks.ties import ascending
from experiments.study import parquet
from experiments.study.foreign import read_json
from experiments.study.query import HIDDEN, Question
from experiments.study.spelling import check_file
from experiments.study.study import WrongInput

SOURCE, ROW = f"{HIDDEN}source", f"{HIDDEN}row"
"""Columns that say where a row is from: number of its source, and number there."""


@dataclass(frozen=True)
class Source:
    """A folder with runs.

    Attributes:
        folder: Where.
        rows: Of the dataset, or of the recordings in their order.
        summary: Contents of the JSON file that names the dataset; empty where there is none.
        recordings: Whose properties the rows are, where there is no dataset.
    """

    folder: Path
    rows: pa.Table
    summary: dict[str, Any] = field(default_factory=dict)
    recordings: tuple[Path, ...] = ()


Properties = Callable[[Path], dict[str, Any]]
"""Reads those of a recording."""


def sources_of(folder: Path, properties_of: Properties) -> list[Source]:
    """The runs of a folder, and of each folder below it that has some; hidden ones are left out.

    Raises:
        WrongInput: It is no folder, there is neither a dataset nor a recording, or a file beside
            them cannot be read.
        OutputError: A dataset is not what was written.
    """
    if not folder.is_dir():
        raise WrongInput(f"{folder} is no folder")
    places = [folder]
    for place, below, files in os.walk(folder):
        below[:] = sorted(each for each in below if not each.startswith("."))
        if Path(place) != folder and any(each.endswith((".rrd", ".parquet")) for each in files):
            places.append(Path(place))
    found = [each for place in places if (each := _source(place, properties_of)) is not None]
    if not found:
        raise WrongInput(
            f"{folder} has neither a dataset nor a recording (.rrd), and no folder below it has one"
        )
    return found


def _source(folder: Path, properties_of: Properties) -> Source | None:
    """The runs of a folder itself; None where it has none."""
    for file in sorted(folder.glob("*.json")):
        summary = read_json(file)
        if isinstance(summary, dict) and isinstance(name := summary.get("dataset"), str):
            path = folder / Path(name).name
            check_file(path)
            return Source(folder, parquet.read(path), summary)
    recordings = tuple(sorted(folder.glob("*.rrd")))
    if not recordings:
        return None
    rows = [{"recording": path.stem} | properties_of(path) for path in recordings]
    return Source(folder, _together([_table([row]) for row in rows]), recordings=recordings)


def all_rows(sources: Sequence[Source]) -> pa.Table:
    """Rows of all sources, with where they are from; of several, `folder` names theirs.

    Raises:
        WrongInput: A column is a number in one and text in another.
    """
    tables = []
    for number, source in enumerate(sources):
        rows, count = source.rows, len(source.rows)
        if len(sources) > 1:
            folders = pa.array([str(source.folder)] * count, pa.string())
            rows = rows.append_column("folder", folders)
        own = pa.array(np.full(count, number)), pa.array(np.arange(count))
        tables.append(rows.append_column(SOURCE, own[0]).append_column(ROW, own[1]))
    return _together(tables)


def _table(rows: list[dict[str, Any]]) -> pa.Table:
    try:
        return pa.Table.from_pylist(rows)
    except (pa.ArrowException, OverflowError) as error:
        raise WrongInput(f"properties of a recording cannot be read: {error}") from None


def _together(tables: list[pa.Table]) -> pa.Table:
    try:
        return pa.concat_tables(tables, promote_options="permissive")
    except pa.ArrowException as error:
        why = " ".join(str(error).split())
        raise WrongInput(f"the runs cannot be listed together: {why}") from None


def satisfying(rows: pa.Table, question: Question, worst: Question | None) -> pa.Table:
    """Rows that satisfy a question, with columns for what it names, the worst first.

    Those are the rows of the largest number; where it is missing, they are last. What a question
    names in another unit, and the number itself, are further columns by the names it gives them.
    """
    wanted: dict[str, Any] = {f"{HIDDEN}holds": question.condition()}
    if worst is not None:
        wanted |= {worst.text: worst.number()}
    for each in (question, *([] if worst is None else [worst])):
        wanted |= {name: term.of for name, term in each.asked.items()}
    values = _projected(rows, wanted)
    for name in values.column_names[1:]:
        if name not in rows.column_names:
            rows = rows.append_column(name, values[name])
    found = rows.filter(values[0])
    if worst is None:
        return found
    number = np.asarray(values[worst.text].filter(values[0]).to_numpy(), dtype=float)
    return found.take(ascending(-number))


def _projected(rows: pa.Table, columns: dict[str, Any]) -> pa.Table:
    """Columns of expressions, in the order of the rows."""
    source = acero.Declaration("table_source", acero.TableSourceNodeOptions(rows))
    project = acero.ProjectNodeOptions(list(columns.values()), list(columns))
    plan = acero.Declaration.from_sequence([source, acero.Declaration("project", project)])
    return plan.to_table(use_threads=False)  # threads would exchange rows
