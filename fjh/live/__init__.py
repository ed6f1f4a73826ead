"""A machine in the browser under its own closed loop, and buttons that break it (docs/track.md).

`page` has the server and the clock, `stage` draws the machines, `panel` has the buttons, `kept` the
recording of late. What is clicked is done by a session of the rig.
"""
