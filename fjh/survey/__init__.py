"""Fault-tolerance report of a robot or of any effectiveness matrix."""
