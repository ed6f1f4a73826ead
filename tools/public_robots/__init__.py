"""`make robots`: published robots, from their file to a simulation."""
