"""Figures as an animation in a GIF, which every browser and GitHub plays."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

_COLORS, _ALMOST_WHITE = 128, 245


def pixels(figure: Figure) -> Image.Image:
    """A figure as a picture."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def write_gif(path: Path, pictures: Sequence[Image.Image], shown_ms: Sequence[int]) -> None:
    """Write pictures, each shown so long, as a GIF that repeats; the same bytes every time."""
    palette = _palette(pictures)
    first, *others = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures)
    timing = {"duration": list(shown_ms), "loop": 0}
    first.save(path, save_all=True, append_images=others, optimize=True, **timing)


def _palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """Colours for all pictures, from the first, the last and one between; white stays white."""
    some = [pictures[k] for k in (0, len(pictures) // 2, -1)]
    palette = Image.fromarray(np.concatenate([np.asarray(one) for one in some])).quantize(_COLORS)
    colors = np.array(palette.getpalette()).reshape(-1, 3)
    colors[colors.min(axis=1) > _ALMOST_WHITE] = 255
    palette.putpalette(colors.ravel().tolist())
    return palette
