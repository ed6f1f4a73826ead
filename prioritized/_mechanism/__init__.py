"""The mechanism: names, failures, accuracy, what its loops admit, every decision on a task."""
