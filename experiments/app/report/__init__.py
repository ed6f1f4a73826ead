"""Every experiment, one after another, told on one page."""
