"""What could make a lock that nobody corrects as costly as Table I's last column says."""
