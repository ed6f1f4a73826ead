"""Numbers without a mechanism: the rank decision, bases, batches, the compiled solvers."""
