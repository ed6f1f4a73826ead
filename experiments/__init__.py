"""Experiments: the only package that uses both the theory and the simulation."""
