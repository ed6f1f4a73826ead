"""Experiments: the only package that uses both the theory and the simulation."""

import logging

# What a warning of MuJoCo's means for a run, a sentence of the command's own says.
logging.getLogger(f"{__name__.removesuffix('experiments')}sim").addHandler(logging.NullHandler())
