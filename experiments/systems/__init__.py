"""The other mechanisms of the paper, classified and driven."""
