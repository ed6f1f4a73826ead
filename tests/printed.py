"""What a figure is made of, read from the bytes of its PDF and not from the code that drew it."""

import re
import zlib
from pathlib import Path

import matplotlib
import numpy as np

from fjh.study.plotting import COLOR_MAP

PAGE_PT, COLUMN_PT = 7.16 * 72, 3.5 * 72
TEXT_PT = {7.0, 8.0, 0.7 * 7, 0.7 * 8}
"""Text and titles, and their subscripts."""

_NUMBER = rb"(-?\d*\.?\d+)"
OKABE_ITO = [
    (0, 0, 0),
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (0, 114, 178),
    (213, 94, 0),
    (204, 121, 167),
]


def drawn(pdf: bytes) -> bytes:
    """All drawing operators of the file: its streams, fonts and images left out."""
    found = []
    for head, body in re.findall(
        rb"<<((?:(?!endobj).)*?)>>\s*stream\r?\n(.*?)endstream", pdf, re.S
    ):
        if b"/Length1" not in head and b"/Image" not in head:
            found.append(zlib.decompress(body) if b"FlateDecode" in head else body)
    return b"\n".join(found)


def text_pt(pdf: bytes) -> set[float]:
    """Sizes of all text."""
    return {float(size) for size in re.findall(rb"/\S+ " + _NUMBER + rb" Tf", drawn(pdf))}


def colors(pdf: bytes) -> set[tuple[float, ...]]:
    """Every colour that is stroked or filled, greys left out."""
    triples = re.findall(rb"\s".join([_NUMBER] * 3) + rb" (?:rg|RG)\b", drawn(pdf))
    found = {tuple(float(part) for part in triple) for triple in triples}
    return {color for color in found if len(set(color)) > 1}


def width_pt(pdf: bytes) -> float:
    box = re.search(rb"/MediaBox \[ ?0 0 " + _NUMBER, pdf)
    assert box
    return float(box.group(1))


def faults(path: Path) -> list[str]:
    """What keeps a PDF from being printed as a journal asks, and read by everyone."""
    pdf = path.read_bytes()
    found = []
    if not any(abs(width_pt(pdf) - width) < 0.5 for width in (PAGE_PT, COLUMN_PT)):
        found.append(f"{width_pt(pdf):.0f} pt wide")
    sizes = text_pt(pdf)
    assert sizes, "a figure without a word"
    strange = [size for size in sizes if min(abs(size - law) for law in TEXT_PT) > 1e-3]
    found += [f"text of {size:g} pt" for size in strange]
    fonts = pdf.count(b"/Type /FontDescriptor")
    if not fonts or b"/Type3" in pdf or pdf.count(b"/FontFile2 ") != fonts:
        found.append("fonts are not embedded as TrueType")
    map_colors = matplotlib.colormaps[COLOR_MAP](np.arange(256))[:, :3]
    allowed = np.vstack([np.array(OKABE_ITO) / 255, map_colors])
    for color in colors(pdf):
        if np.abs(allowed - color).max(axis=1).min() > 1e-3:
            found.append(f"colour {color}")
    if b"/CreationDate" in pdf:
        found.append("a date, so that no two runs agree")
    return found


def assert_printable(folder: Path) -> None:
    """Every figure of the folder is there as PNG and PDF, and its PDF has no faults."""
    pdfs = sorted(folder.glob("*.pdf"))
    assert pdfs
    assert {path.stem for path in pdfs} == {path.stem for path in folder.glob("*.png")}
    assert {path.name: faults(path) for path in pdfs} == {path.name: [] for path in pdfs}
