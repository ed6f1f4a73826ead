"""The command `fjh jacobian`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.conduct import MAX_SEED, Unsound, diverged_into
from experiments.files import usable_folder
from experiments.terminal import print_notes, print_rows, progress


def jacobian(
    out: Annotated[Path, typer.Option(help="Folder for results.")] = Path("results/jacobian"),
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Seed of the searches and the detector noise.")
    ] = 0,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Few local searches; with --loop three sizes, 4 s each."),
    ] = False,
    loop: Annotated[
        bool,
        typer.Option(
            "--loop", help="Also track the spiral with each Jacobian, ever larger; minutes."
        ),
    ] = False,
) -> None:
    """Ask whether the Jacobian is constant, eq. (40).

    Its largest change over the stroke, with a certificate; where the paper's smaller numbers may
    come from; and with --loop what a constant Jacobian costs as spiral and stroke grow.
    """
    from experiments.jacobian import report
    from experiments.jacobian.loop import run_loop
    from experiments.jacobian.loop_summary import loop_complaint, summarize_loop
    from experiments.jacobian.study import run_jacobian
    from experiments.jacobian.summary import HEADINGS, complaint, summarize, table_rows

    folder = usable_folder(out)
    with progress("jacobian") as on_progress:
        study = run_jacobian(seed=seed, quick=quick, on_progress=on_progress)
    summary, outcomes = summarize(study, seed), {}
    if loop:
        with progress("in the loop") as on_progress, diverged_into(folder):
            outcomes = run_loop(seed=seed, quick=quick, on_progress=on_progress)
        summary |= {"loop": summarize_loop(outcomes, seed)}
    report.write(folder, summary, outcomes)
    print_rows(
        "Eq. (40): largest relative change of J over the stroke", HEADINGS, table_rows(summary)
    )
    print_notes([summary["paragraph"]])
    if loop:
        print_rows(
            "In the loop, strut 1 locked: secondary goal off its optimum, loop gain off, %",
            report.LOOP_HEADINGS,
            report.loop_rows(summary["loop"]),
        )
        print_notes([summary["loop"]["paragraph"]])
    if sentence := complaint(summary) or (loop and loop_complaint(summary["loop"])):
        raise Unsound(f"the study is not sound: {sentence}")
