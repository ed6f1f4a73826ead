"""Fault-tolerant control of any mechanism."""
