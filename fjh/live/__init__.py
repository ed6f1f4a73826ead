"""Live simulation of a robot in the browser, with buttons for failures (docs/track.md)."""
