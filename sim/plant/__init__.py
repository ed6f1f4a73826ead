"""The plant: physics, actuators that fail, amplifiers, sensors in a loop, linear models."""
