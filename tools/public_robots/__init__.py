"""`make robots`: robots that others published, from their file to a flight."""
