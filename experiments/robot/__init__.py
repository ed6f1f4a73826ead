"""A robot with its loops, ready to fly: the hexapod of the testbed, or any MJCF file."""
