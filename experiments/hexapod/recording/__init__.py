"""Recordings of the hexapod."""
