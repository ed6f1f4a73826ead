"""What of a file is the robot at work, where all of it stands still, and what is pinned."""
