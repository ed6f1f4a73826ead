"""Inverse kinematics by tasks and limits."""
