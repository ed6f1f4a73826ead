"""Hexapod testbed: constants, simulation, metrics, and the numbers of the paper."""
