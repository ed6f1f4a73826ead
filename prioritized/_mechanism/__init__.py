"""Mechanism: names, failures, accuracy, admissible motions, and all rank decisions on a task."""
