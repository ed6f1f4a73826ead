"""Colours, apart from :mod:`experiments.study.plotting`: matplotlib takes half a second."""

# Okabe and Ito's: colour-blind readers can distinguish them, and so can readers of a grey print.
BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, ORANGE, SKY, YELLOW = "#CC79A7", "#E69F00", "#56B4E9", "#F0E442"
