"""Experiments: the only package that uses both the theory and the simulation."""

import logging

from fjh_launcher import check_not_hidden

check_not_hidden(__name__, "argument_checks", "ftc", "prioritized", "sim")

# What a warning of MuJoCo's means for a run, a sentence of the command's own says.
logging.getLogger("sim").addHandler(logging.NullHandler())
