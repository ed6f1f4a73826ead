"""Tests of the studies and of the command line, one or a few files per study."""
