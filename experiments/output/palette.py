"""Okabe and Ito's colours: told apart by colour-blind readers and in grey print."""

BLACK, BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, YELLOW = (
    "#000000",
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#F0E442",
)
LINES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""For curves that are alike, in the order of their use; yellow is too light for a line."""
DESIRED, MEASURED, START = BLACK, BLUE, VERMILION
COLOR_MAP = "cividis"
"""For a quantity: perceptually uniform, and the same to colour-blind readers."""
