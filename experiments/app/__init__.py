"""Command line of all studies, and the report on the main ones."""
