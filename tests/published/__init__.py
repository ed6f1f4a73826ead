"""Comparisons with published results of other authors on robots that they chose."""
