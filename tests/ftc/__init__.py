"""Tests of fault-tolerant control."""
