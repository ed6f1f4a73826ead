"""One file, or a few, a study."""
