"""Studies of the paper, and the command `fjh`."""
