"""Isolation: which hypothesis the samples since an alarm speak for."""
