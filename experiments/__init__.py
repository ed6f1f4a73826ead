"""Headless experiments: the only room where the theory and the bench meet."""

import logging

# What a warning of MuJoCo's means for a run, a sentence of the command's own says.
logging.getLogger("sim").addHandler(logging.NullHandler())
