"""No robot in it: studies and results, tables, files, figures, recordings, the terminal."""
