"""Live simulation of a machine in the browser, with buttons for failures (docs/track.md).

`page` has the server and the clock, `stage` the machines in 3D, `panel` the buttons, and `save`
the recording of the last minute. Clicks are carried out by a session of the rig.
"""
