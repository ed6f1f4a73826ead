"""Colours and the canvas of every figure; no display is needed."""

import matplotlib

matplotlib.use("Agg")

# Okabe and Ito's palette: told apart by colour-blind readers and in grey print.
BLACK, BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = (
    "#000000",
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
)
DESIRED, MEASURED, START = BLACK, BLUE, VERMILION
