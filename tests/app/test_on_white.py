"""Pictures of recordings on white: greys are exchanged, colours stay."""

import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from fjh.recording.render import on_white
from fjh.study.palette import LINES


def light(views: np.ndarray) -> np.ndarray:
    """Views (h, w, 3) in 0..1 on white, of a screen that has bars above and below them."""
    screen = np.pad(views, ((36, 30), (0, 0), (0, 0)), constant_values=0.3)
    Image.fromarray(np.round(255 * screen).astype(np.uint8)).save(file := io.BytesIO(), "png")
    return np.asarray(on_white(file.getvalue())) / 255


@pytest.mark.parametrize("grey", [0.0, 0.05, 0.4, 1.0])
def test_dark_and_light_greys_are_exchanged(grey):
    views = np.full((3, 4, 3), grey)
    np.testing.assert_allclose(light(views), 1 - views, atol=5e-3)


@pytest.mark.parametrize("line", LINES)
def test_a_line_keeps_its_colour_and_fades_into_white_at_its_edge(line):
    color, shares = np.array(to_rgb(line)), np.linspace(0, 1, 6)[:, None]
    drawn = light((shares * color)[None])[0]
    np.testing.assert_allclose(drawn[-1], color, atol=0.19)
    assert (np.diff(drawn.min(axis=1)) <= 0).all()  # no dark fringe between line and page
