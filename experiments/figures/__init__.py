"""Figures 2 and 3 of the paper from the simulated machine and loops; Bode plot; failure atlas."""

from experiments.hexapod.choices import MACHINE_FILE
from experiments.output.study import Study

STUDY = Study(
    name="figures",
    help="""Draw the machine, its control loops and its failure conditions.

    The geometry as in Fig. 2, the loop as in Fig. 3 with its transfer functions and margins, a
    Bode plot, and which of the 3^6 failure conditions leave the pointing task possible: 10 s.

    Writes figures.json, the tables as figures.md, and figure2, figure3, bode and atlas, each as
    .png and .pdf; figure2 also as .svg.

    Example: fjh figures --model mine.xml --out /tmp/mine
    """,
    runs="experiments.figures.runs:run_figures",
    results="experiments.figures.results:results",
    quick="As without: it takes seconds anyway.",
    seed="nothing: none of this is random",
    options=(MACHINE_FILE,),
)
