"""How fast: the closed loop beside bare physics, the mapping beside what others offer."""
