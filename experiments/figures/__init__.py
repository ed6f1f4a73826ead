"""Figures 2 and 3 of the paper from the simulated machine and loops; Bode plot; failure atlas."""

from experiments.rig.options import MACHINE_FILE
from experiments.study.study import Study

STUDY = Study(
    name="figures",
    help="""Draw the machine, its control loops and its failure conditions.

    Draws the geometry as in Fig. 2 of the paper, the loop as in Fig. 3 with its transfer functions
    and margins, a Bode plot, and a map of the 3^6 failure conditions that shows in which of them
    the pointing task is possible. 10 s.

    Writes figures.json, the tables as figures.md, and machine, figure2, figure3, bode and atlas,
    each as .png and .pdf; figure2 also as .svg.

    Example: fjh figures --model mine.xml --out /tmp/mine
    """,
    runs="experiments.figures.runs:run_figures",
    results="experiments.figures.results:results",
    quick=None,
    seed=None,
    options=(MACHINE_FILE,),
)
