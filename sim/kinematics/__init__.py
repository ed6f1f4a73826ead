"""Kinematics of any model: poses, tasks, Jacobians, distances, a controller's model."""
