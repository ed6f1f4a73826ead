"""Moved to :mod:`ftc.linear_loop`."""

from ftc.linear_loop import limited_response as limited_response  # lead: remove
