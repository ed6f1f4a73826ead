"""Studies that reproduce and extend the paper, and the command `fjh`."""
