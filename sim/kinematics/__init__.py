"""Kinematics of any model: poses, tasks, Jacobians and their accuracy, a controller's own model."""
