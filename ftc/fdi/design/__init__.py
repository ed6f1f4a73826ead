"""Before anything runs: what can be told apart, with which dither."""
