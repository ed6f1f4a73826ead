"""The command line, and what it makes of all studies."""
