"""Tests of rigs: a machine in the loop, its events, predictions and errors."""
