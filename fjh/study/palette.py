"""Colours of figures and recordings.

Unlike :mod:`fjh.study.plotting`, this module does not import matplotlib.
"""

# Okabe and Ito's palette, for colour-blind readers and for grey prints.
BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, ORANGE, SKY, YELLOW = "#CC79A7", "#E69F00", "#56B4E9", "#F0E442"

LINES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Colours of the curves of a plot, in order, without yellow, which is too light for lines."""

FAILED = "#E7298A"
"""Colour of failed parts, distinct from greys and from the blue and red of loads."""
