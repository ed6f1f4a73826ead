"""Pictures for a white page, of a viewer that draws without a window in its dark theme only."""

import io

import numpy as np
from matplotlib.image import imread, imsave

_COLORFUL = 0.7
"""Difference between largest and least of R, G, B (0..1) of a pure colour of our palette."""


def on_white(png: bytes, skip_rows: int = 0) -> bytes:
    """The PNG with dark and light greys exchanged, without its first rows; colours stay.

    A pixel that a line covers in part is a mixture of its colour and the background: the line's
    share is how colourful the pixel is, and the rest becomes light.
    """
    dark = imread(io.BytesIO(png), format="png")[skip_rows:, :, :3]
    low, high = dark.min(axis=-1, keepdims=True), dark.max(axis=-1, keepdims=True)
    background = 1 - np.minimum(1, (high - low) / _COLORFUL)
    light = np.clip(dark + background * (1 - 2 * low), 0, 1)
    file = io.BytesIO()
    imsave(file, light, format="png", metadata={"Software": "fjh"})
    return file.getvalue()
