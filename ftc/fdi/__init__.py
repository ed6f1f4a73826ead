"""Fault detection and isolation."""
