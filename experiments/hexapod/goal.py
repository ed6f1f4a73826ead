"""The hexapod's task: which rows of the payload's twist are major, which secondary."""

from ftc.goal import Goal as Goal  # lead: remove

MAJOR = [0, 1]
"""Task rows (alpha, beta): the pointing task."""
SECONDARY = [3, 4, 5, 2]
"""[t_x, t_y, t_z, gamma], the order of the paper's W_d and W_e."""
