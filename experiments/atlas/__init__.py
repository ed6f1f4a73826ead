"""Every failure condition flown, and held against what was said of it beforehand."""
