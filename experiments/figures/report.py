"""Everything that `fjh figures` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.figures.atlas import figure_atlas
from experiments.figures.block_diagram import figure_3
from experiments.figures.bode import figure_bode
from experiments.figures.geometry import figure_2
from experiments.figures.study import Portrait
from experiments.output.files import published, write_index
from experiments.output.plotting import save_figure


def write(folder: Path, portrait: Portrait, summary: dict[str, Any]) -> dict[str, Any]:
    """Write the figures and their numbers; all of them or none.

    Returns:
        The contents of `figures.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="figures.json") as staging:
        save_figure(figure_2(portrait.model), staging, "figure2", ("png", "pdf", "svg"))
        save_figure(figure_3(portrait), staging, "figure3")
        save_figure(figure_bode(portrait.loops), staging, "bode")
        save_figure(figure_atlas(portrait.atlas), staging, "atlas")
        return write_index(staging / "figures.json", summary)
