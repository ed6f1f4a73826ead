"""Names of the rows of a twist."""

ROWS = ("turn x", "turn y", "turn z", "x", "y", "z")
