"""Scenes: the robot at work of a file, where all of it stands still, and what is pinned."""

from sim.scene.scene import Scene as Scene
from sim.scene.scene import robot_scene as robot_scene
