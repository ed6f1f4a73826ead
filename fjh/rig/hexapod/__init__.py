"""The hexapod testbed: its constants, its simulation, its metrics, the paper's numbers."""
