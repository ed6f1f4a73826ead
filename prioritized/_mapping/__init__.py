"""Optimal mappings and hierarchies: gains, solutions under limits, and their status."""
