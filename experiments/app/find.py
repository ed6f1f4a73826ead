"""The command `fjh find`: runs by what came out of them, and the worst of them side by side."""

import os
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.studies import STUDIES
from experiments.study.files import json_text, published, usable_file
from experiments.study.interrupts import printable
from experiments.study.tables import Column, Table, tabulate
from experiments.study.terminal import Ending, print_ending, print_notes, print_table, progress

if TYPE_CHECKING:  # the help text does not wait for these imports
    import pyarrow as pa

    from experiments.study.listing import Source

PRINTED, OPENED = 20, 3
_OF_RECORDINGS = ("recording", "study", "robot", "actuator", "kind", "named_s")

_QUERY = typer.Argument(
    metavar="QUESTION", help="Comparisons of columns, in quotes, as in Python; True is all runs."
)
_PLACES = typer.Argument(
    metavar="FOLDER", help="Folders with results or recordings, or with such folders below."
)
_OUT = typer.Option(metavar="FILE.rrd", help="Recording of the worst to write.")
_BY = typer.Option(
    metavar="NUMBER",
    help="What is larger the worse a run is: a column, or a number made of columns.  "
    "[default: the study's own, an RMS error]",
)
_LIST = typer.Option("--list", help="Print the table alone; record and open nothing.")
_JSON = typer.Option("--json", help="Print all runs that were found as JSON; open nothing.")


def find(
    question: Annotated[str, _QUERY],
    folders: Annotated[list[Path], _PLACES],
    out: Annotated[Path, _OUT] = Path("found.rrd"),
    by: Annotated[str | None, _BY] = None,
    listed: Annotated[bool, _LIST] = False,
    json: Annotated[bool, _JSON] = False,
) -> None:
    """List the runs that satisfy a question, and open the worst three side by side.

    The runs are the rows of the dataset (.parquet) in a folder, or its recordings (.rrd) where it
    has none; of all folders below it likewise. Names are those of the columns or of the recordings'
    properties; their units may be others: named_s is named_ms / 1000. A missing number or word
    satisfies no comparison; "x is None" asks for it. A run without a recording is flown again from
    its case number and compared with its row. The exit code is 0 if no run is found. docs/find.md
    has all.

    Example: fjh find "named_s > 0.1 and kind == 'locked'" results/recover
    """
    folder = usable_file(out, ".rrd")
    with progress("find"):
        from experiments.recording.properties import properties_of  # late: help does not wait
        from experiments.study.listing import all_rows, satisfying, sources_of
        from experiments.study.query import Question

        each = [source for place in folders for source in sources_of(place, properties_of)]
        sources = list({source.folder.resolve(): source for source in each}.values())
        rows = all_rows(sources)
        asked = Question(question, rows.schema)
        number = worst_of(rows.column_names, sources, by)
        worst = None if number is None else Question(number, rows.schema)
        found = satisfying(rows, asked, worst)
        number = worst and worst.text
    if json:
        print(json_text(_content(asked.text, number, found, len(rows))), end="")
        return
    print_table(table_of(found, len(rows), columns_of(found, sources, asked.asked, number), number))
    if listed or not len(found):
        return
    with progress("find") as on_progress:
        from experiments.app.again import write_found  # late: MuJoCo takes a second

        with published(folder, index=out.name) as staging:
            first = found.slice(0, OPENED).to_pylist()
            said = write_found(staging / out.name, first, sources, on_progress)
    print_notes(said)
    print_ending(Ending(opened(out, len(first)), out, shlex.join(["rerun", str(out)])))


def worst_of(names: Sequence[str], sources: "Sequence[Source]", by: str | None) -> str | None:
    """The number by which runs are sorted; None where they have none that says so of itself."""
    if by is not None:
        return by
    listings = {study.name: study.listing for study in STUDIES}
    for source in sources:
        listing = listings.get(source.summary.get("experiment", ""))
        for name in listing.worst if listing else ():
            if name in names:
                return name
    errors = [name for name in names if name.startswith("rms_after")]
    return min(((len(name), name) for name in errors), default=(0, None))[1]


def columns_of(
    found: "pa.Table", sources: "Sequence[Source]", asked: Iterable[str], number: str | None
) -> list[str]:
    """Of the table: what says which run it is, what was asked, and by what it is sorted."""
    of_studies = {source.summary.get("experiment") for source in sources}
    listings = [each.listing for each in STUDIES if each.listing and each.name in of_studies]
    own = [name for listing in listings for name in listing.shown]
    wanted = ["folder", "case", *own, *_OF_RECORDINGS, *asked, *([number] if number else [])]
    kept = [name for name in dict.fromkeys(wanted) if name in found.column_names]
    return [each for each in kept if each in asked or found[each].null_count < len(found)]


def table_of(found: "pa.Table", total: int, names: Sequence[str], number: str | None) -> Table:
    """The first rows, and how many there are."""
    columns = [Column(printable(name), name, _cell) for name in names]
    more = len(found) - PRINTED
    legend = f"{len(found)} of {total} runs" + (
        f", the {PRINTED} worst above." if more > 0 else "."
    )
    if number:
        legend += f" The worst is that of the largest {number}; runs without it are last."
    return tabulate("", columns, found.slice(0, PRINTED).to_pylist(), legend)


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.5g}" if isinstance(value, float) else printable(str(value))


def _content(question: str, number: str | None, found: "pa.Table", total: int) -> dict[str, Any]:
    """For scripts: all columns of all runs that were found; a number that is none is null."""
    from experiments.study.listing import ROW, SOURCE

    runs = found.drop_columns([SOURCE, ROW]).to_pylist()
    plain = [{name: _finite(value) for name, value in run.items()} for run in runs]
    return {"question": question, "by": number, "runs": total, "found": len(plain), "rows": plain}


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


def opened(out: Path, count: int) -> str:
    """Opens the viewer where there are a person and a screen; a sentence on what is in the file."""
    what = f"The worst {count} are side by side" if count > 1 else "The worst is in it"
    screen = sys.platform in ("darwin", "win32") or {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ)
    if not (screen and sys.stdout.isatty()):
        return f"{what}."
    from experiments.app.render import VIEWER  # late, as above

    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.Popen([VIEWER, "--bind", "127.0.0.1", out], start_new_session=True, **quiet)
    return f"{what}, and open in the viewer."
