"""Numerical methods without a mechanism: rank decision, bases, batches, compiled solvers."""
