"""What a referee would see at once in a matplotlib Figure; each check returns sentences.

All but `faults` expect a figure that is laid out: `figure.draw_without_rendering()`.
"""

from itertools import combinations

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from fjh.study.plotting import names_in_any_script
from tests.on_paper import (
    color_of,
    drawn,
    in_words,
    is_drawing,
    is_printed,
    legends_of,
    look,
    quoted,
    text_box,
    texts,
    touches,
)

LEAST_PT = 7
"""The least size of text that journals print."""

NEAR_PT = 12
"""A text of a line's colour that is so near explains the line."""


def faults(figure: Figure) -> list[str]:
    """All that is wrong with a figure, a sentence each."""
    checks = (text_faults, overlapping_texts, unexplained, hidden_data, labels_on_curves)
    with names_in_any_script():
        figure.draw_without_rendering()
        return [sentence for check in checks for sentence in check(figure)]


def text_faults(figure: Figure) -> list[str]:
    """Text below 7 pt or beyond the paper's edge, and more than one family of fonts."""
    shown = list(texts(figure))
    sizes = {text: text.get_fontproperties().get_size_in_points() for text in shown}
    found = [f"{quoted(text)} has {pt:g} pt" for text, pt in sizes.items() if pt < LEAST_PT]
    paper = figure.bbox.padded(1)
    found += [
        f"{quoted(text)} is cut off"
        for text in shown
        if not all(paper.contains(*corner) for corner in text_box(text).corners())
    ]
    fonts = sorted({text.get_fontname() for text in shown})
    return found + ([f"several fonts: {', '.join(fonts)}"] if len(fonts) > 1 else [])


def overlapping_texts(figure: Figure) -> list[str]:
    """Pairs of texts that are printed upon each other."""
    boxes = [(text, text_box(text)) for text in texts(figure)]
    return [
        f"{quoted(one)} and {quoted(other)} overlap"
        for (one, first), (other, second) in combinations(boxes, 2)
        if Bbox.intersection(first, second) is not None
    ]


def unexplained(figure: Figure) -> list[str]:
    """Lines, markers and areas that neither a legend nor a text of their colour beside explains.

    What all looks alike in an axes is explained by its title and labels.
    """
    found = []
    for axes in figure.axes:
        looks = {look(artist): artist for artist in drawn(axes)}
        legends = [*legends_of(axes), *figure.legends]
        listed = {look(each) for legend in legends for each in legend.findobj(is_drawing)}
        if len(looks) > 1:
            found += [
                f"{quoted(axes.title)}: nothing explains {in_words(artist)}"
                for appearance, artist in looks.items()
                if appearance not in listed and not _is_labelled(artist, axes)
            ]
    return found


def hidden_data(figure: Figure) -> list[str]:
    """Legends over data."""
    legends = [*figure.legends, *(each for axes in figure.axes for each in legends_of(axes))]
    return [
        f"{quoted(axes.title)}: a legend hides {in_words(artist)}"
        for axes in figure.axes
        for artist in drawn(axes)
        if any(touches(artist, axes, legend.get_window_extent()) for legend in legends)
    ]


def labels_on_curves(figure: Figure) -> list[str]:
    """Texts in an axes with a line through them."""
    return [
        f"{quoted(axes.title)}: {in_words(line)} goes through {quoted(text)}"
        for axes in figure.axes
        for text in filter(is_printed, axes.texts)
        for line in axes.lines
        if touches(line, axes, text_box(text))
    ]


def _is_labelled(artist: Artist, axes: Axes) -> bool:
    pad = NEAR_PT * axes.figure.dpi / 72
    beside = [text for text in axes.texts if to_hex(text.get_color()) == color_of(artist)]
    return any(touches(artist, axes, text_box(text).padded(pad)) for text in beside)
