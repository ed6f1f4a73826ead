"""Strut 1 without its coil, or without coil and spring."""
