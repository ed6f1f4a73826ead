"""Thousands of closed-loop runs, on as many machines as there are."""
