"""Colours, apart from :mod:`fjh.study.plotting`, which gives matplotlib its settings.

Who imports these waits for no matplotlib, and keeps the settings that he has.
"""

# Okabe and Ito's: colour-blind readers can distinguish them, and so can readers of a grey print.
BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, ORANGE, SKY, YELLOW = "#CC79A7", "#E69F00", "#56B4E9", "#F0E442"

LINES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""For curves of one kind, in the order of their use; yellow is too light for a line."""

FAILED = "#E7298A"
"""What has failed, among greys and the blue and red of loads, on black and on white."""
