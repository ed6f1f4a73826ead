"""What is where in a matplotlib Figure that is laid out, in pixels, and what it looks like."""

from collections.abc import Iterator

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cbook import STEP_LOOKUP_MAP
from matplotlib.collections import Collection, PathCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Bbox


def texts(figure: Figure) -> Iterator[Text]:
    """Every text that is printed."""
    hidden = {text for axes in figure.axes for text in _hidden_tick_labels(axes)}
    for text in figure.findobj(Text):
        if isinstance(text, Text) and is_printed(text) and text not in hidden:
            yield text


def _hidden_tick_labels(axes: Axes) -> Iterator[Artist]:
    """Labels beyond the ends of an axis, and all of an axis that is not drawn."""
    for axis in (child for child in axes.get_children() if isinstance(child, Axis)):
        shown = axes.axison and axis.get_visible()
        low, high = sorted(axis.get_view_interval())
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
            if not shown or not low <= tick.get_loc() <= high:
                yield from tick.findobj(Text)


def is_printed(text: Text) -> bool:
    return text.get_visible() and bool(text.get_text().strip())


def text_box(text: Text) -> Bbox:
    """Of the words alone, without an annotation's arrow; a hair smaller than the letters' line."""
    return Text.get_window_extent(text).padded(-1)


def quoted(text: Text) -> str:
    return repr(text.get_text())


def in_words(artist: Artist) -> str:
    label = str(artist.get_label())
    return repr(label) if label and not label.startswith("_") else f"what looks {look(artist)}"


def is_drawing(artist: Artist) -> bool:
    return isinstance(artist, Line2D | Patch | Collection)


def legends_of(axes: Axes) -> list[Legend]:
    return [child for child in axes.get_children() if isinstance(child, Legend)]


def drawn(axes: Axes) -> list[Artist]:
    """Lines, areas and markers; not what a colour scale explains."""
    plain = [each for each in axes.collections if each.get_array() is None]
    artists = [*axes.lines, *axes.patches, *plain]
    return [each for each in artists if each.get_visible() and _points(each).size]


def look(artist: Artist) -> tuple[object, ...]:
    """What tells it from others: colour, kind of line, marker."""
    if isinstance(artist, Line2D):
        marker = str(artist.get_marker()).replace("None", "")
        line = str(artist.get_linestyle()).replace("None", "")
        hollow = bool(marker) and str(artist.get_markerfacecolor()) == "none"
        return line, marker, hollow, color_of(artist)
    hatch = getattr(artist, "get_hatch", lambda: None)()
    return "area", hatch, color_of(artist)


def color_of(artist: Artist) -> str:
    if isinstance(artist, Line2D):
        return to_hex(artist.get_color())
    faces = np.atleast_2d(artist.get_facecolor())  # pyright: ignore[reportAttributeAccessIssue]
    edges = np.atleast_2d(artist.get_edgecolor())  # pyright: ignore[reportAttributeAccessIssue]
    return to_hex((faces if faces.size and faces[0, 3] else edges)[0])


def touches(artist: Artist, axes: Axes, box: Bbox) -> bool:
    """Whether any of it is inside the box, on paper."""
    inside = Bbox.intersection(box, axes.bbox)
    if inside is None:
        return False
    points = _points(artist)
    if isinstance(artist, Line2D):
        pad = artist.get_markersize() * axes.figure.dpi / 144 if artist.get_marker() else 0
        marked = bool(look(artist)[1]) and _any_inside(points, inside.padded(pad))
        line = Path(points).cleaned(remove_nans=True)
        return marked or (look(artist)[0] != "" and line.intersects_bbox(inside, filled=False))
    if isinstance(artist, Patch):
        return Path(points).intersects_bbox(inside, filled=True)
    return _any_inside(points, inside)


def _any_inside(points: np.ndarray, box: Bbox) -> bool:
    return bool(((points >= box.min) & (points <= box.max)).all(axis=1).any())


def _points(artist: Artist) -> np.ndarray:
    """Where it is on paper, (N, 2): NaN where a line is interrupted; empty: nothing to see."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(artist, Line2D):
            points = artist.get_transform().transform(artist.get_path().vertices)
            if (style := artist.get_drawstyle()) != "default" and len(points):
                points = STEP_LOOKUP_MAP[style](*points.T).T
        elif isinstance(artist, Patch):
            points = artist.get_transform().transform_path(artist.get_path()).vertices
        else:
            assert isinstance(artist, Collection)
            points = _collected(artist)
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    points = np.where(np.isfinite(points), points, np.nan)
    return points if np.isfinite(points).all(axis=1).any() else np.empty((0, 2))


def _collected(collection: Collection) -> np.ndarray:
    """Of markers their places, of lines and areas their corners."""
    if isinstance(collection, PathCollection):
        return collection.get_offset_transform().transform(collection.get_offsets())
    paths = [collection.get_transform().transform_path(p).vertices for p in collection.get_paths()]
    return np.vstack(paths) if paths else np.empty((0, 2))
