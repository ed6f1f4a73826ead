"""Figures for print: widths, colours, style and files, without a display."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from fjh.study.palette import BLACK, BLUE, VERMILION

PAGE_IN = 7.16
"""Width [inch] of a figure across two columns of a page; that across one is `COLUMN_IN`."""
COLUMN_IN = 3.5

DESIRED, MEASURED, START = BLACK, BLUE, VERMILION
COLOR_MAP = "cividis"
"""Colour map of quantities, perceptually uniform also for colour-blind readers."""

TEXT_PT, TITLE_PT = 7, 8
"""Sizes of text and titles [pt]; 7 pt is the smallest that journals print."""

_NO_DATE = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}

matplotlib.use("Agg")
matplotlib.rc("figure", dpi=220, titlesize=TITLE_PT, labelsize=TEXT_PT)
matplotlib.rc("font", size=TEXT_PT)
matplotlib.rc("axes", titlesize=TITLE_PT, labelsize=TEXT_PT, grid=True, linewidth=0.6)
matplotlib.rc("xtick", labelsize=TEXT_PT)
matplotlib.rc("ytick", labelsize=TEXT_PT)
matplotlib.rc("xtick.major", width=0.6)
matplotlib.rc("ytick.major", width=0.6)
matplotlib.rc("legend", fontsize=TEXT_PT, borderpad=0.3, columnspacing=1.0)
matplotlib.rc("legend", handlelength=1.6, labelspacing=0.3)
matplotlib.rc("grid", alpha=0.3, linewidth=0.5)
matplotlib.rc("lines", linewidth=1.0, markersize=3.5)
matplotlib.rc("hatch", linewidth=0.4)
# Text stays text in PDF, as TrueType, which publishers require; in SVG letters are outlines, so
# that it looks the same everywhere. A fixed salt makes the files of a figure reproducible.
matplotlib.rc("pdf", fonttype=42)
matplotlib.rc("svg", fonttype="path", hashsalt="fjh")


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure of this printed size [inch], laid out without overlaps."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def one_legend(figure: Figure, columns: int) -> None:
    """Add a legend below all panels, with each label once."""
    entries = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)


def logarithmic(axes: Axes, names: str) -> None:
    """Set logarithmic scales on the axes "x", "y" or "xy", with ticks at 1, 2, 5 of each decade."""
    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())


@contextmanager
def names_in_any_script() -> Iterator[None]:
    """Suppress warnings on letters that the font lacks, which become boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")
        yield


def printed(figure: Figure, name: str, formats: tuple[str, ...]) -> dict[str, bytes]:
    """Return a figure's files by name, in these formats, reproducible to the byte."""
    files = {}
    with names_in_any_script():
        if figure.axes and (layout := figure.get_layout_engine()):
            layout.execute(figure)
            figure.set_layout_engine("none")  # laid out once: all formats are the same
        for suffix in formats:
            figure.savefig(content := BytesIO(), format=suffix, metadata=_NO_DATE[suffix])
            files[f"{name}.{suffix}"] = content.getvalue()
    return files
