"""The command `fjh`: one experiment, its options, one sentence when something is wrong."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from experiments.files import OutputError, published, usable_folder, write_arrays, write_json
from experiments.interrupt import INTERRUPTED, SENTENCE
from experiments.mapping import JacobianChoice
from experiments.terminal import print_rows, progress
from sim import ModelError, SimulationDiverged

UNSOUND, WRONG_INPUT = 1, 2
MAX_SEED = 2**32 - 1

Seed = Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the detector noise.")]

app = typer.Typer(
    name="fjh",
    help="Experiments on the fault-tolerant hexapod and the other mechanisms of its paper.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.callback()
def _fjh() -> None:
    """Experiments on the fault-tolerant hexapod and the other mechanisms of its paper."""


@app.command()
def table1(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/table1"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the first 4 s of the 16 s spiral.")
    ] = False,
    jacobian: Annotated[
        JacobianChoice,
        typer.Option(
            help="Jacobian in the mapping: analytic, at the estimated pose every control tick, or "
            "constant, at the nominal pose as eq. (39). Both are run; this one makes the table."
        ),
    ] = "analytic",
    model: Annotated[
        Path | None, typer.Option(help="Another MJCF file; default models/fjh.xml.")
    ] = None,
) -> None:
    """Reproduce Table I and Figures 4 to 6.

    Six spirals, sound and with strut 1 locked, and the linear model of the bench beside them.
    """
    # Late: the help text need not wait for MuJoCo's and matplotlib's import.
    from experiments import report_table1
    from experiments.soundness import complaint
    from experiments.summary import summarize
    from experiments.table1 import run_table1

    folder = usable_folder(out)
    with progress("Table I") as on_progress, _diverged_into(folder):
        result = run_table1(
            mjcf=model, seed=seed, quick=quick, jacobian=jacobian, on_progress=on_progress
        )
    summary = summarize(result)
    report_table1.write(folder, result, summary)
    _print_table(summary)
    if sentence := complaint(summary):
        raise _Unsound(f"the table is not sound: {sentence}")


@app.command()
def systems(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/systems"),
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Seed of the directions that are tried.")
    ] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the first three conditions of each.")
    ] = False,
) -> None:
    """Classify and drive four other mechanisms.

    An arm, a hand, two arms and a platform, sound and failed; the simulation is compared with what
    the classification says.
    """
    from experiments import report_systems, systems_summary
    from experiments.systems import run_systems

    folder = usable_folder(out)
    with progress("systems") as on_progress, _diverged_into(folder):
        examinations = run_systems(seed=seed, quick=quick, on_progress=on_progress)
    summary = systems_summary.summarize(examinations, seed)
    report_systems.write(folder, examinations, summary)
    title = "What the classification says; `off by`: simulated motion and torques"
    print_rows(title, systems_summary.HEADINGS, systems_summary.table_rows(summary))
    if sentence := systems_summary.complaint(summary):
        raise _Unsound(f"the experiment is not sound: {sentence}")


@app.command()
def release(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/release"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Spirals of 4 s, and three points of the sweep.")
    ] = False,
) -> None:
    """Take coil and spring of strut 1 away.

    From the start and in flight, told to the mapping or not; predicted and simulated. At rest, over
    six decades of stiffness.
    """
    from experiments import report_release
    from experiments.release import run_release
    from experiments.release_summary import complaint, summarize

    folder = usable_folder(out)
    with progress("release") as on_progress, _diverged_into(folder):
        result = run_release(seed=seed, quick=quick, on_progress=on_progress)
    summary = summarize(result, seed)
    report_release.write(folder, result, summary)
    print_rows(
        "Strut 1 released: RMS of desired minus true angle, peak of alpha, urad; peak sensitivity",
        report_release.HEADINGS,
        report_release.table_rows(summary),
    )
    if sentence := complaint(summary):
        raise _Unsound(f"the experiment is not sound: {sentence}")


@app.command()
def bench(
    out: Annotated[Path, typer.Option(help="Folder for bench.json.")] = Path("results/bench"),
    seed: Seed = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="Time 0.5 s of simulation instead of 4 s.")
    ] = False,
) -> None:
    """Time the loop against bare physics.

    Ratios of medians of five, in one process.
    """
    from experiments.speed import measure

    folder = usable_folder(out)
    with progress("bench") as on_progress:
        result = measure(
            seconds=0.5 if quick else 4.0, repeats=5, seed=seed, on_progress=on_progress
        )
    with published(folder, index="bench.json") as staging:
        write_json(staging / "bench.json", result)
    for name, ratio in result["closed_loop_over_mj_step"].items():
        factor = result["real_time_factor"][f"closed_loop_{name}"]
        print(f"{name} Jacobian: {ratio:.2f} x mj_step, {factor:.1f} x real time")


def main(arguments: list[str] | None = None) -> int:
    """Run `fjh`; returns the exit code: 0 sound, 1 unsound, 2 wrong input, 130 interrupted."""
    try:
        code = app(args=arguments, prog_name="fjh", standalone_mode=False)
    except typer.exceptions.TyperException as error:
        return _complain(error.format_message(), WRONG_INPUT)
    except (ModelError, OutputError) as error:
        return _complain(str(error), WRONG_INPUT)
    except _Unsound as error:
        return _complain(str(error), UNSOUND)
    if code == INTERRUPTED:  # Typer has already caught the Ctrl-C
        return _complain(SENTENCE, INTERRUPTED)
    return code or 0


class _Unsound(Exception):
    """The run ended, but its numbers cannot be trusted."""


def _complain(sentence: str, code: int) -> int:
    if sentence:
        print(f"fjh: {sentence}", file=sys.stderr)
    return code


@contextmanager
def _diverged_into(folder: Path) -> Iterator[None]:
    """Leave the state of a diverging simulation in the folder."""
    try:
        yield
    except SimulationDiverged as diverged:
        state = {"time_s": np.array(diverged.time_s), "state": diverged.state}
        with published(folder, index="diverged.npz") as staging:
            write_arrays(staging / "diverged.npz", state)
        raise _Unsound(f"{diverged}; the state is in {folder / 'diverged.npz'}") from None


def _print_table(summary: dict) -> None:
    from experiments.table_text import notes, table_rows, table_title

    columns = summary["columns"]
    headings = [column["name"].replace("_uncorrected", "\nuncorr.") for column in columns]
    rows = [(label, *cells) for label, cells in table_rows(columns)]
    print_rows(table_title(summary), ("", *headings), rows)
    for note in notes(summary):
        Console().print(note)
