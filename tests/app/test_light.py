"""Pictures of recordings on white: greys are exchanged, colours stay."""

import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread, imsave

from experiments.app.light import on_white
from experiments.study.palette import LINES

BLACK = np.zeros(3)


def png(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    imsave(file, pixels, format="png")
    return file.getvalue()


def pixels(picture: bytes) -> np.ndarray:
    return imread(io.BytesIO(picture), format="png")[..., :3]


@pytest.mark.parametrize("grey", [0.0, 0.05, 0.4, 1.0])
def test_dark_and_light_greys_are_exchanged(grey):
    light = pixels(on_white(png(np.full((3, 4, 3), grey))))
    np.testing.assert_allclose(light, 1 - grey, atol=5e-3)


@pytest.mark.parametrize("line", LINES)
def test_a_line_keeps_its_colour_and_fades_into_white_at_its_edge(line):
    color = np.array(to_rgb(line))
    shares = np.linspace(0, 1, 6)[:, None]
    light = pixels(on_white(png((shares * color + (1 - shares) * BLACK)[None])))[0]
    np.testing.assert_allclose(light[-1], color, atol=0.19)
    assert (np.diff(light.min(axis=1)) <= 0).all()  # no dark fringe between line and page


def test_the_first_rows_can_be_left_out():
    picture = np.linspace(0, 1, 5)[:, None, None] * np.ones((5, 3, 3))
    np.testing.assert_array_equal(
        pixels(on_white(png(picture), skip_rows=2)), pixels(on_white(png(picture)))[2:]
    )
