"""Mappings of velocities and forces, and tasks of many levels, under limits."""
