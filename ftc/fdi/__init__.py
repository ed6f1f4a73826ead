"""Fault detection and isolation of any mechanism: n actuators, any outputs, linear models.

Numbers in, numbers out: nothing here knows a simulator, a file or a particular machine.
"""
