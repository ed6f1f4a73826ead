"""Live simulation of a robot in the browser, with buttons for failures (docs/track.md).

`page` has the server and the clock, `stage` the machines in 3D, `panel` the buttons, `session` the
simulation and the actions of buttons, and `save` the recording of the last minute.
"""
