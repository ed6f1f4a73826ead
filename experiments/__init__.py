"""Headless experiments: the only room where the theory and the bench meet."""
