"""Scenes: the robot of a file at equilibrium, split into task part and surroundings."""

from sim.scene.scene import Scene as Scene
from sim.scene.scene import robot_scene as robot_scene
