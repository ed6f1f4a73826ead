"""Fault-tolerant control of any mechanism."""

from argument_checks import __version__ as __version__
