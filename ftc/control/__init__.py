"""Compensators of single channels, and the mapping from a major task to the actuators."""
