"""Colours of figures and recordings, without an import of matplotlib.

:mod:`fjh.study.plotting` changes the settings of matplotlib; this module does not.
"""

# Okabe and Ito's palette, for colour-blind readers and for grey prints.
BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, ORANGE, SKY, YELLOW = "#CC79A7", "#E69F00", "#56B4E9", "#F0E442"

LINES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Colours of the curves of one plot, in order; yellow is too light for a line."""

FAILED = "#E7298A"
"""Colour of failed parts; distinct from greys and from the blue and red of loads."""
