"""Tests of recordings of a machine in its loop."""
