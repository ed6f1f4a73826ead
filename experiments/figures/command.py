"""The command `fjh figures`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.app.legacy import MachineFile, Out, seed_option
from experiments.output.files import usable_folder
from experiments.output.findings import Findings
from experiments.output.study import Progress


def figures(
    out: Out = Path("results/figures"),
    seed: Annotated[int, seed_option("nothing: none of this is random")] = 0,
    quick: Annotated[
        bool, typer.Option("--quick", help="As without: it takes seconds anyway.")
    ] = False,
    model: MachineFile = None,
    *,
    progress: Progress,
) -> Findings:
    """Draw the machine, its loops and its failures.

    The geometry as in Fig. 2, the loop as in Fig. 3 with its transfer functions and margins, a
    Bode plot, and what is left of pointing in all 3^6 failure conditions: 10 s.

    Writes figures.json, and figure2, figure3, bode and atlas, each as .png and .pdf; figure2 also
    as .svg.

    Example: fjh figures --model mine.xml --out /tmp/mine
    """
    from experiments.figures import report
    from experiments.figures.study import portray
    from experiments.figures.summary import summarize
    from experiments.figures.text import findings

    folder = usable_folder(out)
    with progress("figures"):
        portrait = portray(model)
        summary = report.write(folder, portrait, summarize(portrait, seed))
    return findings(summary)
