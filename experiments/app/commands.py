"""Commands `results`, `review`, `render` and `animate`, which show results of runs and studies."""

import re
import shlex
from pathlib import Path
from typing import Annotated

from experiments.app.terminal import print_result, print_summary, progress
from fjh.study.errors import Unsound, WrongInput
from fjh.study.files import published, usable_file
from fjh.study.input_checks import check_file
from fjh.study.interrupts import printable
from fjh.study.option import Option

_SIZE = re.compile(r"([1-9]\d{1,3})x([1-9]\d{1,3})")

Model = Annotated[
    Path | None,
    Option("Machine file of the runs, MJCF.  [default: the one named in the runs]", "FILE"),
]


def results(
    *,
    places: Annotated[
        list[Path],
        Option("Folders with results; with --against one, or its JSON file.", "FOLDER", True),
    ],
    against: Annotated[
        Path | None, Option("Earlier result of the same study, to compare with.", "FOLDER")
    ] = None,
) -> None:
    """Print the runs and checks in results, or the changes since an earlier result.

    Settings that differ are printed first; rows are matched by name, and changes within noise (see
    docs/recordings.md) are left out. The exit code is 1 if a check failed or, with --against, if a
    check fails that passed before. In Python, `fjh.results` and `fjh.compare` return data frames.

    Example: fjh results results/table1 --against docs/data/table1.json
    """
    if against is None:
        failing = _list(places)
    elif len(places) > 1:
        raise WrongInput(f"one result is compared with {against}, got {len(places)}")
    else:
        from fjh.comparison import compare  # late, as the help text must not wait for it

        changes = compare(against, places[0])
        failing = [str(what) for what in changes.failing.what]
        for line in str(changes).splitlines():
            print(printable(line))
    if failing:
        news = "" if against is None else " that passed before"
        raise Unsound(f"{len(failing)} checks fail{news}: {failing[0]}")


def _list(folders: list[Path]) -> list[str]:
    """Print the runs and checks of results; return the checks that failed."""
    from fjh.result_frames import results as read  # late, as above
    from fjh.study.result import TableView

    frames, tables, notes = read(*folders), list[TableView](), list[str]()
    checks = frames.checks
    failed = checks[~checks.passed.astype(bool)] if len(checks) else checks
    for (study, place), runs in frames.runs.groupby(["study", "folder"], sort=False):
        selected = ((one.study == study) & (one.folder == place) for one in (checks, failed))
        count, wrong = (int(rows.sum()) for rows in selected)
        title, passed = f"{study or 'recordings'} in {place}", f"{count - wrong} of {count} checks"
        notes.append(f"{title}: {len(runs):,} run{'s' * (len(runs) > 1)}, {passed} passed")
        plain = runs.drop(columns=["study", "folder"]).dropna(axis=1, how="all")
        plain = plain.rename(columns=lambda name: re.sub(r"[\s:=]", "_", name))
        # Errors are more important than settings.
        numbers = plain.iloc[:, 1:].select_dtypes(float)
        numbers = sorted(numbers, key=lambda name: "rms" not in name)
        columns = [plain.columns[0], *(f"{name}:.4g" for name in numbers)]
        tables.append(TableView(title, plain, " ".join(columns)))
    more = "More in the files, and in Python from fjh.results"
    if len(tables) > 1:
        tables, more = [], "More with fewer folders"
    print_result(tables=tables, notes=notes, more=more)
    return [f"{one.where}: {one.what}" for one in failed.itertuples()]


def review(
    *,
    runs: Annotated[
        list[Path],
        Option("Folders with results, or single runs (.npz), of any robots.", "RUN", True),
    ],
    out: Annotated[Path, Option("Recording to write.", "FILE.rrd")] = Path("review.rrd"),
    model: Model = None,
) -> None:
    """Show several runs of any robots side by side in one recording.

    Two or three runs are shown with the robot in 3D, error, inputs, secondary motion, states and
    events; more runs with a column of plots each, a page of robots and a page of numbers. Runs of
    one robot and task have the same scales. A robot's MJCF file is found by its SHA-256 where `fjh
    track` read it, or in models/. Takes seconds.

    Example: fjh review results/table1 results/track --out /tmp/runs.rrd
    """
    folder = usable_file(out, ".rrd")
    for run in (run for run in runs if not run.is_dir()):
        check_file(run)
    with progress("review"):
        from fjh.recording.review import write_review  # late, as above

        with published(folder, index=out.name) as staging:
            write_review(staging / out.name, runs, model)
    checked = "All runs agree with the numbers in their JSON files."
    print_summary(checked, out, shlex.join(["rerun", str(out)]))


def render(
    *,
    file: Annotated[Path, Option("A recording.", "FILE.rrd", positional=True)],
    out: Annotated[Path, Option("Picture to write.", "FILE.png")],
    time: Annotated[
        float | None, Option("Simulation time to show [s].  [default: the recording's end]", "S")
    ] = None,
    size: Annotated[str, Option("Size of the picture in pixels.", "WIDTHxHEIGHT")] = "1600x900",
) -> None:
    """Make a picture of a recording's views, on white.

    Needs a graphics card or Mesa's Vulkan driver (mesa-vulkan-drivers), but no display. Dark and
    light greys are exchanged, because without a display the viewer has only a dark theme. A warning
    of the viewer counts as an error. Takes 5 s.

    Example: fjh render results/table1/W_e.rrd --time 6 --out picture.png
    """
    check_file(file)
    pixels = _SIZE.fullmatch(size)
    if not pixels:
        raise WrongInput(f"--size must be WIDTHxHEIGHT, got {size}")
    folder = usable_file(out, ".png")
    with progress("render"):
        from fjh.recording.render import picture_of  # late, as above

        picture = picture_of(file, time, (int(pixels[1]), int(pixels[2])))
        with published(folder, index=out.name) as staging:
            picture.save(staging / out.name)
    print_summary("The viewer gave no warning.", out, shlex.join(["rerun", str(file)]))


def animate(
    *,
    runs: Annotated[list[Path], Option("A run of any robot, or two.", "RUN.npz [RUN.npz]", True)],
    out: Annotated[Path, Option("The animation to write.", "FILE.gif")],
    model: Model = None,
) -> None:
    """Make an animation of a run, or of two side by side.

    The animation shows the machine with failed parts in magenta, its path and its error, from
    shortly before the first failure; two runs of one robot and task have the same scales. Needs a
    Vulkan driver like `fjh render`. The GIF of 8 s has less than 1 MB. Takes half a minute.

    Example: fjh animate unaware/track.npz diagnosed/track.npz --out lock.gif
    """
    if len(runs) > 2:
        raise WrongInput(f"an animation has one run or two, got {len(runs)}")
    for run in runs:
        check_file(run)
    folder = usable_file(out, ".gif")
    with progress("animate") as on_progress, published(folder, index=out.name) as staging:
        from fjh.recording.animate import write_animation  # late, as above

        write_animation(staging / out.name, runs, model, on_progress)
    following = shlex.join(["fjh", "review", *map(str, runs)])
    print_summary("The viewer gave no warning.", out, following)
