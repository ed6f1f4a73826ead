"""Fault-tolerant control."""
